"""Peak and RMS of (26) and (29), and whether the flight was stable."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from companion.config import Config
from companion.flight.authority.states import State
from companion.record.reader import Flight

_NOT_JUDGED_M = 0.05
_MOVED_M = 0.01
_GROWTH = 2.0  # of the error over the first stair's: stable flights reach 1.2, the paper's unstable one 7
_STEADY_S = 3.0  # of each stair: its end
_STAIR_S = 5.0  # at least, or nothing is steady
_MOVING_S = 0.5  # between two changes of a target that moves and does not step


class Metrics(NamedTuple):
    """Error against the ideal reference over the whole of the flight in control, (26) and (29); and what pilots ask.

    `tracking_rms_m` is the distance in space from the reference that the controller tracks, the hedged one if it
    hedges; `steady_error_m` the mean distance from the target at the end of a stair, of the worst one, NaN without any.
    """

    peak_error_m: float
    rms_error_m: float
    stable: bool
    tracking_rms_m: float
    steady_error_m: float


def largest_step_m(config: Config) -> float:
    """The largest horizontal change of the command."""
    places = [(0.0, 0.0), *((w.offset_ned_m[0], w.offset_ned_m[1]) for w in config.mission.waypoints)]
    return max((math.dist(a, b) for a, b in pairwise(places)), default=0.0)


def in_control(flight: Flight) -> np.ndarray:
    """The ticks of a flight while it was in control."""
    ticks: np.ndarray = flight.ticks[flight.ticks["state"] == State.ENGAGED]
    return ticks


def score(config: Config, flight: Flight) -> Metrics:
    """Metrics of one flight. Raises `ValueError` when it was never in control.

    A flight is unstable when its error has grown, see `grown`, unless wind, noise or the link did that; or when its RMS
    over the second half of the last stair of 5 s or more is above the largest step of the command. Swings below 5 cm
    are not judged.
    """
    ticks = in_control(flight)
    if not len(ticks):
        raise ValueError("the controller was never in control")
    error = ticks["position_m"] - ticks["ideal_position_m"]
    distance = np.abs(error[:, 0]) if config.vehicle_kind.one_axis else np.hypot(error[:, 0], error[:, 1])

    def rms(values: np.ndarray) -> float:
        return float(np.sqrt(np.mean(values**2)))

    swing = float(np.ptp(error, axis=0).max())
    plant = config.plant
    moving = bool(config.mission.trajectories)  # and so does the error, to the end
    disturbed = plant is not None and (plant.wind is not None or plant.sensors is not None or plant.link is not None)
    stairs = _stairs(ticks)
    first, end = next((s for s in reversed(stairs) if _lasts_s(ticks, s) >= _STAIR_S), (0, len(ticks)))
    never_settled = 0.0 < largest_step_m(config) < rms(distance[(first + end) // 2 : end])
    unstable = never_settled or (not disturbed and not moving and grown(ticks, distance))
    return Metrics(
        float(distance.max()),
        rms(distance),
        swing < _NOT_JUDGED_M or not unstable,
        rms(tracking_error_m(config, ticks)),
        _steady(ticks),
    )


def grown(ticks: np.ndarray, distance_m: np.ndarray) -> bool:
    """Whether the error has grown as that of an unstable loop does, and not as a stair makes it.

    The RMS of the error in each quarter of a stair, by the largest step of the command up to then, is set against the
    larger of the first two quarters of the first stair that lasts 5 s: the error has grown where it is more than
    `_GROWTH` times that, in the last quarter of this stair or anywhere in a later one. A stair makes it no larger than
    the first did, wherever in the flight it comes.
    """
    target = ticks["target_ned_m"][:, :2]
    before = ticks["position_ned_m"][0, :2]
    first_rms = step_m = 0.0
    stairs = _stairs(ticks)
    for stair in stairs:
        first, end = stair
        step_m = max(step_m, float(np.linalg.norm(target[first:end] - before, axis=1).max()))
        before = target[end - 1]
        nothing_commanded_yet = step_m < _MOVED_M and len(stairs) > 1
        if nothing_commanded_yet or (not first_rms and _lasts_s(ticks, stair) < _STAIR_S):
            continue
        quarters = [float(np.sqrt(np.mean(q**2))) / max(step_m, _MOVED_M) for q in _quarters(distance_m[first:end])]
        judged = quarters if first_rms else quarters[3:]
        first_rms = first_rms or max(quarters[:2])
        if max(judged) > _GROWTH * first_rms:
            return True
    return False


def _quarters(values: np.ndarray) -> list[np.ndarray]:
    return [part for part in np.array_split(values, 4) if len(part)]


def _stairs(ticks: np.ndarray) -> list[tuple[int, int]]:
    """First and last index but one of each stretch that begins with a change of the target; a trajectory is one."""
    changes = np.flatnonzero(np.any(np.diff(ticks["target_ned_m"], axis=0) != 0.0, axis=1)) + 1
    starts = [0]
    last_s = -math.inf
    for change in changes:
        if ticks["time_s"][change] - last_s > _MOVING_S:
            starts.append(int(change))
        last_s = ticks["time_s"][change]
    return list(pairwise([*starts, len(ticks)]))


def _lasts_s(ticks: np.ndarray, stair: tuple[int, int]) -> float:
    return float(ticks["time_s"][stair[1] - 1] - ticks["time_s"][stair[0]])


def tracking_error_m(config: Config, ticks: np.ndarray) -> np.ndarray:
    """Distance in space from the reference that the controller tracks, (n,) by tick; a rig has only its guide."""
    error = ticks["position_m"] - ticks["reference_position_m"]
    if config.vehicle_kind.one_axis:
        return np.asarray(np.abs(error[:, 0]))
    down = ticks["position_ned_m"][:, 2] - ticks["reference_z_m"]
    return np.asarray(np.hypot(np.hypot(error[:, 0], error[:, 1]), down))


def _steady(ticks: np.ndarray) -> float:
    """Mean distance from the target over the last seconds of a stair, m: of the worst stair."""
    time_s = ticks["time_s"]
    distance = np.linalg.norm(ticks["position_ned_m"] - ticks["target_ned_m"], axis=1)
    means = []
    for first, end in _stairs(ticks):
        if _lasts_s(ticks, (first, end)) >= _STAIR_S:
            means.append(float(distance[first:end][time_s[first:end] > time_s[end - 1] - _STEADY_S].mean()))
    return max(means, default=math.nan)
