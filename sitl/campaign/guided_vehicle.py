"""The rig as the compiled loop steps it."""

from __future__ import annotations

from math import asin, cos, sin
from typing import NamedTuple

from sitl.vehicles import rig
from sitl.vehicles.attitude_loop import RateState
from sitl.vehicles.rotation import Quaternion
from sitl.world.sensing import Pose

Vector = tuple[float, float, float]


class Constants(NamedTuple):
    """What does not change in a flight."""

    guide: rig.Guide
    hover_thrust: float


class State(NamedTuple):
    """As `RigState`, without the states of responses of higher order."""

    position_m: float
    velocity_m_s: float
    pitch_rad: float
    rate_rad_s: float
    loop: RateState


def truth(state: State) -> Pose:
    """Where it is, how fast, and how it lies."""
    half = 0.5 * state.pitch_rad
    return (state.position_m, 0.0, 0.0), (state.velocity_m_s, 0.0, 0.0), (cos(half), 0.0, sin(half), 0.0)


def angles(q_wxyz: Quaternion) -> Vector:
    """What its response follows of an attitude set-point: the pitch."""
    w, x, y, z = q_wxyz
    return 0.0, asin(min(max(2.0 * (w * y - z * x), -1.0), 1.0)), 0.0


def grounded(state: State) -> bool:  # noqa: ARG001 - guides have no ground
    """Whether it touches the ground."""
    return False


def step(
    constants: Constants,
    state: State,
    wanted: Quaternion,  # noqa: ARG001
    wanted_angles: Vector,
    thrust: float,
    share: float,
    wind_ned_m_s: Vector,  # noqa: ARG001 - it does not reach the guides
) -> State:
    """A millisecond later, under a set-point that has arrived; `share` of the thrust that battery and motors give."""
    guide = constants.guide
    pitch, rate, loop = rig.turn(guide, state.pitch_rad, state.rate_rad_s, state.loop, wanted_angles[1])
    ratio = share * thrust / constants.hover_thrust
    position, velocity = rig.slide(guide, state.position_m, state.velocity_m_s, state.pitch_rad, pitch, ratio, 0.0)
    return State(position, velocity, pitch, rate, loop)
