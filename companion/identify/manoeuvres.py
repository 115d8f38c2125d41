"""Find the excited stretches of a log: one manoeuvre after the other, one axis at a time, and how good each is."""

from __future__ import annotations

import itertools
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from companion.identify.series import AXES, OURS, Floats, LogError, Recording, Track

ACTIVE_RAD: Final = np.radians(2.5)  # a set-point that moves by this much within _WINDOW_S is a manoeuvre's
QUIET_RAD: Final = np.radians(1.0)  # what the other axis may move meanwhile; or _CROSS of the manoeuvre's amplitude
AMPLITUDE_RAD: Final = np.radians(1.5)  # least standard deviation of the set-point
LARGEST_RAD: Final = np.radians(35.0)  # beyond it the attitude loop is not linear
FEWEST: Final = 3  # manoeuvres an axis: an interval from repetition needs them
_CROSS: Final = 0.25
_STEP_S: Final = 0.01
_WINDOW_S: Final = 0.2
_PAUSE_S: Final = 1.8  # a longer rest ends a manoeuvre
_BEFORE_S: Final = 0.3
_AFTER_S: Final = 0.8  # of the response after the last movement
_SHORTEST_S: Final = 1.5
_LONGEST_S: Final = 8.0  # a longer one, a chirp, is cut in pieces
_PIECE_S: Final = 4.0
_COMPARABLE: Final = 0.5  # of the strongest manoeuvre's standard deviation
_HISTORY_S: Final = 4.0  # of set-points before it, so that the model starts in the vehicle's state
GAP_S: Final = {"set-points": 0.5, "attitude": 0.25}
SATURATED_SHARE: Final = 0.05
_SAMPLES: Final = 40

FLY: Final = "fly at least three doublets of 5 to 10 deg and 3 s in {}, one axis at a time with pauses between them"


class TooFewManoeuvresError(LogError):
    """Too few clean manoeuvres to fit by their repetition."""


class Manoeuvre(NamedTuple):
    """One manoeuvre of one axis: set-points with some history, and the attitude that followed.

    Attributes
    ----------
    recording
        Where it is from.
    axis, clock
        "roll" or "pitch", and the clock of the times.
    start_s, end_s
        What is fitted.
    setpoint_time_s, setpoint_rad
        Shape (n,): each holds to the next; they begin before `start_s`.
    time_s, measured_rad
        Shape (m,), from `start_s` to `end_s`.
    """

    recording: Recording
    axis: str
    clock: str
    start_s: float
    end_s: float
    setpoint_time_s: Floats
    setpoint_rad: Floats
    time_s: Floats
    measured_rad: Floats


def find(recording: Recording) -> dict[str, list[Manoeuvre]]:
    """The manoeuvres of a log by axis, in the order flown; none for an axis that rested.

    Raises
    ------
    LogError
        For a gap where it matters.
    """
    windows: dict[str, list[tuple[float, float]]] = {axis: [] for axis in AXES}
    for start, stop in recording.following:
        for axis, found in zip(AXES, _windows(recording, start, stop), strict=True):
            windows[axis] += found
    edges = [edge for axis in AXES for window in windows[axis] for edge in window]
    if edges:
        _check_gaps(recording, min(edges), max(edges))
    return {axis: [cut(recording, axis, *p) for window in windows[axis] for p in _pieces(window)] for axis in AXES}


def select(axis: str, manoeuvres: list[Manoeuvre], where: str) -> list[Manoeuvre]:
    """Those that excite about as much as the strongest: a small movement among large ones only adds noise.

    Parameters
    ----------
    axis, manoeuvres
        All of one axis, from all logs.
    where
        Names of the logs, for the message.

    Raises
    ------
    TooFewManoeuvresError
        For too few of them; the message says what to fly instead.
    LogError
        For a saturated one; likewise.
    """
    fly = FLY.format(axis)
    sampled = [m for m in manoeuvres if len(m.time_s) >= _SAMPLES]
    strongest = max((_spread(m) for m in sampled), default=0.0)
    kept = [m for m in sampled if _spread(m) >= max(_COMPARABLE * strongest, AMPLITUDE_RAD)]
    if len(kept) < FEWEST:
        count = f"{len(kept)} manoeuvre{'s' if len(kept) > 1 else ''} of {FEWEST}" if kept else "no manoeuvre"
        raise TooFewManoeuvresError(f"{where}: too little excitation in {axis}, {count}: {fly}")
    largest = max(float(np.abs(m.setpoint_rad[m.setpoint_time_s >= m.start_s]).max(initial=0.0)) for m in kept)
    if largest > LARGEST_RAD:
        raise LogError(
            f"{where}: saturated: the {axis} set-point reaches {np.degrees(largest):.0f} deg, and beyond "
            f"{np.degrees(LARGEST_RAD):.0f} deg the attitude loop is not linear: {fly}"
        )
    for m in kept:
        if saturated_share(m.recording, m.start_s, m.end_s) > SATURATED_SHARE:
            raise LogError(
                f"{m.recording.path}: saturated: thrust or an actuator is at its limit between {m.start_s:.1f} and "
                f"{m.end_s:.1f} s: {fly}, around hover"
            )
    return kept


def cut(recording: Recording, axis: str, start_s: float, end_s: float, other_track: Track | None = None) -> Manoeuvre:
    """One manoeuvre's share of a log, or of the same flight in another clock."""
    track, column = other_track or recording.track, AXES.index(axis)
    held = (track.setpoint_time_s >= start_s - _HISTORY_S) & (track.setpoint_time_s < end_s)
    first = int(np.argmax(held)) if held.any() else len(held) - 1
    held[max(first - 1, 0)] = True  # the one in force when the history begins
    inside = (track.attitude_time_s >= start_s) & (track.attitude_time_s < end_s)
    return Manoeuvre(
        recording,
        axis,
        track.clock,
        start_s,
        end_s,
        track.setpoint_time_s[held],
        track.setpoint_rad[held, column],
        track.attitude_time_s[inside],
        track.attitude_rad[inside, column],
    )


def _windows(recording: Recording, start_s: float, stop_s: float) -> list[list[tuple[float, float]]]:
    """From when to when each axis moves while the other rests, within one stretch."""
    track = recording.track
    grid = np.arange(start_s, stop_s, _STEP_S)
    at = np.searchsorted(track.setpoint_time_s, grid, side="right") - 1
    grid, at = grid[at >= 0], at[at >= 0]
    if len(grid) < 2:
        return [[], []]
    held = track.setpoint_rad[at]
    width = round(_WINDOW_S / _STEP_S)
    return [_axis_windows(grid, held[:, i], held[:, 1 - i], width) for i in range(len(AXES))]


def _axis_windows(grid: Floats, moved: Floats, other: Floats, width: int) -> list[tuple[float, float]]:
    """Greedy: begin at a movement, go on while it moves again within `_PAUSE_S` and the other axis rests."""
    change = np.abs(moved - np.concatenate([np.full(min(width, len(moved)), moved[0]), moved[:-width]])[: len(moved)])
    active = np.flatnonzero(change > ACTIVE_RAD)
    windows: list[tuple[float, float]] = []
    pause = round(_PAUSE_S / _STEP_S)
    after = round(_AFTER_S / _STEP_S)
    k = 0
    while k < len(active):
        first = _onset(moved, int(active[k]), width)
        rest = other[min(first + 1, len(other) - 1)]
        amplitude = np.maximum.accumulate(np.abs(moved[first:] - moved[max(first - 1, 0)]))
        disturbed = np.flatnonzero(np.abs(other[first + 1 :] - rest) > np.maximum(QUIET_RAD, _CROSS * amplitude[1:]))
        limit = first + 1 + int(disturbed[0]) if len(disturbed) else len(grid)
        within = active[(active >= active[k]) & (active < limit)]
        if not len(within):
            k += 1
            continue
        pauses = np.flatnonzero(np.diff(within) > pause)
        last = int(within[pauses[0]]) if len(pauses) else int(within[-1])
        alone = min(last + after, limit)
        if alone == limit and ((active >= limit) & (active < limit + width)).any():
            last = limit  # both axes move on together, as where position is held again: its answer is worth having
        end = min(last + after, len(grid) - 1)
        if (alone - first) * _STEP_S >= _SHORTEST_S:
            windows.append((float(grid[first]) - _BEFORE_S, float(grid[end])))
        k = max(int(np.searchsorted(active, end)), int(np.searchsorted(active, last, side="right")))
    return windows


def _onset(moved: Floats, at: int, width: int) -> int:
    """Where the movement seen at `at` began."""
    back = moved[max(at - width, 0) : at + 1]
    return at - len(back) + 1 + int(np.argmax(np.abs(back - back[0]) > 0.1 * np.abs(back[-1] - back[0])))


def _pieces(window: tuple[float, float]) -> list[tuple[float, float]]:
    start, end = window
    if end - start <= _LONGEST_S:
        return [window]
    bounds = np.linspace(start, end, max(FEWEST, int((end - start) / _PIECE_S)) + 1)
    return [(float(a), float(b)) for a, b in itertools.pairwise(bounds)]


def _spread(manoeuvre: Manoeuvre) -> float:
    """Standard deviation over time of the set-point."""
    at = np.searchsorted(manoeuvre.setpoint_time_s, manoeuvre.time_s, side="right") - 1
    return float(manoeuvre.setpoint_rad[np.maximum(at, 0)].std())


def saturated_share(recording: Recording, start_s: float, end_s: float) -> float:
    """Seconds of a manoeuvre with a limit reported in them, over all of them."""
    inside = (recording.saturated_s >= start_s) & (recording.saturated_s < end_s)
    return len(np.unique((recording.saturated_s[inside] * 5).astype(int))) / max((end_s - start_s) * 5, 1.0)


def _check_gaps(recording: Recording, start_s: float, end_s: float) -> None:
    """Raise `LogError` when set-points or attitude are missing between the first manoeuvre and the last."""
    track = recording.track
    inside = intervals_inside(recording.following, start_s, end_s)
    series: tuple[tuple[str, Floats], ...] = (
        ("set-points", track.setpoint_time_s),
        ("attitude", track.attitude_time_s),
    )
    for what, time_s in series:
        for a, b in inside:
            within = time_s[(time_s >= a) & (time_s <= b)]
            steps = np.diff(np.concatenate([[a], within, [b]])) if len(within) else np.array([b - a])
            if steps.max() > GAP_S[what]:
                at = np.concatenate([[a], within])[int(np.argmax(steps))]
                where = "our clock, from the first record" if track.clock == OURS else "vehicle's clock"
                raise LogError(
                    f"{recording.path}: gap: no {what} for {steps.max():.2f} s after {at:.2f} s ({where}): fly again, "
                    "with a link or a log that keeps up"
                )


def intervals_inside(spans_s: npt.NDArray[np.float64], start_s: float, end_s: float) -> list[tuple[float, float]]:
    """The parts of some spans between two times."""
    return [(max(a, start_s), min(b, end_s)) for a, b in spans_s if min(b, end_s) > max(a, start_s)]
