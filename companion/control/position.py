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
    _, x, y, _, vx, vy, _, qw, qx, qy, qz = odometry
    north, east = x - anchor_x_m, y - anchor_y_m
    fx, fy, _ = attitude.thrust_direction(qw, qx, qy, qz)
    return Horizontal(
        c * north + s * east,
        c * vx + s * vy,
        thrust_ratio * (c * fx + s * fy),
        c * east - s * north,
        c * vy - s * vx,
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
    params_x, params_y, params_z, one_axis, hover_thrust, thrust_min, thrust_max, tilt_limit = params
    state_x, state_y, state_z, anchor_x, anchor_y, yaw, thrust_ratio = state
    now = in_control_frame(odometry, anchor_x, anchor_y, yaw, thrust_ratio)
    at_x, vx, wx, at_y, vy, wy = now
    c, s = math.cos(yaw), math.sin(yaw)
    command_x, command_y, command_z, command_yaw = command
    north, east = command_x - anchor_x, command_y - anchor_y
    x, out_x = mrac.step(params_x, state_x, at_x, vx, wx, c * north + s * east, dt_s)
    if one_axis:
        y, out_y, z, up = state_y, mrac.AxisOutput(0.0, 0.0, 0.0, 0.0), state_z, 1.0
    else:
        y, out_y = mrac.step(params_y, state_y, at_y, vy, wy, c * east - s * north, dt_s)
        z, up = altitude.step(params_z, state_z, odometry.z_m, odometry.vz_m_s, command_z, dt_s)
    up_limited = min(max(up, thrust_min / hover_thrust), thrust_max / hover_thrust)

    along, across = out_x.control, out_y.control
    wanted = math.sqrt(along * along + across * across)
    reach = math.sin(tilt_limit) if one_axis else up_limited * math.tan(tilt_limit)
    scale = 1.0 if wanted <= reach else reach / wanted
    along, across = scale * along, scale * across
    force_z = -math.sqrt(1.0 - along * along) if one_axis else -up_limited
    qw, qx, qy, qz, force = attitude.extract(c * along - s * across, s * along + c * across, force_z, command_yaw)
    thrust = min(force * hover_thrust, thrust_max)
    limited = scale < 1.0 or up != up_limited or thrust < force * hover_thrust
    return (
        PositionState(x, y, z, anchor_x, anchor_y, yaw, thrust / hover_thrust),
        PositionOutput(AttitudeSetpoint(qw, qx, qy, qz, thrust), now, out_x, out_y, limited),
    )
