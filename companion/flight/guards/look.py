"""What the guards look at, 50 times a second and after the set-point has gone; and what a measure of it is."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final, NamedTuple

from companion.config.base import Vector
from companion.config.schema import Config
from companion.control.position import PositionOutput
from companion.control.types import AttitudeSetpoint, Jump, Odometry
from companion.flight.guards.propagation import Disagreement

PERIOD_S: Final = 0.02  # from one look to the next


class Told(NamedTuple):
    """What the vehicle and the link last told beside the pose; not a number where it is not told any more."""

    missing_flags: float = math.nan  # of the solutions that are needed, how many the estimator does not have
    variance_ned_m2: Vector = (math.nan, math.nan, math.nan)
    resets_counted: bool = False  # whether the pose tells of the estimator's resets
    round_trip_s: float = math.nan
    jitter_s: float = math.nan
    clock_rate: float = math.nan  # seconds of the vehicle in one of ours


class Look(NamedTuple):
    """What is known at a look, in control."""

    sample: Odometry
    setpoint: AttitudeSetpoint
    told: Told
    began: Odometry  # the sample at which control began
    offset_ned_m: Vector  # from where it began, resets of the estimator counted out
    apart: Disagreement  # of position, velocity, and what attitude and thrust make of them
    steps_m: float  # of the position within a minute, in all
    stopped_s: tuple[float, ...]  # for how long each quantity has not changed, as `stuck.NAMES`
    thrust_ned: Vector  # direction of the thrust, and the one wanted: unit vectors
    wanted_thrust_ned: Vector
    poses: int  # so far that were not the one before
    output: PositionOutput  # of the controller
    hover_thrust: float  # normalised, as the controller believes it
    weights_on_bound: int
    tracking_error_m: float
    elapsed_s: float  # in control
    jumped: Jump | None  # of the estimate since the look before


Measure = Callable[[Look], float]


class Measured(NamedTuple):
    """What a guard needs beside its row: its measure, made for one flight, and where they are not the usual ones

    `limit`, in our unit, for a limit that does not stand in its section, and `blind`, whether it cannot see.
    """

    measure: Callable[[Config], Measure] | None = None
    limit: Callable[[Config], float] | None = None
    blind: Callable[[Config, Told], bool] | None = None


def stateless(measure: Measure) -> Callable[[Config], Measure]:
    """A measure that is the same for every flight."""
    return lambda _: measure
