"""What a log says about attitude, whatever its format: set-points and attitude as roll and pitch over time."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from companion.errors import CompanionError
from companion.identify.reading import samples

Floats = npt.NDArray[np.float64]

AXES: Final = ("roll", "pitch")  # columns of every angle array here
VEHICLE: Final = "vehicle"
OURS: Final = "ours"
GAINS: Final = (
    "MC_ROLL_P", "MC_PITCH_P", "MC_ROLLRATE_P", "MC_PITCHRATE_P", "MC_ROLLRATE_K", "MC_PITCHRATE_K",
    "MC_REF_W_N", "MC_REF_FF", "MC_REF_FF_MAX",  # from PX4 v1.18
)  # fmt: skip
"""Parameters of PX4 that make its attitude response what it is."""
LONGEST_PAUSE_S: Final = 5.0  # a longer one parts a flight in two: work is bounded by samples, not by the time between


class LogError(CompanionError):
    """A log that no response can be identified from; the message is one line that says what to do."""


class Track(NamedTuple):
    """Set-points and attitude in one clock.

    Attributes
    ----------
    clock
        `OURS`: a set-point counts from when it was sent and an attitude from when it was received, so the link is in
        between. `VEHICLE`: both as the autopilot stamped them.
    setpoint_time_s, setpoint_rad
        Shape (n,) and (n, 2): a set-point holds from its time to the next one's.
    attitude_time_s, attitude_rad
        Shape (m,) and (m, 2).
    """

    clock: str
    setpoint_time_s: Floats
    setpoint_rad: Floats
    attitude_time_s: Floats
    attitude_rad: Floats


class Estimate(NamedTuple):
    """What the estimator said of the horizontal state, in its own clock.

    Attributes
    ----------
    time_s
        Shape (n,), rising.
    position_m, velocity_m_s
        Shape (n, 2), north and east.
    resets_s
        Shape (k,): times at which position or velocity was set anew, and jumped.
    """

    time_s: Floats
    position_m: Floats
    velocity_m_s: Floats
    resets_s: Floats = np.empty(0)


class ClockMap(NamedTuple):
    """Our clock to the vehicle's by matched set-points: sent then, in force then. Knots, shape (k,) each."""

    ours_s: Floats
    vehicle_s: Floats


class ParameterValue(NamedTuple):
    """A parameter from a time on, s in the track's clock; minus infinity where the log began with it."""

    time_s: float
    name: str
    value: float


class Recording(NamedTuple):
    """One log.

    Attributes
    ----------
    path, kind, system_id
        File, "ULog", "tlog" or "flight record", and the vehicle's MAVLink system id.
    track
        Set-points and attitude in the log's first clock: ours where it has it, else the vehicle's.
    following
        Shape (k, 2): from when to when the vehicle was armed and followed a stream of attitude set-points (OFFBOARD), s
        in the track's clock.
    setpoint_q
        Shape (n, 4), float32: the set-points as quaternions, by which the same flight is recognised in another log.
    lateness_s
        How much earlier than logged a set-point may have been in force: the period of a log that keeps only every
        so-manieth; zero where all are there.
    saturated_s
        Shape (j,): times at which an actuator or the thrust was at its limit.
    stamps_s
        Shape (m,): the vehicle's time of each attitude of the track.
    applied
        Our clock to the vehicle's, where the log carries the set-points that the vehicle had in force.
    gains
        Parameters of the attitude loop when the vehicle began to follow.
    estimate
        None where the log does not have it.
    px4_version
        The vehicle's, as "1.17"; None where the log does not tell.
    in_flight
        Shape (k, 2): from when to when the vehicle was in the air and followed attitude set-points, whoever made them:
        a companion, sticks, or its own position controller. None where `following` is all that the log tells.
    tuning
        Parameters of the attitude loop over time, in order.
    notes
        What was dropped or passed over in reading, one line each, without the file's name.
    """

    path: Path
    kind: str
    system_id: int
    track: Track
    following: Floats
    setpoint_q: npt.NDArray[np.float32]
    lateness_s: float
    saturated_s: Floats
    stamps_s: Floats
    applied: ClockMap | None
    gains: dict[str, float]
    estimate: Estimate | None = None
    px4_version: str | None = None
    in_flight: Floats | None = None
    tuning: tuple[ParameterValue, ...] = ()
    notes: tuple[str, ...] = ()


def angles(q_wxyz: npt.NDArray[Any]) -> Floats:
    """Roll and pitch in rad, shape (n, 2), of quaternions body to NED, shape (n, 4)."""
    w, x, y, z = q_wxyz.astype(np.float64).T
    roll = np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0))
    return np.stack([roll, pitch], axis=1)


def ordered(
    path: Path, time_s: Floats, what: str, notes: list[str], *, tolerance_s: float = 0.0, end_s: float = np.inf
) -> npt.NDArray[np.intp]:
    """Indices that leave a rising time; bad times are dropped, and counted in a note.

    Parameters
    ----------
    path, what
        File and series, for messages.
    time_s
        Shape (n,), as written.
    notes
        Takes a line when samples are dropped.
    tolerance_s
        Samples late by less overtook one another: they are dropped without a word.
    end_s
        A later time is none; without it, a few samples far behind all others are dropped.

    Raises
    ------
    LogError
        For a clock that was set back.
    """
    kept = np.flatnonzero(time_s < samples.NEWEST_S)
    kept = kept[samples.in_order(time_s[kept])]
    back = samples.set_back(time_s, kept, tolerance_s)
    if back is not None:
        raise LogError(
            f"{path}: the clock goes backwards: {what} falls by {back.by_s:.3g} s after {back.after_s:.3f} s "
            "(a reboot or a stepped clock): fly again without one"
        )
    kept = kept[samples.without_far(time_s[kept])] if np.isinf(end_s) else kept[time_s[kept] <= end_s]
    late = np.maximum.accumulate(time_s) - time_s
    dropped = len(time_s) - len(kept) - int(((late > 0.0) & (late <= tolerance_s)).sum())
    if dropped > 0:
        notes.append(f"{dropped} of {len(time_s)} samples dropped: {what} is out of order")
    return kept[samples.rising(time_s[kept])]


def covered(time_s: Floats) -> Floats:
    """From when to when samples follow one another within `LONGEST_PAUSE_S`, shape (k, 2)."""
    edges = np.flatnonzero(np.diff(time_s) > LONGEST_PAUSE_S)
    starts, ends = np.concatenate([time_s[:1], time_s[edges + 1]]), np.concatenate([time_s[edges], time_s[-1:]])
    return np.stack([starts, ends], axis=1)


def spans(time_s: Floats, holds: npt.NDArray[np.bool_], end_s: float) -> Floats:
    """From when to when a reported condition held, shape (k, 2): from its first report to the first that denies it."""
    edges = np.flatnonzero(np.diff(holds.astype(np.int8), prepend=0, append=0))
    after = np.append(time_s, end_s)
    return np.array([[time_s[a], after[b]] for a, b in zip(edges[::2], edges[1::2], strict=True)]).reshape(-1, 2)


def intersect(left: Floats, right: Floats) -> Floats:
    """What two sets of spans have in common, each of them in order and without overlap; shape (k, 2)."""
    common, i, k = list[tuple[float, float]](), 0, 0
    while i < len(left) and k < len(right):
        start, stop = max(left[i][0], right[k][0]), min(left[i][1], right[k][1])
        if stop > start:
            common.append((start, stop))
        i, k = (i + 1, k) if left[i][1] < right[k][1] else (i, k + 1)
    return np.array(common).reshape(-1, 2)


def outside(spans_s: Floats) -> Floats:
    """All time that is in none of some spans, shape (k + 1, 2)."""
    return np.stack([np.append(-np.inf, spans_s[:, 1]), np.append(spans_s[:, 0], np.inf)], axis=1)
