"""PX4's own position controller, as it flies position set-points: the rival. A pure step over flat records.

P on position, PID on velocity, acceleration to thrust vector, with PX4's limits and anti-windup. Written from the
published block diagram (docs.px4.io, "Controller Diagrams", multicopter position controller) and the descriptions of
its parameters; gains are the defaults of PX4 v1.17.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from companion.control.types import GRAVITY_M_S2

_LOWEST_COSINE: Final = 1e-3


class PositionControlParams(NamedTuple):
    """PX4's parameters, with their names there."""

    xy_p_1_s: float = 0.95  # MPC_XY_P
    z_p_1_s: float = 1.0  # MPC_Z_P
    xy_velocity_p_1_s: float = 1.8  # MPC_XY_VEL_P_ACC
    xy_velocity_i_1_s2: float = 0.4  # MPC_XY_VEL_I_ACC
    xy_velocity_d: float = 0.2  # MPC_XY_VEL_D_ACC
    z_velocity_p_1_s: float = 4.0  # MPC_Z_VEL_P_ACC
    z_velocity_i_1_s2: float = 2.0  # MPC_Z_VEL_I_ACC
    z_velocity_d: float = 0.0  # MPC_Z_VEL_D_ACC
    xy_speed_m_s: float = 12.0  # MPC_XY_VEL_MAX
    up_speed_m_s: float = 3.0  # MPC_Z_VEL_MAX_UP
    down_speed_m_s: float = 1.5  # MPC_Z_VEL_MAX_DN
    tilt_rad: float = math.radians(45.0)  # MPC_TILTMAX_AIR
    thrust_min: float = 0.12  # MPC_THR_MIN
    thrust_max: float = 1.0  # MPC_THR_MAX
    thrust_xy_margin: float = 0.3  # MPC_THR_XY_MARG
    derivative_filter_hz: float = 5.0  # MPC_VELD_LP


class PositionControlState(NamedTuple):
    """Integrals of the velocity error as accelerations, and the filtered derivative of the velocity; NED."""

    integral_m_s2: tuple[float, float, float] = (0.0, 0.0, 0.0)
    velocity_m_s: tuple[float, float, float] = (math.nan, math.nan, math.nan)  # of the last step; NaN before the first
    acceleration_m_s2: tuple[float, float, float] = (0.0, 0.0, 0.0)


class PositionControlSetpoint(NamedTuple):
    """Where to be, local NED; velocity and acceleration are fed forward."""

    position_ned_m: tuple[float, float, float]
    velocity_ned_m_s: tuple[float, float, float] = (0.0, 0.0, 0.0)
    acceleration_ned_m_s2: tuple[float, float, float] = (0.0, 0.0, 0.0)


def step(
    params: PositionControlParams,
    state: PositionControlState,
    position_ned_m: tuple[float, float, float],
    velocity_ned_m_s: tuple[float, float, float],
    setpoint: PositionControlSetpoint,
    hover_thrust: float,
    dt_s: float,
) -> tuple[PositionControlState, tuple[float, float, float]]:
    """(state, thrust vector in NED, normalised: hover is (0, 0, -hover_thrust))."""
    (x, y, z), (vx, vy, vz) = position_ned_m, velocity_ned_m_s
    (to_x, to_y, to_z), (ff_vx, ff_vy, ff_vz), (ff_ax, ff_ay, ff_az) = setpoint
    (ix, iy, iz), (last_vx, last_vy, last_vz), (dx, dy, dz) = state

    if dt_s > 0.0 and not math.isnan(last_vx):  # derivative of the measured velocity, first-order low pass
        share = dt_s / (dt_s + 1.0 / (2.0 * math.pi * params.derivative_filter_hz))
        dx += share * ((vx - last_vx) / dt_s - dx)
        dy += share * ((vy - last_vy) / dt_s - dy)
        dz += share * ((vz - last_vz) / dt_s - dz)

    wanted_vx, wanted_vy = _limited_speed(
        params.xy_p_1_s * (to_x - x), params.xy_p_1_s * (to_y - y), ff_vx, ff_vy, params.xy_speed_m_s
    )
    wanted_vz = min(max(params.z_p_1_s * (to_z - z) + ff_vz, -params.up_speed_m_s), params.down_speed_m_s)

    iz = min(max(iz, -GRAVITY_M_S2), GRAVITY_M_S2)
    ex, ey, ez = wanted_vx - vx, wanted_vy - vy, wanted_vz - vz
    ax = ff_ax + params.xy_velocity_p_1_s * ex + ix - params.xy_velocity_d * dx
    ay = ff_ay + params.xy_velocity_p_1_s * ey + iy - params.xy_velocity_d * dy
    az = ff_az + params.z_velocity_p_1_s * ez + iz - params.z_velocity_d * dz

    tx, ty, tz = _thrust_vector(params, ax, ay, az, hover_thrust)
    if (tz >= -params.thrust_min and ez >= 0.0) or (tz <= -params.thrust_max and ez <= 0.0):
        ez = 0.0
    tx, ty, tz = _saturated(params, tx, ty, tz)
    per_thrust = GRAVITY_M_S2 / hover_thrust
    cut_x, cut_y = ax - tx * per_thrust, ay - ty * per_thrust
    if ax * ax + ay * ay > (tx * tx + ty * ty) * per_thrust * per_thrust:  # track what was produced
        gain = 2.0 / params.xy_velocity_p_1_s
        ex, ey = ex - gain * cut_x, ey - gain * cut_y
    xy_rate, z_rate = params.xy_velocity_i_1_s2 * dt_s, params.z_velocity_i_1_s2 * dt_s
    integral = (ix + xy_rate * ex, iy + xy_rate * ey, iz + z_rate * ez)
    return PositionControlState(integral, velocity_ned_m_s, (dx, dy, dz)), (tx, ty, tz)


def _limited_speed(px: float, py: float, ff_x: float, ff_y: float, most: float) -> tuple[float, float]:
    """The velocity towards the place first, of the feed-forward what is left within the limit."""
    vx, vy = px + ff_x, py + ff_y
    if math.hypot(vx, vy) <= most:
        return vx, vy
    towards = math.hypot(px, py)
    if towards >= most:
        return px * most / towards, py * most / towards
    forward = math.hypot(ff_x, ff_y)
    if forward == 0.0:
        return px, py
    ux, uy = ff_x / forward, ff_y / forward
    along = ux * px + uy * py
    scale = -along + math.sqrt(along * along - (towards * towards - most * most))
    return px + scale * ux, py + scale * uy


def _thrust_vector(
    params: PositionControlParams, ax: float, ay: float, az: float, hover_thrust: float
) -> tuple[float, float, float]:
    """Tilt from the horizontal acceleration against gravity alone (MPC_ACC_DECOUPLE), thrust from the vertical one."""
    horizontal = math.hypot(ax, ay)
    tilt = min(math.atan2(horizontal, GRAVITY_M_S2), params.tilt_rad)
    share = math.sin(tilt) / horizontal if horizontal > 0.0 else 0.0
    cosine = max(math.cos(tilt), _LOWEST_COSINE)
    thrust = max((hover_thrust - az * hover_thrust / GRAVITY_M_S2) / cosine, params.thrust_min)
    return ax * share * thrust, ay * share * thrust, -cosine * thrust


def _saturated(params: PositionControlParams, tx: float, ty: float, tz: float) -> tuple[float, float, float]:
    """Altitude first, but for a margin that stays horizontal."""
    horizontal, most = math.hypot(tx, ty), params.thrust_max
    kept = min(horizontal, params.thrust_xy_margin)
    tz = max(tz, -math.sqrt(most * most - kept * kept))
    left = math.sqrt(max(most * most - tz * tz, 0.0))
    if horizontal > left:
        tx, ty = tx / horizontal * left, ty / horizontal * left
    return tx, ty, tz
