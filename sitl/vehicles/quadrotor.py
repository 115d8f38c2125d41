"""The 6-DoF quadrotor (1)-(2) in NED, with body drag, under the attitude cascade (7) or a given linear response.

``R' = R S(ω)``, ``J ω' = -S(ω) J ω + τ``; ``p' = v``, ``m v' = m g e3 - T R e3 - c_D |v| v``, where the drag sees the
velocity against the air.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from companion.attitude_response.kind import LinearResponse, State
from companion.control.types import GRAVITY_M_S2
from sitl.vehicles.attitude_loop import AngleGains, RateGains, RateState, rate_step, respond, wanted_rates
from sitl.vehicles.rotation import euler, quaternion


class QuadrotorParams(NamedTuple):
    """Mass, drag, inertia, and how attitude follows its set-point."""

    mass_kg: float
    drag_n_s2_m2: float  # c_D of section 4
    inertia_x_kg_m2: float
    inertia_y_kg_m2: float
    inertia_z_kg_m2: float
    cascade: bool  # True: (7) on (1); False: the linear responses
    roll: LinearResponse
    pitch: LinearResponse
    yaw: LinearResponse
    angle_gains: AngleGains
    roll_rate: RateGains
    pitch_rate: RateGains
    yaw_rate: RateGains


class QuadrotorState(NamedTuple):
    """Local NED, body to NED."""

    x_m: float
    y_m: float
    z_m: float
    vx_m_s: float
    vy_m_s: float
    vz_m_s: float
    qw: float
    qx: float
    qy: float
    qz: float
    p_rad_s: float
    q_rad_s: float
    r_rad_s: float
    roll_loop: RateState
    pitch_loop: RateState
    yaw_loop: RateState
    further: tuple[State, State, State] = ((), (), ())  # of the linear responses


class Effects(NamedTuple):
    """What acts from outside, held over a step."""

    wind_north_m_s: float  # of the air against the ground
    wind_east_m_s: float
    wind_down_m_s: float
    roll_bias_rad: float  # how far uneven motors hold the attitude off its set-point
    pitch_bias_rad: float


CALM: Final = Effects(0.0, 0.0, 0.0, 0.0, 0.0)


def _rotate_linear(
    params: QuadrotorParams, state: QuadrotorState, wanted: tuple[float, float, float, float], dt_s: float
) -> tuple[float, float, float, float, float, float, float, tuple[State, State, State]]:
    """Each Euler angle follows its own response; the body rates are the angle rates, as in (9)."""
    roll, pitch, yaw = euler(state.qw, state.qx, state.qy, state.qz)
    roll_wanted, pitch_wanted, yaw_wanted = euler(wanted[0], wanted[1], wanted[2], wanted[3])
    turn = yaw_wanted - yaw
    yaw_wanted = yaw + math.atan2(math.sin(turn), math.cos(turn))  # the short way round
    of_roll, of_pitch, of_yaw = state.further
    roll, p, of_roll = respond(params.roll, roll, state.p_rad_s, of_roll, roll_wanted, dt_s)
    pitch, q, of_pitch = respond(params.pitch, pitch, state.q_rad_s, of_pitch, pitch_wanted, dt_s)
    yaw, r, of_yaw = respond(params.yaw, yaw, state.r_rad_s, of_yaw, yaw_wanted, dt_s)
    qw, qx, qy, qz = quaternion(roll, pitch, yaw)
    return qw, qx, qy, qz, p, q, r, (of_roll, of_pitch, of_yaw)


def step(
    params: QuadrotorParams,
    state: QuadrotorState,
    wanted: tuple[float, float, float, float],
    thrust_n: float,
    dt_s: float,
    effects: Effects = CALM,
) -> QuadrotorState:
    """The quadrotor `dt_s` later, under an attitude set-point (scalar first) and a collective thrust, both held."""
    wind_north, wind_east, wind_down, roll_bias, pitch_bias = effects
    if roll_bias or pitch_bias:
        roll, pitch, yaw = euler(*wanted)
        wanted = quaternion(roll + roll_bias, pitch + pitch_bias, yaw)
    roll_loop, pitch_loop, yaw_loop, further = state.roll_loop, state.pitch_loop, state.yaw_loop, state.further
    if params.cascade:
        actual = (state.qw, state.qx, state.qy, state.qz)
        p_wanted, q_wanted, r_wanted = wanted_rates(params.angle_gains, wanted, actual)
        roll_loop, p_dot = rate_step(params.roll_rate, roll_loop, p_wanted, state.p_rad_s, dt_s)
        pitch_loop, q_dot = rate_step(params.pitch_rate, pitch_loop, q_wanted, state.q_rad_s, dt_s)
        yaw_loop, r_dot = rate_step(params.yaw_rate, yaw_loop, r_wanted, state.r_rad_s, dt_s)
        jx, jy, jz = params.inertia_x_kg_m2, params.inertia_y_kg_m2, params.inertia_z_kg_m2
        p = state.p_rad_s + dt_s * (p_dot - (jz - jy) / jx * state.q_rad_s * state.r_rad_s)
        q = state.q_rad_s + dt_s * (q_dot - (jx - jz) / jy * state.r_rad_s * state.p_rad_s)
        r = state.r_rad_s + dt_s * (r_dot - (jy - jx) / jz * state.p_rad_s * state.q_rad_s)
        angle = math.sqrt(p * p + q * q + r * r) * dt_s
        s = (0.5 - angle * angle / 48.0) * dt_s  # sin(angle/2)/|ω|, to fourth order in a small angle
        cw, cx, cy, cz = 1.0 - angle * angle / 8.0, s * p, s * q, s * r
        qw = state.qw * cw - state.qx * cx - state.qy * cy - state.qz * cz
        qx = state.qw * cx + state.qx * cw + state.qy * cz - state.qz * cy
        qy = state.qw * cy - state.qx * cz + state.qy * cw + state.qz * cx
        qz = state.qw * cz + state.qx * cy - state.qy * cx + state.qz * cw
        norm = math.sqrt(qw * qw + qx * qx + qy * qy + qz * qz)
        qw, qx, qy, qz = qw / norm, qx / norm, qy / norm, qz / norm
    else:
        qw, qx, qy, qz, p, q, r, further = _rotate_linear(params, state, wanted, dt_s)

    lift = thrust_n / params.mass_kg
    air_x, air_y, air_z = state.vx_m_s - wind_north, state.vy_m_s - wind_east, state.vz_m_s - wind_down
    drag = params.drag_n_s2_m2 / params.mass_kg * math.sqrt(air_x * air_x + air_y * air_y + air_z * air_z)
    vx = state.vx_m_s - dt_s * (lift * 2.0 * (qx * qz + qw * qy) + drag * air_x)
    vy = state.vy_m_s - dt_s * (lift * 2.0 * (qy * qz - qw * qx) + drag * air_y)
    vz = state.vz_m_s + dt_s * (GRAVITY_M_S2 - lift * (1.0 - 2.0 * (qx * qx + qy * qy)) - drag * air_z)
    return QuadrotorState(
        state.x_m + dt_s * 0.5 * (state.vx_m_s + vx),
        state.y_m + dt_s * 0.5 * (state.vy_m_s + vy),
        state.z_m + dt_s * 0.5 * (state.vz_m_s + vz),
        vx, vy, vz, qw, qx, qy, qz, p, q, r, roll_loop, pitch_loop, yaw_loop, further,
    )  # fmt: skip
