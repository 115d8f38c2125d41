"""The controller in the loop: mission and position controller from take-over to release, and the record of a tick."""

from __future__ import annotations

import math
from typing import Final

from companion.config.guards.rows import Reason
from companion.config.reach import amplitude_deg
from companion.config.schema import Config
from companion.control import attitude, estimate_correction, mrac, position
from companion.control.types import (
    GRAVITY_M_S2,
    AttitudeSetpoint,
    Jump,
    Odometry,
    PositionSetpoint,
    Reference,
)
from companion.flight.pilot.controller_params import (
    HOVER_RANGE,
    correction_params,
    hover_params,
    initial_weights,
    lead_params,
    position_params,
)
from companion.flight.pilot.doublets import Manoeuvre
from companion.flight.pilot.mission import mission_of, stream_of
from companion.record.schema import CDR_HEADER, CONTROL_FLOATS, pack_tick
from companion.trajectory.sample import Sample
from companion.trajectory.trajectory import rest

_NOT_IN_CONTROL = (math.nan,) * sum(field.size for field in CONTROL_FLOATS)

_TRIM_S: Final = 2.0  # over which it is averaged
_SAME_LIFT: Final = 0.02  # PX4 moves the thrust by as much to stay where it is


class Pilot:
    """Flies the mission of a config from wherever `take_over` finds the vehicle.

    Attributes: `elapsed_s` in control; `origin`, where control began; `target`, where the mission or a live command
    wants the vehicle; `last`, what the controller made of the last tick; `manoeuvre`, flown in place of a mission;
    `stream`, the trajectory of a planner, None where nobody may stream.
    """

    def __init__(self, config: Config, *, hedging: bool) -> None:
        self._config = config
        self._params = position_params(config, hedging=hedging)
        self._weights = (initial_weights(config, self._params.x), initial_weights(config, self._params.y))
        self._mission = mission_of(config)
        self.stream = stream_of(config)
        if config.mission.trajectories or self.stream is not None:
            self._params = self._params._replace(lead=lead_params(config))
        flown = config.mission.identification
        self._trim = (0.0, 0.0)  # of the pauses: what a doublet stands on does not move with the adaptation
        self.manoeuvre: Manoeuvre | None = None
        if flown is not None:
            amplitude = amplitude_deg(config.controller, config.guards.fence, flown)
            self.manoeuvre = Manoeuvre(flown, amplitude, one_axis=config.vehicle_kind.one_axis)
        self._correction_params = correction_params(config)
        self._correction: estimate_correction.CorrectionState | None = None  # while in control
        self._control: position.PositionState | None = None
        self._steered = self._streamed = False
        self._reference: Reference | None = None  # of the last tick
        self._hover = config.vehicle.hover_thrust
        self._lift = 1.0  # what it hovers at over that
        self._sample: Odometry | None = None  # of the last tick, or at which control began
        self._since_s = 0.0
        self.origin = self.target = PositionSetpoint(0.0, 0.0, 0.0, 0.0)
        self.last: position.PositionOutput | None = None
        self.elapsed_s = 0.0

    def believe_hover_thrust(self, hover_thrust: float | None) -> None:
        """The autopilot's own (MPC_THR_HOVER), for stand-by and take-over."""
        limits = self._params.limits
        if (
            hover_thrust is not None
            and self._config.vehicle.hover_thrust_source != "config"
            and limits.thrust_min < hover_thrust < limits.thrust_max
        ):
            self._hover = hover_thrust

    def believe_hovering(self, thrust: float | None) -> None:
        """What the vehicle hovers at before control begins, from what it flies; None where that is not known."""
        lift = 1.0 if thrust is None else min(max(thrust / self._hover, 1.0 / HOVER_RANGE), HOVER_RANGE)
        self._lift = 1.0 if abs(lift - 1.0) < _SAME_LIFT else lift

    @property
    def standby_thrust(self) -> float:
        """What to stream in stand-by: what it hovers at, or else what is believed to be that, within the limits."""
        limits = self._params.limits
        return min(max(self._hover * self._lift, limits.thrust_min), limits.thrust_max)

    def take_over(self, sample: Odometry) -> None:
        """A bumpless start: references, anchor and mission begin where the vehicle is, thrust where it hovers.

        An estimated hover thrust begins there too. One that is given stays, and the altitude's integrator makes up the
        difference, as far as it may.
        """
        hover, lift = self._hover, self._lift
        if self._config.vehicle.hover_thrust_source == "estimated":
            hover, lift = self.standby_thrust, 1.0
        most = self._params.altitude.integral_limit_m_s2 / GRAVITY_M_S2
        lift = min(max(lift, 1.0 - most), 1.0 + most)
        self._params = self._params._replace(hover=hover_params(self._config, hover))
        yaw = attitude.yaw(sample.qw, sample.qx, sample.qy, sample.qz)
        self.origin = self.target = PositionSetpoint(sample.x_m, sample.y_m, sample.z_m, yaw)
        self._mission.begin(self.origin)
        self._steered = self._streamed = False
        self._reference = None
        if self.stream is not None:
            self.stream.forget()
        self._since_s = sample.time_s
        self._sample = sample
        self._correction = None if self._correction_params is None else estimate_correction.start(sample)
        self._control = position.engage(self._params, sample, yaw, *self._weights, hover, lift)

    def steer(self, target: PositionSetpoint) -> None:
        """Fly to a target in local NED from now on, in place of the mission; yaw NaN keeps the heading wanted."""
        self._steered, self._streamed = True, False
        if self.stream is not None:
            self.stream.forget()
        self.target = target._replace(yaw_rad=self.target.yaw_rad) if math.isnan(target.yaw_rad) else target

    def follow(self, sample: Sample, heard_s: float) -> str | None:
        """Fly along a planner's stream, of which this was heard then, by the vehicle's clock; or why not."""
        if self.stream is None or self._sample is None or self._control is None:
            return "a stream needs anchor: setpoint"
        flown = rest(self._control.flown) if self._reference is None else self._reference
        refused = self.stream.take(sample, heard_s, flown, self._sample.time_s)
        if refused is None:
            self._steered = self._streamed = True
        return refused

    def reseat(self, jump: Jump) -> None:
        """The estimate jumped by so much and the vehicle did not: go on as if nothing had happened.

        To be called before the first sample after the jump. Mission and target jump along, so that the vehicle stays
        where it is and attitude and thrust do not step; what a velocity or a heading changes is washed out in a second.
        """
        assert self._control is not None  # take_over comes first
        if self._correction_params is not None and self._correction is not None:
            self._correction, jump = estimate_correction.reseat(self._correction_params, self._correction, jump)
        self._control = position.reseat(self._control, jump)
        self.origin, self.target = _moved(self.origin, jump), _moved(self.target, jump)
        if self._streamed and self.stream is not None and self._sample is not None:
            by = PositionSetpoint(jump.x_m, jump.y_m, jump.z_m, jump.yaw_rad)
            self._reference = self.stream.end(self._sample.time_s, "the estimator reset", by)

    def step(self, sample: Odometry, dt_s: float) -> AttitudeSetpoint:
        """One tick in control."""
        assert self._control is not None  # take_over comes first
        self.elapsed_s = sample[0] - self._since_s
        reference = None
        if not self._steered:
            self.target, reference = self._mission.wanted(self.elapsed_s, self.origin)
        elif self._streamed and self.stream is not None:
            reference = self.stream.at(sample[0])
            self.target = PositionSetpoint(reference[0], reference[1], reference[2], reference[15])
        self._reference = reference
        if self._correction_params is not None and self._correction is not None:
            self._correction, sample = estimate_correction.step(self._correction_params, self._correction, sample, dt_s)
        self._control, self.last = position.step(self._params, self._control, sample, self.target, dt_s, reference)
        self._sample = sample
        return self.last[0] if self.manoeuvre is None else self._excite(self.manoeuvre, sample, dt_s)

    def _excite(self, manoeuvre: Manoeuvre, sample: Odometry, dt_s: float) -> AttitudeSetpoint:
        """The controller's set-point, or in its place that of a doublet; the controller knows what was flown."""
        assert self._control is not None
        assert self.last is not None
        distance = math.hypot(sample.x_m - self.target.x_m, sample.y_m - self.target.y_m)
        offset = manoeuvre.offset(self.elapsed_s, distance, math.hypot(sample.vx_m_s, sample.vy_m_s))
        if offset is None:
            x, y = self._trim
            share = min(dt_s / _TRIM_S, 1.0)
            self._trim = (
                x - share * (self._control.x.bias_weight + x),
                y - share * (self._control.y.bias_weight + y),
            )
            return self.last.setpoint
        self._control, setpoint = position.lean(self._params, self._control, self._trim, *offset)
        self.last = self.last._replace(setpoint=setpoint)
        return setpoint

    @property
    def error_m(self) -> float:
        """Horizontal distance from the ideal reference, (26) or (29)."""
        if self.last is None or self._control is None:
            return 0.0
        at, x, y = self.last.measured, self._control.x, self._control.y
        return math.hypot(at.x_m - x.ideal_position_m, 0.0 if self._params.one_axis else at.y_m - y.ideal_position_m)

    @property
    def mission_over(self) -> bool:
        """Whether the mission's time is up."""
        if self.manoeuvre is not None:
            return self.manoeuvre.over
        return self._mission.over(self.elapsed_s)

    @property
    def ending(self) -> Reason:
        """What the mission's end is called."""
        gave_up = self.manoeuvre is not None and self.manoeuvre.gave_up
        return Reason.NOT_CALM if gave_up else Reason.MISSION_COMPLETE

    @property
    def tracking_error_m(self) -> float:
        """Distance from the reference that the controller tracks, in space: the hedged one when it hedges."""
        if self.last is None or self._control is None or self._sample is None:
            return 0.0
        x_m, y_m = self.last.x.error_position_m, self.last.y.error_position_m
        if self._params.one_axis:
            return abs(x_m)
        z_m = self._sample.z_m - self._control.altitude.reference_z_m
        return math.sqrt(x_m * x_m + y_m * y_m + z_m * z_m)

    @property
    def weights_on_bound(self) -> int:
        """How many of the weights rest on a bound of their projection."""
        if self._control is None:
            return 0
        axes = ((self._params.x, self._control.x), (self._params.y, self._control.y))
        return sum(mrac.on_bound(params, state) for params, state in axes[: 1 if self._params.one_axis else 2])

    @property
    def hover_thrust(self) -> float:
        """The normalised thrust taken for the one that carries the weight."""
        return self._hover if self._control is None else self._control.hover.hover_thrust

    def record(self, sample: Odometry, dt_s: float, setpoint: AttitudeSetpoint, latency_s: float, state: int) -> bytes:
        """The tick just flown, as `companion.record.schema` has it."""
        assert self._control is not None
        assert self.last is not None
        x, y, altitude, hover, anchor_x, anchor_y, flown, _, _, _, _ = self._control
        _, (at_x, vx, _, at_y, vy, _), (_, _, _, deficit_x), (_, _, _, deficit_y), limited, thrust_limited = self.last
        ideal_x, ideal_vx, reference_x, reference_vx, weight_x, weight_vx, command_x, u_x, w_x, bias_x = x
        ideal_y, ideal_vy, reference_y, reference_vy, weight_y, weight_vy, command_y, u_y, w_y, bias_y = y
        return pack_tick(
            CDR_HEADER, sample[0], dt_s, *sample[1:], *self.target, *flown, anchor_x, anchor_y,
            at_x, at_y, vx, vy, command_x, command_y, ideal_x, ideal_y, ideal_vx, ideal_vy,
            reference_x, reference_y, reference_vx, reference_vy,
            weight_x, weight_y, weight_vx, weight_vy, bias_x, bias_y, u_x, u_y, w_x, w_y, deficit_x, deficit_y,
            altitude.reference_z_m, hover[0],
            *setpoint, latency_s, state, limited, thrust_limited,
        )  # fmt: skip


def record_standby(sample: Odometry, dt_s: float, setpoint: AttitudeSetpoint, latency_s: float, state: int) -> bytes:
    """A tick out of control: what was measured and sent, NaN for the rest."""
    return pack_tick(
        CDR_HEADER, sample.time_s, dt_s, *sample[1:], *_NOT_IN_CONTROL, *setpoint, latency_s, state, False, False
    )


def _moved(command: PositionSetpoint, jump: Jump) -> PositionSetpoint:
    x, y, z, yaw = command
    return PositionSetpoint(x + jump.x_m, y + jump.y_m, z + jump.z_m, yaw + jump.yaw_rad)
