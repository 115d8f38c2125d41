"""Closed-loop attitude: the paper's cascade (7) on the rotational dynamics, or a given linear response in its place.

Pure steps over flat records, as in `companion.control`.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from companion.attitude_response.discrete import step
from companion.attitude_response.held import Held
from companion.attitude_response.kind import LinearResponse, State
from companion.attitude_response.kinds import FirstOrder, SecondOrder


def respond(
    response: LinearResponse, angle_rad: float, rate_rad_s: float, further: State, wanted_rad: float, dt_s: float
) -> tuple[float, float, State]:
    """Angle, rate and the kind's further states one step later, exactly, for a set-point held over the step.

    No further states given: those at rest.
    """
    state = (angle_rad, rate_rad_s, *(further or (0.0,) * response.kind.further))
    angle, rate, *rest = step(response, dt_s)(state, wanted_rad)
    return angle, rate, tuple(rest)


NO_RESPONSE: Final = Held(True, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def held(response: LinearResponse, dt_s: float) -> Held:
    """The response over a step of `dt_s` as plain numbers; `NO_RESPONSE` for a kind that they do not describe."""
    return response.kind.held(response.values, dt_s) or NO_RESPONSE


def with_gain(response: LinearResponse, ratio: float) -> LinearResponse:
    """The response with `ratio` times the gain from angle to rate (MC_ROLL_P and its like), the rate loop as it is.

    A rate loop of first order, w' = B (P (u - angle) - w), makes wn^2 = B P and 2 zeta wn = B. Of another kind it is
    not known: it stays.
    """
    if ratio == 1.0:
        return response
    if response.kind is FirstOrder:
        (bandwidth,) = response.values
        return response._replace(values=(ratio * bandwidth,))
    if response.kind is SecondOrder:
        frequency, damping = response.values
        root = math.sqrt(ratio)
        return response._replace(values=(root * frequency, damping / root))
    return response


class RateGains(NamedTuple):
    """PI_R and D_R of (7) for one axis, over the inertia: the output is an angular acceleration."""

    proportional_1_s: float
    integral_1_s2: float
    derivative: float
    filter_bandwidth_rad_s: float
    integral_limit_rad_s2: float


class RateState(NamedTuple):
    """Integrator (rad/s²) and the derivative filter's low-pass (rad/s)."""

    integral_rad_s2: float
    filtered_rad_s: float


def rate_step(
    gains: RateGains, state: RateState, wanted_rad_s: float, rate_rad_s: float, dt_s: float
) -> tuple[RateState, float]:
    """Angular acceleration of (7) for one axis: ``PI_R(s)(wanted - ω) - D_R(s) ω``."""
    error = wanted_rad_s - rate_rad_s
    integral = state.integral_rad_s2 + dt_s * gains.integral_1_s2 * error
    integral = min(max(integral, -gains.integral_limit_rad_s2), gains.integral_limit_rad_s2)
    blend = 1.0 - math.exp(-gains.filter_bandwidth_rad_s * dt_s)
    filtered = state.filtered_rad_s + blend * (rate_rad_s - state.filtered_rad_s)
    derivative = gains.derivative * gains.filter_bandwidth_rad_s * (rate_rad_s - filtered)
    return RateState(integral, filtered), gains.proportional_1_s * error + integral - derivative


class AngleGains(NamedTuple):
    """Linearised gains of the attitude loop about each body axis."""

    roll_1_s: float
    pitch_1_s: float
    yaw_1_s: float


def wanted_rates(
    gains: AngleGains,
    wanted: tuple[float, float, float, float],
    actual: tuple[float, float, float, float],
) -> tuple[float, float, float]:
    """γ_R of (7), the body rates that turn `actual` towards `wanted` (quaternions, scalar first).

    ``-½ S⁻¹(K E - Eᵀ K)`` with ``E = R_dᵀ R``. For small errors its gain about one axis is the mean of the K of the
    other two, so K is chosen such that the gains come out as given.
    """
    k1 = gains.pitch_1_s + gains.yaw_1_s - gains.roll_1_s
    k2 = gains.roll_1_s + gains.yaw_1_s - gains.pitch_1_s
    k3 = gains.roll_1_s + gains.pitch_1_s - gains.yaw_1_s
    aw, ax, ay, az = wanted
    bw, bx, by, bz = actual
    w = aw * bw + ax * bx + ay * by + az * bz  # conj(wanted) * actual
    x = aw * bx - ax * bw - ay * bz + az * by
    y = aw * by + ax * bz - ay * bw - az * bx
    z = aw * bz - ax * by + ay * bx - az * bw
    e32, e23 = 2.0 * (y * z + w * x), 2.0 * (y * z - w * x)
    e13, e31 = 2.0 * (x * z + w * y), 2.0 * (x * z - w * y)
    e21, e12 = 2.0 * (x * y + w * z), 2.0 * (x * y - w * z)
    return -0.5 * (k3 * e32 - k2 * e23), -0.5 * (k1 * e13 - k3 * e31), -0.5 * (k2 * e21 - k1 * e12)
