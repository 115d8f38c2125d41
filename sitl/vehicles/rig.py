"""The ANT-X 2-DoF rig (27)-(28): a quadrotor on two guides, free to pitch and to move along x.

``θ̇ = q``, ``J q̇ = M_c``; ``ṗ = v``, ``m v̇ = -T sin θ + f_e`` with T near m g and f_e the friction of the guides.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from companion.attitude_response.held import Held, advance
from companion.attitude_response.kind import LinearResponse, State
from companion.control.types import GRAVITY_M_S2
from sitl.vehicles.attitude_loop import NO_RESPONSE, RateGains, RateState, held, rate_step, respond


class RigParams(NamedTuple):
    """Friction over the mass, and how pitch follows its set-point."""

    viscous_friction_1_s: float
    coulomb_friction_m_s2: float
    coulomb_width_m_s: float  # friction is coulomb * tanh(v / width)
    cascade: bool  # True: (7) on (27); False: the linear response
    response: LinearResponse
    pitch_gain_1_s: float
    rate_gains: RateGains


class RigState(NamedTuple):
    """Along the guide, and the pitch."""

    position_m: float
    velocity_m_s: float
    pitch_rad: float
    pitch_rate_rad_s: float
    rate_loop: RateState
    further: State = ()  # of the linear response


class Guide(NamedTuple):
    """What of the parameters is the same in every step of `dt_s`: floats, and a flag, that numba takes too."""

    viscous_friction_1_s: float
    coulomb_friction_m_s2: float
    coulomb_width_m_s: float
    cascade: bool
    response: Held
    pitch_gain_1_s: float
    rate_gains: RateGains
    dt_s: float


def guide(params: RigParams, dt_s: float) -> Guide:
    """For steps of `dt_s`."""
    viscous, coulomb, width, cascade, response, gain, rate_gains = params
    return Guide(viscous, coulomb, width, cascade, held(response, dt_s), gain, rate_gains, dt_s)


def friction(params: RigParams | Guide, velocity_m_s: float) -> float:
    """Deceleration of the guides at a velocity, m/s²."""
    return params.viscous_friction_1_s * velocity_m_s + params.coulomb_friction_m_s2 * math.tanh(
        velocity_m_s / params.coulomb_width_m_s
    )


def turn(
    constants: Guide, pitch_rad: float, rate_rad_s: float, rate_loop: RateState, wanted_rad: float
) -> tuple[float, float, RateState]:
    """Pitch, its rate and the rate loop a step later, (27) under (7) or the linear response."""
    if not constants.cascade:
        pitch, rate = advance(constants.response, pitch_rad, rate_rad_s, wanted_rad)
        return pitch, rate, rate_loop
    wanted_rate = constants.pitch_gain_1_s * math.sin(wanted_rad - pitch_rad)
    rate_loop, acceleration = rate_step(constants.rate_gains, rate_loop, wanted_rate, rate_rad_s, constants.dt_s)
    rate = rate_rad_s + constants.dt_s * acceleration
    return pitch_rad + constants.dt_s * rate, rate, rate_loop


def slide(
    constants: Guide,
    position_m: float,
    velocity_m_s: float,
    pitch_before_rad: float,
    pitch_rad: float,
    thrust_ratio: float,
    push_m_s2: float,
) -> tuple[float, float]:
    """Position and velocity a step later, (28); `thrust_ratio` is thrust over weight, `push_m_s2` from outside."""
    dt_s = constants.dt_s
    drive = -GRAVITY_M_S2 * thrust_ratio * math.sin(0.5 * (pitch_before_rad + pitch_rad))
    velocity = velocity_m_s + dt_s * (drive + push_m_s2 - friction(constants, velocity_m_s))
    return position_m + dt_s * 0.5 * (velocity_m_s + velocity), velocity


class Dynamics:
    """The rig, stepped by `dt_s`: what is the same in every step is worked out once."""

    def __init__(self, params: RigParams, dt_s: float) -> None:
        self._params, self._dt_s = params, dt_s
        self.constants = guide(params, dt_s)
        self._plain = params.cascade or self.constants.response != NO_RESPONSE

    def step(self, state: RigState, pitch_wanted_rad: float, thrust_ratio: float, push_m_s2: float = 0.0) -> RigState:
        """The rig a step later; `thrust_ratio` is thrust over weight, `push_m_s2` from outside, over the mass."""
        position, velocity, pitch_before, rate, rate_loop, further = state
        if self._plain:
            pitch, rate, rate_loop = turn(self.constants, pitch_before, rate, rate_loop, pitch_wanted_rad)
        else:
            pitch, rate, further = respond(
                self._params.response, pitch_before, rate, further, pitch_wanted_rad, self._dt_s
            )
        position, velocity = slide(self.constants, position, velocity, pitch_before, pitch, thrust_ratio, push_m_s2)
        return RigState(position, velocity, pitch, rate, rate_loop, further)
