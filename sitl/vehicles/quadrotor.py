"""The 6-DoF quadrotor (1)-(2) in NED, with body drag, under the attitude cascade (7) or a given linear response.

``R' = R S(ω)``, ``J ω' = -S(ω) J ω + τ``; ``p' = v``, ``m v' = m g e3 - T R e3 - c_D |v| v``, where the drag sees the
velocity against the air.
"""

from __future__ import annotations

from math import atan2, copysign, cos, inf, radians, sin, sqrt
from typing import Final, NamedTuple

from companion.attitude_response import discrete
from companion.attitude_response.kind import LinearResponse, State
from companion.attitude_response.kinds import SecondOrder
from companion.control.types import GRAVITY_M_S2
from sitl.vehicles.attitude_loop import AngleGains, RateGains, RateState, rate_step, respond, wanted_rates
from sitl.vehicles.rotation import Quaternion, euler, quaternion


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


UNEVEN_MOTORS_RAD_S2: Final = radians(4.5)
"""How uneven motors turn it where nothing controls its rotation: 9 degrees in 2 s, seen on PX4's SIH."""
YAW_ACCELERATION_RAD_S2: Final = 2.3
"""What the motors turn a yaw of second order by. A step of 171 degrees then overshoots by 18, as seen on PX4's SIH."""

CALM: Final = Effects(0.0, 0.0, 0.0, 0.0, 0.0)


_Turned = tuple[float, float, float, float, float, float, float, RateState, RateState, RateState]
"""What turns, a step later: the fields of a state from `qw` to `yaw_loop`."""


class Dynamics:
    """The quadrotor, stepped by `dt_s`: what is the same in every step is worked out once. No flight leaves a trace."""

    def __init__(self, params: QuadrotorParams, dt_s: float) -> None:
        self._params, self._dt_s = params, dt_s
        self._drag_1_m = params.drag_n_s2_m2 / params.mass_kg
        axes = (params.roll, params.pitch, params.yaw)
        self._plain = not any(axis.kind.further for axis in axes)
        self._roll, self._pitch, self._yaw = (discrete.step(axis, dt_s) for axis in axes)
        limited = params.yaw.kind is SecondOrder  # the rate of a first order jumps
        self._most_turn_rad_s = YAW_ACCELERATION_RAD_S2 * dt_s if limited else inf
        self._wanted: Quaternion | None = None  # a set-point stands for many steps: the last one,
        self._wanted_angles = (0.0, 0.0, 0.0)  # and its angles

    def __reduce__(self) -> tuple[type[Dynamics], tuple[QuadrotorParams, float]]:
        return Dynamics, (self._params, self._dt_s)

    def step(
        self, state: QuadrotorState, wanted: Quaternion, thrust_n: float, effects: Effects = CALM
    ) -> QuadrotorState:
        """The state `dt_s` later, under an attitude set-point and a collective thrust, both held.

        Under `UNCONTROLLED` it goes on turning as it does.
        Without the cascade each Euler angle follows its own response; the body rates are the angle rates, as in (9).
        """
        params, dt_s = self._params, self._dt_s
        wind_north, wind_east, wind_down, roll_bias, pitch_bias = effects
        if roll_bias or pitch_bias:
            roll, pitch, yaw = euler(*wanted)
            wanted = quaternion(roll + roll_bias, pitch + pitch_bias, yaw)
        x, y, z, old_vx, old_vy, old_vz, qw, qx, qy, qz, p, q, r, roll_loop, pitch_loop, yaw_loop, further = state
        if wanted[0] != wanted[0]:
            qw, qx, qy, qz, p = self._drift(state)
        elif params.cascade:
            qw, qx, qy, qz, p, q, r, roll_loop, pitch_loop, yaw_loop = self._cascade(state, wanted)
        else:
            if wanted is not self._wanted:
                self._wanted, self._wanted_angles = wanted, euler(*wanted)
            roll_wanted, pitch_wanted, yaw_wanted = self._wanted_angles
            roll, pitch, yaw = euler(qw, qx, qy, qz)
            turn, yaw_before, r_before = yaw_wanted - yaw, yaw, r
            yaw_wanted = yaw + atan2(sin(turn), cos(turn))  # the short way round
            if self._plain:
                roll, p = self._roll((roll, p), roll_wanted)
                pitch, q = self._pitch((pitch, q), pitch_wanted)
                yaw, r = self._yaw((yaw, r), yaw_wanted)
            else:
                of_roll, of_pitch, of_yaw = further
                roll, p, of_roll = respond(params.roll, roll, p, of_roll, roll_wanted, dt_s)
                pitch, q, of_pitch = respond(params.pitch, pitch, q, of_pitch, pitch_wanted, dt_s)
                yaw, r, of_yaw = respond(params.yaw, yaw, r, of_yaw, yaw_wanted, dt_s)
                further = (of_roll, of_pitch, of_yaw)
            if abs(r - r_before) > self._most_turn_rad_s:
                r = r_before + copysign(self._most_turn_rad_s, r - r_before)
                yaw = yaw_before + 0.5 * dt_s * (r_before + r)
            qw, qx, qy, qz = quaternion(roll, pitch, yaw)

        lift = thrust_n / params.mass_kg
        air_x, air_y, air_z = old_vx - wind_north, old_vy - wind_east, old_vz - wind_down
        drag = self._drag_1_m * sqrt(air_x * air_x + air_y * air_y + air_z * air_z)
        vx = old_vx - dt_s * (lift * 2.0 * (qx * qz + qw * qy) + drag * air_x)
        vy = old_vy - dt_s * (lift * 2.0 * (qy * qz - qw * qx) + drag * air_y)
        vz = old_vz + dt_s * (GRAVITY_M_S2 - lift * (1.0 - 2.0 * (qx * qx + qy * qy)) - drag * air_z)
        return QuadrotorState._make((  # four times as fast as by its fields
            x + dt_s * 0.5 * (old_vx + vx),
            y + dt_s * 0.5 * (old_vy + vy),
            z + dt_s * 0.5 * (old_vz + vz),
            vx, vy, vz, qw, qx, qy, qz, p, q, r, roll_loop, pitch_loop, yaw_loop, further,
        ))  # fmt: skip

    def _drift(self, state: QuadrotorState) -> tuple[float, float, float, float, float]:
        """Quaternion and roll rate: the rates stay, but for what uneven motors do."""
        dt_s = self._dt_s
        w, x, y, z, p, q, r = state[6:13]
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
        )

    def _cascade(self, state: QuadrotorState, wanted: Quaternion) -> _Turned:
        """The cascade (7) on the rotational dynamics (1)."""
        params, dt_s = self._params, self._dt_s
        w, x, y, z, old_p, old_q, old_r, roll_loop, pitch_loop, yaw_loop = state[6:16]
        p_wanted, q_wanted, r_wanted = wanted_rates(params.angle_gains, wanted, (w, x, y, z))
        roll_loop, p_dot = rate_step(params.roll_rate, roll_loop, p_wanted, old_p, dt_s)
        pitch_loop, q_dot = rate_step(params.pitch_rate, pitch_loop, q_wanted, old_q, dt_s)
        yaw_loop, r_dot = rate_step(params.yaw_rate, yaw_loop, r_wanted, old_r, dt_s)
        jx, jy, jz = params.inertia_x_kg_m2, params.inertia_y_kg_m2, params.inertia_z_kg_m2
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
