"""The whole position controller: odometry and command in, attitude set-point out.

The control frame is NED moved to the anchor and turned by the yaw set-point, so that its x is pitch and its y is roll.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from companion.control import altitude, attitude, mrac
from companion.control.types import AttitudeSetpoint, Command, Odometry


class PositionParams(NamedTuple):
    """Both axes, the altitude cascade, and what the vehicle can do."""

    x: mrac.AxisParams
    y: mrac.AxisParams
    altitude: altitude.AltitudeParams
    one_axis: bool  # a rig on guides: x only, and the thrust stays at hover, as under (28)
    hover_thrust: float
    thrust_min: float
    thrust_max: float
    tilt_limit_rad: float


class PositionState(NamedTuple):
    """Everything that one tick leaves to the next."""

    x: mrac.AxisState
    y: mrac.AxisState
    altitude: altitude.AltitudeState
    anchor_x_m: float
    anchor_y_m: float
    yaw_rad: float  # of the control frame
    thrust_ratio: float  # commanded thrust over hover


class Horizontal(NamedTuple):
    """One instant in the control frame: position, velocity and actuator output (specific force over g) of both axes."""

    x_m: float
    vx_m_s: float
    wx: float
    y_m: float
    vy_m_s: float
    wy: float


class PositionOutput(NamedTuple):
    """The set-point, what was measured, and what each axis thought of it."""

    setpoint: AttitudeSetpoint
    measured: Horizontal
    x: mrac.AxisOutput
    y: mrac.AxisOutput
    limited: bool  # the tilt or the thrust limit cut the command


def in_control_frame(
    odometry: Odometry, anchor_x_m: float, anchor_y_m: float, yaw_rad: float, thrust_ratio: float
) -> Horizontal:
    """Measured position, velocity and w of (15): the thrust direction scaled by the thrust commanded."""
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    north, east = odometry.x_m - anchor_x_m, odometry.y_m - anchor_y_m
    fx, fy, _ = attitude.thrust_direction(odometry.qw, odometry.qx, odometry.qy, odometry.qz)
    return Horizontal(
        c * north + s * east,
        c * odometry.vx_m_s + s * odometry.vy_m_s,
        thrust_ratio * (c * fx + s * fy),
        c * east - s * north,
        c * odometry.vy_m_s - s * odometry.vx_m_s,
        thrust_ratio * (c * fy - s * fx),
    )


def engage(
    odometry: Odometry,
    yaw_rad: float,
    weights_x: tuple[float, float],
    weights_y: tuple[float, float],
) -> PositionState:
    """A bumpless start: anchor, references and integrators on the vehicle; weights are (position, velocity)."""
    now = in_control_frame(odometry, odometry.x_m, odometry.y_m, yaw_rad, 1.0)
    return PositionState(
        mrac.start(now.x_m, now.vx_m_s, weights_x[0], weights_x[1], now.wx),
        mrac.start(now.y_m, now.vy_m_s, weights_y[0], weights_y[1], now.wy),
        altitude.start(odometry.vz_m_s),
        odometry.x_m,
        odometry.y_m,
        yaw_rad,
        1.0,
    )


def step(
    params: PositionParams, state: PositionState, odometry: Odometry, command: Command, dt_s: float
) -> tuple[PositionState, PositionOutput]:
    """One tick of the position loop: (4) and (19)-(22) for the force, (5)-(6) for the attitude that makes it."""
    now = in_control_frame(odometry, state.anchor_x_m, state.anchor_y_m, state.yaw_rad, state.thrust_ratio)
    c, s = math.cos(state.yaw_rad), math.sin(state.yaw_rad)
    north, east = command.x_m - state.anchor_x_m, command.y_m - state.anchor_y_m
    x, out_x = mrac.step(params.x, state.x, now.x_m, now.vx_m_s, now.wx, c * north + s * east, dt_s)
    if params.one_axis:
        y, out_y, vertical, up = state.y, mrac.AxisOutput(0.0, 0.0, 0.0, 0.0), state.altitude, 1.0
    else:
        y, out_y = mrac.step(params.y, state.y, now.y_m, now.vy_m_s, now.wy, c * east - s * north, dt_s)
        vertical, up = altitude.step(params.altitude, state.altitude, odometry.z_m, odometry.vz_m_s, command.z_m, dt_s)
    up_limited = min(max(up, params.thrust_min / params.hover_thrust), params.thrust_max / params.hover_thrust)

    along, across = out_x.control, out_y.control
    wanted = math.sqrt(along * along + across * across)
    reach = math.sin(params.tilt_limit_rad) if params.one_axis else up_limited * math.tan(params.tilt_limit_rad)
    scale = 1.0 if wanted <= reach else reach / wanted
    along, across = scale * along, scale * across
    force_z = -math.sqrt(1.0 - along * along) if params.one_axis else -up_limited
    wanted_attitude = attitude.extract(c * along - s * across, s * along + c * across, force_z, command.yaw_rad)
    thrust = min(wanted_attitude.thrust * params.hover_thrust, params.thrust_max)
    setpoint = AttitudeSetpoint(wanted_attitude.qw, wanted_attitude.qx, wanted_attitude.qy, wanted_attitude.qz, thrust)
    limited = scale < 1.0 or up != up_limited
    next_state = PositionState(
        x, y, vertical, state.anchor_x_m, state.anchor_y_m, state.yaw_rad, thrust / params.hover_thrust
    )
    return next_state, PositionOutput(setpoint, now, out_x, out_y, limited)
