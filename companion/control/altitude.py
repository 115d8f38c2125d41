"""Altitude cascade (4): proportional position loop around a PI velocity loop with filtered output derivative.

The paper writes it z-up and in newtons; here z is down (NED) and everything is divided by the mass, so that gains are
accelerations and the output is the specific force along the vertical, positive up, in units of g.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from companion.control.types import GRAVITY_M_S2


class AltitudeParams(NamedTuple):
    """Gains of (4) over the mass; `filter_bandwidth_rad_s` is the T of its derivative filter sT/(s + T)."""

    position_gain_1_s: float
    velocity_gain_1_s: float
    integral_gain_1_s2: float
    derivative_gain: float
    filter_bandwidth_rad_s: float
    integral_limit_m_s2: float
    velocity_limit_m_s: float
    gravity_m_s2: float


class AltitudeState(NamedTuple):
    """Integrator, as an acceleration, and the derivative filter's low-pass; and (4) on a vehicle without disturbance.

    The reference is what the cascade makes of the command when nothing but the thrust moves the vehicle; like the
    hedged reference it knows the thrust that was flown in place of the one wanted.
    """

    integral_m_s2: float
    filtered_velocity_m_s: float
    reference_z_m: float
    reference_velocity_m_s: float  # down
    reference_integral_m_s2: float
    reference_climb_m_s2: float  # its acceleration upwards since the last tick
    up: float  # wanted at the last tick, over g


def start(z_m: float, velocity_down_m_s: float, lift: float = 1.0, gravity_m_s2: float = GRAVITY_M_S2) -> AltitudeState:
    """The filter settled, the integrator at what carries the vehicle: `lift`, a vertical specific force over g.

    The first output is that plus the proportional part.
    """
    integral = gravity_m_s2 * (lift - 1.0)
    return AltitudeState(integral, velocity_down_m_s, z_m, velocity_down_m_s, 0.0, 0.0, lift)


def step(
    params: AltitudeParams,
    state: AltitudeState,
    z_m: float,
    velocity_down_m_s: float,
    command_z_m: float,
    dt_s: float,
    flown_up: float,
    lowest_up: float,
    highest_up: float,
    hover_ratio: float,
) -> tuple[AltitudeState, float]:
    """Vertical specific force over g, positive up; 1 is hover.

    The integrator stops at its limit, and does not integrate farther into a thrust that is at its own.

    Parameters
    ----------
    params, state
        Constants of the flight, and the memory after the last tick.
    z_m, velocity_down_m_s
        Down, relative to the local origin; downwards.
    command_z_m
        Down, where to.
    dt_s
        Since the last tick.
    flown_up
        Vertical specific force over g that was commanded over the last tick.
    lowest_up, highest_up
        What the thrust limits allow, over g.
    hover_ratio
        The hover thrust of the last tick over that of this one. Thrust is `up` times hover thrust: where the latter
        changes, the integrator takes up the difference and the thrust does not step.
    """
    kp, kv, ki, kd, bandwidth, integral_limit, limit, gravity = params
    integral, filtered, reference_z, reference_velocity, reference_integral, reference_climb, up_before = state

    climb_wanted = -kp * (command_z_m - z_m)
    climb_wanted = -limit if climb_wanted < -limit else limit if climb_wanted > limit else climb_wanted
    climb_error = climb_wanted + velocity_down_m_s
    integral += gravity * up_before * (hover_ratio - 1.0)
    moved = integral + dt_s * ki * climb_error
    moved = -integral_limit if moved < -integral_limit else integral_limit if moved > integral_limit else moved
    blend = 1.0 - math.exp(-bandwidth * dt_s)
    filtered += blend * (velocity_down_m_s - filtered)
    climb_derivative = -bandwidth * (velocity_down_m_s - filtered)
    up = 1.0 + (kv * climb_error + moved - kd * climb_derivative) / gravity
    integrates = not ((up > highest_up and climb_error > 0.0) or (up < lowest_up and climb_error < 0.0))
    if not integrates:
        moved = integral
        up = 1.0 + (kv * climb_error + moved - kd * climb_derivative) / gravity

    reference_velocity -= dt_s * (reference_climb + gravity * (flown_up - up_before) / (1.0 + kd))
    reference_z += dt_s * reference_velocity
    climb_wanted = -kp * (command_z_m - reference_z)
    climb_wanted = -limit if climb_wanted < -limit else limit if climb_wanted > limit else climb_wanted
    climb_error = climb_wanted + reference_velocity
    if integrates:
        reference_integral += dt_s * ki * climb_error
        reference_integral = min(max(reference_integral, -integral_limit), integral_limit)
    reference_climb = (kv * climb_error + reference_integral) / (1.0 + kd)
    return (
        AltitudeState(moved, filtered, reference_z, reference_velocity, reference_integral, reference_climb, up),
        up,
    )


def shift(state: AltitudeState, z_m: float, velocity_down_m_s: float) -> AltitudeState:
    """The same memory after the estimate jumped by so much."""
    integral, filtered, reference_z, reference_velocity, reference_integral, reference_climb, up = state
    return AltitudeState(
        integral,
        filtered + velocity_down_m_s,
        reference_z + z_m,
        reference_velocity + velocity_down_m_s,
        reference_integral,
        reference_climb,
        up,
    )
