"""The guards of a flight, 50 times a second and after the set-point has gone: what they look at, gathered.

Everything here is in the vehicle's own time, so that a pause of ours is not taken for one of the vehicle's.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Final

from companion.config.schema import Config
from companion.control import attitude
from companion.control.types import AttitudeSetpoint, Jump, Odometry, PositionSetpoint
from companion.flight.authority.reasons import MEANING, Reason
from companion.flight.guards import estimator
from companion.flight.guards import table as guards
from companion.flight.guards.attitude_response import ResponseBand
from companion.flight.guards.table import CLEAR, Limits, Watched
from companion.flight.pilot.pilot import Pilot
from companion.flight.vehicle_link import live_command as steer
from companion.flight.vehicle_link.link_delay import LinkDelay
from companion.flight.vehicle_link.odometry import PoseSource

PERIOD_S: Final = 0.02
_SATURATION_S: Final = 1.0  # over which its share is taken
_LIFT_S: Final = 1.0  # and the average of the thrust
_RATE_WINDOW: Final = 26  # looks, half a second
_CALM: Final = Watched()


class Watch:
    """From take-over to release.

    Attributes: `due_s`, when to look next; `alarmed`, whether a guard is above its limit; `missing_flags` of the
    estimator as last told, NaN until then; `known_blind`, the guards that could not see at stand-by, as the pilot was
    told, and cannot yet; `last`, what was seen at the last look.
    """

    def __init__(self, config: Config, limits: Limits, pose: PoseSource, delay: LinkDelay) -> None:
        self._limits = limits
        self._fence = config.guards.fence
        self._position_m = config.controller.envelope.position_m
        self._velocity_m_s = config.controller.envelope.velocity_m_s
        self._one_axis = config.vehicle_kind.one_axis
        self._pose = pose
        self._delay = delay
        self._response = ResponseBand(config.attitude.x, config.attitude.y)
        self._origin = PositionSetpoint(0.0, 0.0, 0.0, 0.0)
        self._drift: estimator.Consistency | None = None
        self._jumped: Jump | None = None
        self._since_s: tuple[float, ...] = CLEAR
        self._seen: deque[tuple[float, int]] = deque(maxlen=_RATE_WINDOW)
        self._saturated = 0.0
        self._lift = 1.0  # vertical thrust over hover thrust, on average
        self.due_s = 0.0
        self.missing_flags = math.nan
        self.known_blind: set[Reason] = set()
        self.last = _CALM

    @property
    def alarmed(self) -> bool:
        """Whether a guard is above its limit, its timeout running."""
        return self._since_s is not CLEAR

    def begin(self, sample: Odometry) -> None:
        """Control begins at this sample."""
        self._origin = PositionSetpoint(sample.x_m, sample.y_m, sample.z_m, 0.0)
        self._drift = estimator.Consistency(sample)
        self._response.begin()
        self._lift = 1.0
        self._since_s, self.last = CLEAR, _CALM
        self._seen.clear()
        self.due_s = sample.time_s

    def reseat(self, jump: Jump) -> None:
        """The estimator counted a reset, and this is what it did."""
        x, y, z, _ = self._origin
        self._origin = PositionSetpoint(x + jump.x_m, y + jump.y_m, z + jump.z_m, 0.0)
        before = self._jumped
        self._jumped = jump if before is None else Jump(*(a + b for a, b in zip(before, jump, strict=True)))

    def look(
        self, sample: Odometry, setpoint: AttitudeSetpoint, pilot: Pilot, ticks: int, lag_s: float
    ) -> Reason | None:
        """The first guard that has had enough, or None. `ticks` flown so far; `lag_s`, now less the sample's time."""
        time_s = sample.time_s
        self.due_s = time_s + PERIOD_S
        self.last = watched = self._measure(sample, setpoint, pilot, ticks, lag_s)
        self._since_s, reason = guards.watch(self._limits, self._since_s, watched, time_s)
        return reason

    def _measure(self, sample: Odometry, setpoint: AttitudeSetpoint, pilot: Pilot, ticks: int, lag_s: float) -> Watched:
        time_s, x, y, z, _, _, _, qw, qx, qy, qz = sample
        north, east, down = attitude.thrust_direction(qw, qx, qy, qz)
        qw, qx, qy, qz, thrust = setpoint
        wanted_n, wanted_e, wanted_d = attitude.thrust_direction(qw, qx, qy, qz)
        cosine = north * wanted_n + east * wanted_e + down * wanted_d
        outside_rad = self._response.advance(time_s, attitude.yaw(qw, qx, qy, qz), (north, east), (wanted_n, wanted_e))
        drift_m = math.nan
        if self._drift is not None:
            self._drift, drift_m = estimator.consistency(self._drift, sample, self._jumped)
            self._jumped = None
        self._delay.heard(time_s, time_s + lag_s)
        fenced = math.nan
        if self._fence.enabled:
            fenced = float(steer.outside(PositionSetpoint(x, y, z, 0.0), self._fence, self._origin) is not None)
        self._lift += (-down * thrust / pilot.hover_thrust - self._lift) * PERIOD_S / _LIFT_S
        last = pilot.last
        used = math.nan
        if last is not None:
            self._saturated += (last.thrust_limited - self._saturated) * PERIOD_S / _SATURATION_S
            at_x, vx, _, at_y, vy, _ = last.measured
            if self._one_axis:
                at_y = vy = 0.0
            used = max(
                max(abs(at_x), abs(at_y)) / self._position_m,
                max(abs(vx), abs(vy)) / self._velocity_m_s,
            )
        self._seen.append((time_s, ticks))
        first_s, first = self._seen[0]
        variances = [variance for variance in self._pose.variance_ned_m2 if not math.isnan(variance)]
        return Watched(
            max(variances) if variances else math.nan,
            self.missing_flags,
            drift_m,
            fenced,
            math.acos(min(max(-down, -1.0), 1.0)),
            outside_rad,
            math.acos(min(max(cosine, -1.0), 1.0)),
            abs(self._lift - 1.0),
            self._saturated,
            pilot.weights_on_bound,
            pilot.tracking_error_m,
            used,
            self._delay.round_trip_s,
            self._delay.jitter_s,
            (time_s - first_s) / (ticks - first) if len(self._seen) == _RATE_WINDOW and ticks > first else math.nan,
            pilot.elapsed_s,
        )

    def blind(self) -> dict[Reason, str]:
        """Guards that are on and cannot see: what they look at is not told, or is not modelled."""
        limits = self._limits.watched
        cannot = {}
        if limits.estimator_flags < math.inf and math.isnan(self.missing_flags):
            cannot[Reason.ESTIMATOR_FLAGS] = "estimator_flags (no ESTIMATOR_STATUS)"
        if limits.position_variance_m2 < math.inf and any(map(math.isnan, self._pose.variance_ned_m2)):
            cannot[Reason.POSITION_VARIANCE] = "position_variance_m2 (not in the odometry)"
        if self._limits.estimator_jump_m < math.inf and self._pose.message != "ODOMETRY":
            cannot[Reason.ESTIMATOR_JUMP] = "estimator_jump_m (resets are counted in ODOMETRY alone)"
        if limits.link_delay_s < math.inf and math.isnan(self._delay.round_trip_s):
            cannot[Reason.LINK_DELAY] = "link_delay_s (no answer to TIMESYNC)"
        if limits.attitude_response_rad < math.inf and len(self._response.watched) < (1 if self._one_axis else 2):
            cannot[Reason.ATTITUDE_RESPONSE] = "attitude_response_deg (a transfer function)"
        return cannot

    def describe(self, reason: Reason) -> str:
        """What a reason means, with the number that led to it."""
        for of, key, scale in guards.GUARDS:
            if of is reason:
                place = guards.GUARDS.index((of, key, scale))
                value, limit = self.last[place], self._limits.watched[place]
                if reason is Reason.POSE_RATE:
                    value, limit = 1.0 / value, 1.0 / limit
                return f"{MEANING[reason]}; it was {value / scale:.3g}, the limit {limit / scale:.3g}"
        return MEANING[reason]
