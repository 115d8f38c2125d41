"""The controller in the loop: mission and position controller from take-over to release, and the record of a tick."""

from __future__ import annotations

import math

from companion.config.schema import Config
from companion.control import attitude, position
from companion.control.types import AttitudeSetpoint, Command, Odometry
from companion.flight.mission import Mission
from companion.flight.setup import initial_weights, position_params
from companion.record.schema import CDR_HEADER, CONTROL_FLOATS, pack_tick

_NOT_IN_CONTROL = (math.nan,) * sum(field.size for field in CONTROL_FLOATS)


class Pilot:
    """Flies the mission of a config from wherever `take_over` finds the vehicle.

    Attributes: `elapsed_s` in control; `error_m`, horizontal distance from the ideal reference, (26) or (29).
    """

    def __init__(self, config: Config, *, hedging: bool) -> None:
        self._params = position_params(config, hedging=hedging)
        self._weights = (initial_weights(config, self._params.x), initial_weights(config, self._params.y))
        self._mission = Mission(config.mission)
        self._control: position.PositionState | None = None
        self._command = self._origin = Command(0.0, 0.0, 0.0, 0.0)
        self._out: position.PositionOutput | None = None
        self._since_s = 0.0
        self.elapsed_s = 0.0
        self.error_m = 0.0

    def take_over(self, sample: Odometry) -> None:
        """A bumpless start: references, anchor and mission begin where the vehicle is."""
        yaw = attitude.yaw(sample.qw, sample.qx, sample.qy, sample.qz)
        self._origin = Command(sample.x_m, sample.y_m, sample.z_m, yaw)
        self._since_s = sample.time_s
        self._control = position.engage(sample, yaw, *self._weights)

    def step(self, sample: Odometry, dt_s: float) -> AttitudeSetpoint:
        """One tick in control."""
        assert self._control is not None  # take_over comes first
        self.elapsed_s = sample.time_s - self._since_s
        self._command = self._mission.command(self.elapsed_s, self._origin)
        self._control, out = position.step(self._params, self._control, sample, self._command, dt_s)
        self._out = out
        x_m = out.measured.x_m - self._control.x.ideal_position_m
        y_m = 0.0 if self._params.one_axis else out.measured.y_m - self._control.y.ideal_position_m
        self.error_m = math.hypot(x_m, y_m)
        return out.setpoint

    @property
    def mission_over(self) -> bool:
        """Whether the mission's time is up."""
        return self._mission.over(self.elapsed_s)

    def record(self, sample: Odometry, dt_s: float, setpoint: AttitudeSetpoint, latency_s: float, state: int) -> bytes:
        """The tick just flown, as `companion.record.schema` has it."""
        assert self._control is not None
        assert self._out is not None
        x, y, at, out = self._control.x, self._control.y, self._out.measured, self._out
        return pack_tick(
            CDR_HEADER, sample.time_s, dt_s, *sample[1:], *self._command,
            at.x_m, at.y_m, at.vx_m_s, at.vy_m_s, x.command_m, y.command_m,
            x.ideal_position_m, y.ideal_position_m, x.ideal_velocity_m_s, y.ideal_velocity_m_s,
            x.reference_position_m, y.reference_position_m, x.reference_velocity_m_s, y.reference_velocity_m_s,
            x.position_weight, y.position_weight, x.velocity_weight, y.velocity_weight,
            x.control, y.control, x.actuator, y.actuator, out.x.deficit, out.y.deficit,
            *setpoint, latency_s, state, out.limited,
        )  # fmt: skip


def record_standby(sample: Odometry, dt_s: float, setpoint: AttitudeSetpoint, latency_s: float, state: int) -> bytes:
    """A tick out of control: what was measured and sent, NaN for the rest."""
    return pack_tick(CDR_HEADER, sample.time_s, dt_s, *sample[1:], *_NOT_IN_CONTROL, *setpoint, latency_s, state, False)
