"""The quadrotor as the compiled loop steps it."""

from __future__ import annotations

from typing import NamedTuple

from sitl.vehicles import body
from sitl.vehicles.attitude_loop import RateState
from sitl.vehicles.body import Vector
from sitl.vehicles.rotation import Quaternion, euler
from sitl.vehicles.vehicle import GROUNDED_M
from sitl.world.sensing import Pose


class Constants(NamedTuple):
    """What does not change in a flight."""

    body: body.Body
    full_thrust_n: float


class State(NamedTuple):
    """As `QuadrotorState`, grouped, without the states of responses of higher order."""

    place_ned_m: Vector
    velocity_ned_m_s: Vector
    q_wxyz: Quaternion
    rates_rad_s: Vector
    loops: tuple[RateState, RateState, RateState]


def truth(state: State) -> Pose:
    """Where it is, how fast, and how it lies."""
    return state.place_ned_m, state.velocity_ned_m_s, state.q_wxyz


def angles(q_wxyz: Quaternion) -> Vector:
    """What its responses follow of an attitude set-point."""
    qw, qx, qy, qz = q_wxyz
    return euler(qw, qx, qy, qz)


def grounded(state: State) -> bool:
    """Whether it touches the ground, where the compiled loop ends."""
    return state.place_ned_m[2] >= -GROUNDED_M


def step(
    constants: Constants,
    state: State,
    wanted: Quaternion,
    wanted_angles: Vector,
    thrust: float,
    share: float,
    wind_ned_m_s: Vector,
) -> State:
    """A millisecond later, under a set-point that has arrived; `share` of the thrust that battery and motors give."""
    form = constants.body
    thrust_n = thrust * share * constants.full_thrust_n
    loops = state.loops
    if form.cascade:
        qw, qx, qy, qz, p, q, r, roll, pitch, yaw = body.turn_by_cascade(
            form, state.q_wxyz, state.rates_rad_s, loops, wanted
        )
        loops = (roll, pitch, yaw)
    else:
        qw, qx, qy, qz, p, q, r = body.follow(form, state.q_wxyz, state.rates_rad_s, wanted_angles)
    attitude = (qw, qx, qy, qz)
    x, y, z, vx, vy, vz = body.fly(form, state.place_ned_m, state.velocity_ned_m_s, attitude, thrust_n, wind_ned_m_s)
    return State((x, y, z), (vx, vy, vz), attitude, (p, q, r), loops)
