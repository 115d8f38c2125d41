"""Hover thrust, estimated in flight from how the vehicle moves up and down.

With thrust T, hover thrust h (both normalised) and R33, the vertical part of the body's z axis, the vehicle obeys

    v' = g - g T R33 / h,    z down,

which is linear in θ = 1/h. Both sides pass the same low-pass λ/(s + λ), so that no signal is differentiated: v' becomes
λ (v - v_f), with v_f the low-passed v, and T R33 becomes l. What is left is 1 - λ (v - v_f)/g = θ l, and θ follows by
the normalised gradient law

    θ̂' = γ ((1 - λ (v - v_f)/g) / l - θ̂),

whose error decays as exp(-γ t) whatever is flown, because l never vanishes in flight. PX4's estimator
(`mc_hover_thrust_estimator`) takes the same equation in h, where it is not linear, with a Kalman filter of one state.
"""

from __future__ import annotations

import math
from typing import NamedTuple


class HoverParams(NamedTuple):
    """γ and λ above, the range believed, and how fast the thrust in use follows. `rate_1_s` zero: no estimation."""

    rate_1_s: float
    filter_rad_s: float
    lower: float
    upper: float
    slew_1_s: float  # of the hover thrust in use, over itself
    gravity_m_s2: float


class HoverState(NamedTuple):
    """The hover thrust in use, and the observer behind it."""

    hover_thrust: float
    inverse: float  # θ̂
    filtered_velocity_m_s: float
    filtered_lift: float  # l


def start(hover_thrust: float, velocity_down_m_s: float) -> HoverState:
    """Settled at the hover thrust given."""
    return HoverState(hover_thrust, 1.0 / hover_thrust, velocity_down_m_s, hover_thrust)


def step(params: HoverParams, state: HoverState, velocity_down_m_s: float, lift: float, dt_s: float) -> HoverState:
    """One tick.

    Parameters
    ----------
    params, state
        Constants of the flight, and the memory after the last tick.
    velocity_down_m_s
        As estimated now.
    lift
        T R33: the normalised thrust flown over the last tick, times the vertical part of the thrust direction.
    dt_s
        Since the last tick.
    """
    rate, bandwidth, lower, upper, slew, gravity = params
    hover, inverse, filtered_velocity, filtered_lift = state
    blend = 1.0 - math.exp(-bandwidth * dt_s)
    filtered_velocity += blend * (velocity_down_m_s - filtered_velocity)
    filtered_lift += blend * (lift - filtered_lift)
    acceleration = bandwidth * (velocity_down_m_s - filtered_velocity)
    if filtered_lift > 0.1 * hover:  # in free fall the equation says nothing
        inverse += (1.0 - math.exp(-rate * dt_s)) * ((1.0 - acceleration / gravity) / filtered_lift - inverse)
        inverse = 1.0 / upper if inverse < 1.0 / upper else 1.0 / lower if inverse > 1.0 / lower else inverse
    wanted, most = 1.0 / inverse, slew * hover * dt_s
    change = wanted - hover
    hover += -most if change < -most else most if change > most else change
    return HoverState(hover, inverse, filtered_velocity, filtered_lift)


def shift(state: HoverState, velocity_down_m_s: float) -> HoverState:
    """The same memory after the estimate of the velocity jumped by so much."""
    hover, inverse, filtered_velocity, filtered_lift = state
    return HoverState(hover, inverse, filtered_velocity + velocity_down_m_s, filtered_lift)
