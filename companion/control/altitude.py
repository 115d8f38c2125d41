"""Altitude cascade (4): proportional position loop around a PI velocity loop with filtered output derivative.

The paper writes it z-up and in newtons; here z is down (NED) and everything is divided by the mass, so that gains are
accelerations and the output is the specific force along the vertical, positive up, in units of g.
"""

from __future__ import annotations

import math
from typing import NamedTuple


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
    """Integrator, as an acceleration, and the derivative filter's low-pass."""

    integral_m_s2: float
    filtered_velocity_m_s: float


def start(velocity_down_m_s: float) -> AltitudeState:
    """Integrator empty and the filter settled: the first output is hover thrust plus the proportional part."""
    return AltitudeState(0.0, velocity_down_m_s)


def step(
    params: AltitudeParams,
    state: AltitudeState,
    z_m: float,
    velocity_down_m_s: float,
    command_z_m: float,
    dt_s: float,
) -> tuple[AltitudeState, float]:
    """Vertical specific force over g, positive up; 1 is hover. The integrator stops at its limit."""
    kp, kv, ki, kd, bandwidth, integral_limit, limit, gravity = params
    integral, filtered = state
    climb_wanted = -kp * (command_z_m - z_m)
    climb_wanted = -limit if climb_wanted < -limit else limit if climb_wanted > limit else climb_wanted
    climb_error = climb_wanted + velocity_down_m_s
    integral += dt_s * ki * climb_error
    integral = (
        -integral_limit if integral < -integral_limit else integral_limit if integral > integral_limit else integral
    )
    blend = 1.0 - math.exp(-bandwidth * dt_s)
    filtered += blend * (velocity_down_m_s - filtered)
    climb_derivative = -bandwidth * (velocity_down_m_s - filtered)
    up = kv * climb_error + integral - kd * climb_derivative
    return AltitudeState(integral, filtered), 1.0 + up / gravity
