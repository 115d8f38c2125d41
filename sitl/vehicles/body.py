"""The steps of the quadrotor (1)-(2) and (7), pure: flat tuples of floats, which CPython and numba both take."""

from __future__ import annotations

from math import atan2, copysign, cos, radians, sin, sqrt
from typing import Final, NamedTuple

from companion.attitude_response.held import Held, advance
from companion.control.types import GRAVITY_M_S2
from sitl.vehicles.attitude_loop import AngleGains, RateGains, RateState, rate_step, wanted_rates
from sitl.vehicles.rotation import Quaternion, euler, quaternion

Vector = tuple[float, float, float]

UNEVEN_MOTORS_RAD_S2: Final = radians(4.5)
"""How uneven motors turn it where nothing controls its rotation: 9 degrees in 2 s, seen on PX4's SIH."""


class Body(NamedTuple):
    """What of the parameters is the same in every step of `dt_s`: floats, and flags, that numba takes too."""

    mass_kg: float
    drag_1_m: float
    inertia_x_kg_m2: float
    inertia_y_kg_m2: float
    inertia_z_kg_m2: float
    cascade: bool
    roll: Held
    pitch: Held
    yaw: Held
    most_turn_rad_s: float  # by how much the yaw rate may change in a step
    angle_gains: AngleGains
    roll_rate: RateGains
    pitch_rate: RateGains
    yaw_rate: RateGains
    dt_s: float


def short_way(yaw: float, wanted: float) -> float:
    """The heading wanted, from where the yaw is the short way round."""
    turn = wanted - yaw
    return yaw + atan2(sin(turn), cos(turn))


def limit_turn(
    most_turn_rad_s: float, yaw_before: float, r_before: float, yaw: float, r: float, dt_s: float
) -> tuple[float, float]:
    """Yaw and its rate, no farther from the rate before than motors turn it."""
    if abs(r - r_before) > most_turn_rad_s:
        r = r_before + copysign(most_turn_rad_s, r - r_before)
        yaw = yaw_before + 0.5 * dt_s * (r_before + r)
    return yaw, r


def follow(
    constants: Body, attitude: Quaternion, rates: Vector, wanted_angles: Vector
) -> tuple[float, float, float, float, float, float, float]:
    """Quaternion and body rates a step later: each Euler angle by its own response, the body rates as in (9)."""
    qw, qx, qy, qz = attitude
    p, q, r = rates
    roll_wanted, pitch_wanted, yaw_wanted = wanted_angles
    roll, pitch, yaw = euler(qw, qx, qy, qz)
    yaw_before, r_before = yaw, r
    roll, p = advance(constants.roll, roll, p, roll_wanted)
    pitch, q = advance(constants.pitch, pitch, q, pitch_wanted)
    yaw, r = advance(constants.yaw, yaw, r, short_way(yaw, yaw_wanted))
    yaw, r = limit_turn(constants.most_turn_rad_s, yaw_before, r_before, yaw, r, constants.dt_s)
    qw, qx, qy, qz = quaternion(roll, pitch, yaw)
    return qw, qx, qy, qz, p, q, r


def fly(
    constants: Body, place: Vector, velocity: Vector, attitude: Quaternion, thrust_n: float, wind: Vector
) -> tuple[float, float, float, float, float, float]:
    """Position and velocity a step later, (2), at the attitude at its end."""
    dt_s = constants.dt_s
    x, y, z = place
    old_vx, old_vy, old_vz = velocity
    qw, qx, qy, qz = attitude
    wind_north, wind_east, wind_down = wind
    lift = thrust_n / constants.mass_kg
    air_x, air_y, air_z = old_vx - wind_north, old_vy - wind_east, old_vz - wind_down
    drag = constants.drag_1_m * sqrt(air_x * air_x + air_y * air_y + air_z * air_z)
    vx = old_vx - dt_s * (lift * 2.0 * (qx * qz + qw * qy) + drag * air_x)
    vy = old_vy - dt_s * (lift * 2.0 * (qy * qz - qw * qx) + drag * air_y)
    vz = old_vz + dt_s * (GRAVITY_M_S2 - lift * (1.0 - 2.0 * (qx * qx + qy * qy)) - drag * air_z)
    return (
        x + dt_s * 0.5 * (old_vx + vx), y + dt_s * 0.5 * (old_vy + vy), z + dt_s * 0.5 * (old_vz + vz), vx, vy, vz,
    )  # fmt: skip


def drift(attitude: Quaternion, rates: Vector, dt_s: float) -> tuple[float, float, float, float, float, float, float]:
    """Quaternion and body rates where nothing controls the rotation: they stay, but for what uneven motors do."""
    w, x, y, z = attitude
    p, q, r = rates
    p += dt_s * UNEVEN_MOTORS_RAD_S2
    rate = sqrt(p * p + q * q + r * r)
    half = 0.5 * rate * dt_s
    s = sin(half) / rate if rate > 0.0 else 0.5 * dt_s
    cw, cx, cy, cz = cos(half), s * p, s * q, s * r
    return (
        w * cw - x * cx - y * cy - z * cz,
        w * cx + x * cw + y * cz - z * cy,
        w * cy - x * cz + y * cw + z * cx,
        w * cz + x * cy - y * cx + z * cw,
        p,
        q,
        r,
    )


_Turned = tuple[float, float, float, float, float, float, float, RateState, RateState, RateState]
"""What turns, a step later: the fields of a state from `qw` to `yaw_loop`."""


def turn_by_cascade(
    constants: Body,
    attitude: Quaternion,
    rates: Vector,
    loops: tuple[RateState, RateState, RateState],
    wanted: Quaternion,
) -> _Turned:
    """The cascade (7) on the rotational dynamics (1)."""
    dt_s = constants.dt_s
    w, x, y, z = attitude
    old_p, old_q, old_r = rates
    roll_loop, pitch_loop, yaw_loop = loops
    p_wanted, q_wanted, r_wanted = wanted_rates(constants.angle_gains, wanted, attitude)
    roll_loop, p_dot = rate_step(constants.roll_rate, roll_loop, p_wanted, old_p, dt_s)
    pitch_loop, q_dot = rate_step(constants.pitch_rate, pitch_loop, q_wanted, old_q, dt_s)
    yaw_loop, r_dot = rate_step(constants.yaw_rate, yaw_loop, r_wanted, old_r, dt_s)
    jx, jy, jz = constants.inertia_x_kg_m2, constants.inertia_y_kg_m2, constants.inertia_z_kg_m2
    p = old_p + dt_s * (p_dot - (jz - jy) / jx * old_q * old_r)
    q = old_q + dt_s * (q_dot - (jx - jz) / jy * old_r * old_p)
    r = old_r + dt_s * (r_dot - (jy - jx) / jz * old_p * old_q)
    angle = sqrt(p * p + q * q + r * r) * dt_s
    s = (0.5 - angle * angle / 48.0) * dt_s  # sin(angle/2)/|ω|, to fourth order in a small angle
    cw, cx, cy, cz = 1.0 - angle * angle / 8.0, s * p, s * q, s * r
    qw = w * cw - x * cx - y * cy - z * cz
    qx = w * cx + x * cw + y * cz - z * cy
    qy = w * cy - x * cz + y * cw + z * cx
    qz = w * cz + x * cy - y * cx + z * cw
    norm = sqrt(qw * qw + qx * qx + qy * qy + qz * qz)
    return qw / norm, qx / norm, qy / norm, qz / norm, p, q, r, roll_loop, pitch_loop, yaw_loop
