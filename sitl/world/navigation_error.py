"""How a real estimator is wrong: position and velocity errors that belong together. Pure steps over flat records.

A Kalman filter with position aiding has a constant gain once it has settled. Its error obeys, per axis,

    e_p' = e_v - k1 e_p + n    e_v' = a - k2 e_p - k3 e_v + n_v    a' = -a/tau_a + n_a    n' = -n/tau_n + n_n

where e_p, e_v are the errors of position and velocity, k1, k2, k3 the gains, n and n_v what the noise of the aiding
does through them, and a the acceleration that the inertial part gets wrong (a tilted horizon, the bias of an
accelerometer). So the velocity error is not the derivative of the position error: for slow a it is k1 e_p, of one
sign for seconds. That is what a position controller has to live with.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final, NamedTuple


class AxisError(NamedTuple):
    """Parameters of one axis."""

    position_gain_1_s: float = 0.0  # k1
    velocity_gain_1_s2: float = 0.0  # k2
    velocity_damping_1_s: float = 0.0  # k3, of an aid that measures velocity
    noise_m_s: float = 0.0  # standard deviation of n
    noise_time_s: float = 1.0  # tau_n
    velocity_noise_m_s_sqrt_s: float = 0.0  # (m/s)/sqrt(s), of n_v
    acceleration_m_s2: float = 0.0  # standard deviation of a
    acceleration_time_s: float = 1.0  # tau_a


class ErrorState(NamedTuple):
    """Of one axis: estimate less truth; the noise of the aiding, and the acceleration that is wrong."""

    position_m: float = 0.0
    velocity_m_s: float = 0.0
    noise_m_s: float = 0.0
    acceleration_m_s2: float = 0.0


class NavigationError(NamedTuple):
    """The errors of one estimator, local NED."""

    north: AxisError
    east: AxisError
    down: AxisError


# `gps` is fitted to estimate less ground truth in five recorded flights of 54 s of PX4 v1.17 (SIH, EKF2 with GPS):
# k1, n and tau_n by regression of the slope of the position less the velocity on the error of the position
# (correlation -0.92 north, -0.97 east), the rest to auto- and cross-covariances up to 6 s. Recorded over 53 s / this
# model over all time: north 0.134 / 0.155 m, 0.187 / 0.199 m/s; east 0.188 / 0.207 m, 0.252 / 0.267 m/s; their
# correlation 0.87, 0.92 / 0.91, 0.94; left after 2 s 0.7 and 0.8 / 0.7 and 0.8. Down: 0.069 / 0.064 m, 0.095 / 0.100
# m/s.
#
# The others are not recorded. `rtk`: the same filter, since EKF2_GPS_P_NOISE (0.5 m) bounds what it believes, with a
# twentieth of the noise and a third of the wrong acceleration. `motion_capture`: steady gains of that filter for
# EKF2_EVP_NOISE (0.1 m) at 50 Hz, with 1 mm of noise. `optical_flow`: velocity alone is aided (EKF2_OF_N_MIN, 0.15
# rad/s, 2 m over ground), so that the position walks away. Source of the parameters: docs.px4.io, "Parameter
# Reference", EKF2.
PRESETS: Final = {
    "gps": NavigationError(
        AxisError(1.236, 0.537, 0.0, 0.070, 0.6, 0.030, 0.112, 1.71),
        AxisError(1.243, 0.470, 0.0, 0.064, 0.6, 0.060, 0.130, 1.95),
        AxisError(1.248, 1.456, 0.0, 0.000, 0.6, 0.0540, 0.105, 0.77),
    ),
    "rtk": NavigationError(*(AxisError(1.25, 0.51, 0.0, 0.0035, 0.6, 0.002, 0.042, 1.8),) * 3),
    "optical_flow": NavigationError(
        *(AxisError(0.0, 0.0, 1.5, 0.0, 1.0, 0.05, 0.042, 1.8),) * 2,
        AxisError(1.25, 1.456, 0.0, 0.0, 1.0, 0.02, 0.05, 0.77),
    ),
    "motion_capture": NavigationError(*(AxisError(2.1, 2.2, 0.0, 0.0003, 0.1, 0.002, 0.042, 1.8),) * 3),
}


def step(params: AxisError, state: ErrorState, dt_s: float, n1: float, n2: float, n3: float) -> ErrorState:
    """One step of an axis; `n1`, `n2`, `n3` independent standard normal numbers.

    A semi-implicit Euler step: to be called every 20 ms or oftener, far below the time constants of the presets.
    """
    k1, k2, k3, noise_deviation, noise_time_s, velocity_noise, deviation, time_s = params
    position, velocity, noise, acceleration = state
    decay = math.exp(-dt_s / noise_time_s)
    noise = decay * noise + math.sqrt(1.0 - decay * decay) * noise_deviation * n1
    decay = math.exp(-dt_s / time_s)
    acceleration = decay * acceleration + math.sqrt(1.0 - decay * decay) * deviation * n3
    velocity = velocity + dt_s * (acceleration - k2 * position - k3 * velocity) + math.sqrt(dt_s) * velocity_noise * n2
    position = position + dt_s * (velocity - k1 * position + noise)
    return ErrorState(position, velocity, noise, acceleration)


def settled(params: AxisError, normal: Callable[[], float], dt_s: float = 0.02, time_s: float = 30.0) -> ErrorState:
    """A state drawn from what the error is after a while. `normal` draws standard normal numbers.

    Where nothing holds the position, it begins at zero.
    """
    state = ErrorState()
    for _ in range(round(time_s / dt_s)):
        state = step(params, state, dt_s, normal(), normal(), normal())
    return state if params.position_gain_1_s > 0.0 else state._replace(position_m=0.0)
