"""The ANT-X 2-DoF rig (27)-(28): a quadrotor on two guides, free to pitch and to move along x.

``θ̇ = q``, ``J q̇ = M_c``; ``ṗ = v``, ``m v̇ = -T sin θ + f_e`` with T near m g and f_e the friction of the guides.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from companion.attitude_response.kind import LinearResponse, State
from companion.control.types import GRAVITY_M_S2
from sitl.vehicles.attitude_loop import RateGains, RateState, rate_step, respond


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


def friction(params: RigParams, velocity_m_s: float) -> float:
    """Deceleration of the guides at a velocity, m/s²."""
    return params.viscous_friction_1_s * velocity_m_s + params.coulomb_friction_m_s2 * math.tanh(
        velocity_m_s / params.coulomb_width_m_s
    )


def step(
    params: RigParams,
    state: RigState,
    pitch_wanted_rad: float,
    thrust_ratio: float,
    dt_s: float,
    push_m_s2: float = 0.0,
) -> RigState:
    """The rig `dt_s` later; `thrust_ratio` is thrust over weight, `push_m_s2` a force from outside over the mass."""
    rate_loop, further = state.rate_loop, state.further
    if params.cascade:
        wanted_rate = params.pitch_gain_1_s * math.sin(pitch_wanted_rad - state.pitch_rad)
        rate_loop, acceleration = rate_step(
            params.rate_gains, state.rate_loop, wanted_rate, state.pitch_rate_rad_s, dt_s
        )
        rate = state.pitch_rate_rad_s + dt_s * acceleration
        pitch = state.pitch_rad + dt_s * rate
    else:
        pitch, rate, further = respond(
            params.response, state.pitch_rad, state.pitch_rate_rad_s, further, pitch_wanted_rad, dt_s
        )
    drive = -GRAVITY_M_S2 * thrust_ratio * math.sin(0.5 * (state.pitch_rad + pitch))
    velocity = state.velocity_m_s + dt_s * (drive + push_m_s2 - friction(params, state.velocity_m_s))
    position = state.position_m + dt_s * 0.5 * (state.velocity_m_s + velocity)
    return RigState(position, velocity, pitch, rate, rate_loop, further)
