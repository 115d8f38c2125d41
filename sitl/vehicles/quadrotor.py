"""The 6-DoF quadrotor (1)-(2) in NED, with body drag, under the attitude cascade (7) or a given linear response.

``R' = R S(ω)``, ``J ω' = -S(ω) J ω + τ``; ``p' = v``, ``m v' = m g e3 - T R e3 - c_D |v| v``, where the drag sees the
velocity against the air.
"""

from __future__ import annotations

from math import inf
from typing import Final, NamedTuple

from companion.attitude_response.kind import LinearResponse, State
from companion.attitude_response.kinds import SecondOrder
from sitl.vehicles.attitude_loop import NO_RESPONSE, AngleGains, RateGains, RateState, held, respond
from sitl.vehicles.body import Body, drift, fly, follow, limit_turn, short_way, turn_by_cascade
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


YAW_ACCELERATION_RAD_S2: Final = 2.3
"""What the motors turn a yaw of second order by. A step of 171 degrees then overshoots by 18, as seen on PX4's SIH."""

CALM: Final = Effects(0.0, 0.0, 0.0, 0.0, 0.0)


def body(params: QuadrotorParams, dt_s: float) -> Body:
    """For steps of `dt_s`."""
    limited = params.yaw.kind is SecondOrder  # the rate of a first order jumps
    return Body(
        params.mass_kg,
        params.drag_n_s2_m2 / params.mass_kg,
        params.inertia_x_kg_m2,
        params.inertia_y_kg_m2,
        params.inertia_z_kg_m2,
        params.cascade,
        held(params.roll, dt_s),
        held(params.pitch, dt_s),
        held(params.yaw, dt_s),
        YAW_ACCELERATION_RAD_S2 * dt_s if limited else inf,
        params.angle_gains,
        params.roll_rate,
        params.pitch_rate,
        params.yaw_rate,
        dt_s,
    )


class Dynamics:
    """The quadrotor, stepped by `dt_s`: what is the same in every step is worked out once. No flight leaves a trace."""

    def __init__(self, params: QuadrotorParams, dt_s: float) -> None:
        self._params, self._dt_s = params, dt_s
        self.constants = body(params, dt_s)
        self._plain = NO_RESPONSE not in (self.constants.roll, self.constants.pitch, self.constants.yaw)
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
        constants = self.constants
        wind_north, wind_east, wind_down, roll_bias, pitch_bias = effects
        if roll_bias or pitch_bias:
            roll, pitch, yaw = euler(*wanted)
            wanted = quaternion(roll + roll_bias, pitch + pitch_bias, yaw)
        x, y, z, vx, vy, vz, qw, qx, qy, qz, p, q, r, roll_loop, pitch_loop, yaw_loop, further = state
        if wanted[0] != wanted[0]:
            qw, qx, qy, qz, p, q, r = drift((qw, qx, qy, qz), (p, q, r), self._dt_s)
        elif constants.cascade:
            qw, qx, qy, qz, p, q, r, roll_loop, pitch_loop, yaw_loop = turn_by_cascade(
                constants, (qw, qx, qy, qz), (p, q, r), (roll_loop, pitch_loop, yaw_loop), wanted
            )
        else:
            if wanted is not self._wanted:
                self._wanted, self._wanted_angles = wanted, euler(*wanted)
            if self._plain:
                qw, qx, qy, qz, p, q, r = follow(constants, (qw, qx, qy, qz), (p, q, r), self._wanted_angles)
            else:
                (qw, qx, qy, qz, p, q, r), further = self._follow_of_higher_order(state)
        x, y, z, vx, vy, vz = fly(
            constants, (x, y, z), (vx, vy, vz), (qw, qx, qy, qz), thrust_n, (wind_north, wind_east, wind_down)
        )
        return QuadrotorState._make((  # four times as fast as by its fields
            x, y, z, vx, vy, vz, qw, qx, qy, qz, p, q, r, roll_loop, pitch_loop, yaw_loop, further,
        ))  # fmt: skip

    def _follow_of_higher_order(
        self, state: QuadrotorState
    ) -> tuple[tuple[float, float, float, float, float, float, float], tuple[State, State, State]]:
        """`follow`, of responses that have states beside angle and rate."""
        params, dt_s = self._params, self._dt_s
        roll_wanted, pitch_wanted, yaw_wanted = self._wanted_angles
        of_roll, of_pitch, of_yaw = state.further
        roll, pitch, yaw = euler(state.qw, state.qx, state.qy, state.qz)
        yaw_before, r_before = yaw, state.r_rad_s
        yaw_wanted = short_way(yaw, yaw_wanted)
        roll, p, of_roll = respond(params.roll, roll, state.p_rad_s, of_roll, roll_wanted, dt_s)
        pitch, q, of_pitch = respond(params.pitch, pitch, state.q_rad_s, of_pitch, pitch_wanted, dt_s)
        yaw, r, of_yaw = respond(params.yaw, yaw, r_before, of_yaw, yaw_wanted, dt_s)
        yaw, r = limit_turn(self.constants.most_turn_rad_s, yaw_before, r_before, yaw, r, dt_s)
        return (*quaternion(roll, pitch, yaw), p, q, r), (of_roll, of_pitch, of_yaw)
