"""Peak and RMS of (26) and (29), and whether the flight was stable."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from companion.config import Config
from companion.flight.authority import State
from companion.record.reader import Flight

_NOT_JUDGED_M = 0.05


class Metrics(NamedTuple):
    """Error against the ideal reference over the whole of the flight in control."""

    peak_error_m: float
    rms_error_m: float
    stable: bool


def largest_step_m(config: Config) -> float:
    """The largest horizontal change of the command."""
    places = [(0.0, 0.0), *((w.offset_ned_m[0], w.offset_ned_m[1]) for w in config.mission.waypoints)]
    return max((math.dist(a, b) for a, b in pairwise(places)), default=0.0)


def score(config: Config, flight: Flight) -> Metrics:
    """Metrics of one flight. Raises `ValueError` when it was never in control.

    A flight is unstable when it still swings in its last quarter: by more than half of all it swung, or with an RMS
    above half the largest step of the command. Swings below 5 cm are not judged.
    """
    ticks = flight.ticks[flight.ticks["state"] == State.ENGAGED]
    if not len(ticks):
        raise ValueError("the controller was never in control")
    error = ticks["position_m"] - ticks["ideal_position_m"]
    distance = np.abs(error[:, 0]) if config.vehicle.kind == "rig" else np.hypot(error[:, 0], error[:, 1])

    def rms(values: np.ndarray) -> float:
        return float(np.sqrt(np.mean(values**2)))

    quarter = max(1, len(distance) // 4)
    swing, late_swing = (float(np.ptp(e, axis=0).max()) for e in (error, error[-quarter:]))
    step = largest_step_m(config)
    swings_on = late_swing > 0.5 * swing or 0.0 < 0.5 * step < rms(distance[-quarter:])
    return Metrics(float(distance.max()), rms(distance), swing < _NOT_JUDGED_M or not swings_on)
