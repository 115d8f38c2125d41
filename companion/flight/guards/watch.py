"""The guards of a flight that are watched together, 50 times a second and after the set-point has gone."""

from __future__ import annotations

import math
from typing import Final

from companion.config.guards.rows import GUARDS, Reason
from companion.config.schema import Config
from companion.control import attitude
from companion.control.types import AttitudeSetpoint, Jump, Odometry
from companion.flight.guards import propagation, stuck
from companion.flight.guards import table as guards
from companion.flight.guards.estimator import Steps, length_m
from companion.flight.guards.look import PERIOD_S, Look, Measure, Told
from companion.flight.guards.measures import MEASURES
from companion.flight.guards.propagation import Propagation
from companion.flight.guards.stuck import Stopped
from companion.flight.guards.table import CLEAR, WATCHED, Limits
from companion.flight.pilot.pilot import Pilot

_UNSEEN: Final = (math.nan,) * len(WATCHED)


class Watch:
    """From take-over to release.

    Attributes: `due_s`, when to look next; `alarmed`, whether a guard is past its limit; `last`, what was seen at the
    last look, in the order of `WATCHED`.
    """

    def __init__(self, config: Config, limits: Limits) -> None:
        self._limits = guards.watch_limits(config, limits)
        self._measures = tuple(_made(reason, config) for reason in WATCHED)
        self._began: Odometry | None = None
        self._origin_ned_m = (0.0, 0.0, 0.0)
        self._jumped: Jump | None = None
        self._propagation: Propagation | None = None
        self._stopped: Stopped | None = None
        self._steps = Steps()
        self._past_s: tuple[float, ...] = CLEAR
        self._looked_s = 0.0
        self.due_s = 0.0
        self.last = _UNSEEN

    @property
    def alarmed(self) -> bool:
        """Whether a guard is past its limit, its timeout running."""
        return self._past_s is not CLEAR

    def begin(self, sample: Odometry) -> None:
        """Control begins at this sample. It does so once."""
        self._began = sample
        self._origin_ned_m = (sample.x_m, sample.y_m, sample.z_m)
        self.due_s = self._looked_s = sample.time_s

    def reseat(self, jump: Jump, time_s: float) -> None:
        """The estimator counted a reset, and this is what it did."""
        self._steps.count(time_s, length_m(jump))
        x, y, z = self._origin_ned_m
        self._origin_ned_m = (x + jump.x_m, y + jump.y_m, z + jump.z_m)
        before = self._jumped
        self._jumped = jump if before is None else Jump(*(a + b for a, b in zip(before, jump, strict=True)))

    def look(self, sample: Odometry, setpoint: AttitudeSetpoint, pilot: Pilot, told: Told, poses: int) -> Reason | None:
        """The first guard that has had enough, or None. `poses` so far that were not the one before."""
        time_s, x, y, z, _, _, _, qw, qx, qy, qz = sample
        self.due_s = time_s + PERIOD_S
        assert self._began is not None  # begin comes first
        assert pilot.last is not None
        origin_x, origin_y, origin_z = self._origin_ned_m
        wanted_qw, wanted_qx, wanted_qy, wanted_qz, thrust = setpoint
        thrust_ned = attitude.thrust_direction(qw, qx, qy, qz)
        wanted_ned = attitude.thrust_direction(wanted_qw, wanted_qx, wanted_qy, wanted_qz)
        accelerates = propagation.acceleration(thrust_ned, thrust, pilot.hover_thrust)
        before = self._propagation or propagation.start(self._began, accelerates)
        self._propagation, apart = propagation.step(before, sample, accelerates, self._jumped)
        stopped, reset = self._stopped or stuck.start(self._began, wanted_ned), self._jumped is not None
        self._stopped = stuck.step(stopped, sample, wanted_ned, reset=reset)
        if apart.step_m:
            self._steps.add(time_s, apart.step_m)
        look = Look(
            sample,
            setpoint,
            told,
            self._began,
            (x - origin_x, y - origin_y, z - origin_z),
            apart,
            self._steps.total_m(time_s),
            self._stopped.for_s,
            thrust_ned,
            wanted_ned,
            poses,
            pilot.last,
            pilot.hover_thrust,
            pilot.weights_on_bound,
            pilot.tracking_error_m,
            pilot.elapsed_s,
            self._jumped,
        )
        self._jumped = None
        self.last = watched = tuple([measure(look) for measure in self._measures])
        passed_s, self._looked_s = time_s - self._looked_s, time_s
        self._past_s, reason = guards.watch(self._limits, self._past_s, watched, passed_s)
        return reason

    def describe(self, reason: Reason) -> str:
        """What a reason means, with the number that led to it."""
        if reason not in WATCHED:
            return reason.meaning
        place, row = WATCHED.index(reason), GUARDS[reason].row
        unit = -row.scale if row.least else row.scale
        value, limit = self.last[place] / unit, self._limits.limits[place] / unit
        if math.isinf(value):
            return f"{reason.meaning}; it is not told any more"
        return f"{reason.meaning}; it was {value:.3g}, the limit {limit:.3g}"


def _made(reason: Reason, config: Config) -> Measure:
    """The measure of a guard; the other way round where the limit is a least value."""
    make = MEASURES[reason].measure
    assert make is not None
    measure = make(config)
    return (lambda look: -measure(look)) if GUARDS[reason].row.least else measure
