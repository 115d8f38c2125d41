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
_STEADY_S = 3.0  # of each stair: its end
_STAIR_S = 5.0  # at least, or nothing is steady


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

    A flight is unstable when it still swings in its last quarter: by more than half of all it swung, unless wind, noise
    or the link keep it moving, or with an RMS above half the largest step of the command. Swings below 5 cm are not
    judged.
    """
    ticks = in_control(flight)
    if not len(ticks):
        raise ValueError("the controller was never in control")
    error = ticks["position_m"] - ticks["ideal_position_m"]
    distance = np.abs(error[:, 0]) if config.vehicle_kind.one_axis else np.hypot(error[:, 0], error[:, 1])

    def rms(values: np.ndarray) -> float:
        return float(np.sqrt(np.mean(values**2)))

    quarter = max(1, len(distance) // 4)
    swing, late_swing = (float(np.ptp(e, axis=0).max()) for e in (error, error[-quarter:]))
    step = largest_step_m(config)
    plant = config.plant
    moving = bool(config.mission.trajectories)  # and so does the error, to the end
    disturbed = plant is not None and (plant.wind is not None or plant.sensors is not None or plant.link is not None)
    swings_on = (late_swing > 0.5 * swing and not disturbed and not moving) or 0.0 < 0.5 * step < rms(
        distance[-quarter:]
    )
    return Metrics(
        float(distance.max()),
        rms(distance),
        swing < _NOT_JUDGED_M or not swings_on,
        rms(tracking_error_m(config, ticks)),
        _steady(ticks),
    )


def tracking_error_m(config: Config, ticks: np.ndarray) -> np.ndarray:
    """Distance in space from the reference that the controller tracks, (n,) by tick; a rig has only its guide."""
    error = ticks["position_m"] - ticks["reference_position_m"]
    if config.vehicle_kind.one_axis:
        return np.asarray(np.abs(error[:, 0]))
    down = ticks["position_ned_m"][:, 2] - ticks["reference_z_m"]
    return np.asarray(np.hypot(np.hypot(error[:, 0], error[:, 1]), down))


def _steady(ticks: np.ndarray) -> float:
    """Mean distance from the target over the last seconds of a stair, m: of the worst stair."""
    time_s, target = ticks["time_s"], ticks["target_ned_m"]
    changes = np.flatnonzero(np.any(np.diff(target, axis=0) != 0.0, axis=1)) + 1
    distance = np.linalg.norm(ticks["position_ned_m"] - target, axis=1)
    means = []
    for first, end in pairwise([0, *changes, len(ticks)]):
        last_s = time_s[end - 1]
        if last_s - time_s[first] >= _STAIR_S:
            means.append(float(distance[first:end][time_s[first:end] > last_s - _STEADY_S].mean()))
    return max(means, default=math.nan)
