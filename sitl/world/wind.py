"""Wind: steady, the discrete gust and the Dryden turbulence of MIL-F-8785C. Pure steps over flat records.

Source: MIL-F-8785C, 3.7.1.2 (Dryden spectra), 3.7.1.3 (discrete gust of 1-cosine shape), 3.7.3.4 (scale lengths and
intensities below 1000 ft). The field is frozen and blows past a vehicle that hovers, so the airspeed of the spectra is
the wind's own.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

Vector = tuple[float, float, float]

_FOOT_M: Final = 0.3048
_LOWEST_M: Final = 10.0 * _FOOT_M  # of the low-altitude model
_LEAST_SPEED_M_S: Final = 1.0  # at which the frozen field passes, however weak the wind
_SHAPE: Final = 1.0 / math.sqrt(3.0) - 1.0  # of the transverse spectrum's zero against its double pole


class Gust(NamedTuple):
    """A gust that rises as 1-cosine, stays and falls the same way; again every `every_s`, or once where that is 0."""

    peak_ned_m_s: Vector
    start_s: float
    rise_s: float
    hold_s: float
    every_s: float


def gust_share(gust: Gust, time_s: float) -> float:
    """How much of its peak a gust has reached, 0 to 1."""
    since = time_s - gust.start_s
    if since <= 0.0:
        return 0.0
    if gust.every_s > 0.0:
        since %= gust.every_s
    if since < gust.rise_s:
        return 0.5 * (1.0 - math.cos(math.pi * since / gust.rise_s))
    falling = since - gust.rise_s - gust.hold_s
    if falling <= 0.0:
        return 1.0
    return 0.5 * (1.0 + math.cos(math.pi * falling / gust.rise_s)) if falling < gust.rise_s else 0.0


def gusty(mean_ned_m_s: Vector, gust: Gust, time_s: float) -> Vector:
    """Steady wind and gust together."""
    share = gust_share(gust, time_s)
    north, east, down = mean_ned_m_s
    peak_north, peak_east, peak_down = gust.peak_ned_m_s
    return north + share * peak_north, east + share * peak_east, down + share * peak_down


def turbulent(steady_ned_m_s: Vector, along: tuple[float, float], turbulence: Vector) -> Vector:
    """Turbulence (along, across, vertical) upon a wind; `along` is the direction of the mean, north and east."""
    north, east, down = steady_ned_m_s
    ahead, across, vertical = turbulence
    c, s = along
    return north + c * ahead - s * across, east + s * ahead + c * across, down + vertical


class Dryden(NamedTuple):
    """The three filters over one step, discretised exactly: along the wind, across it, vertical."""

    along_decay: float
    along_drive: float
    across: Transverse
    vertical: Transverse


class Transverse(NamedTuple):
    """``(1 + √3 τ s) / (1 + τ s)²`` driven by white noise, over one step.

    Two states in a chain of poles at 1/τ; `noise` is the Cholesky factor of what the noise adds to them within a step.
    """

    decay: float
    step_s: float
    noise_11: float
    noise_21: float
    noise_22: float
    output_1: float
    output_2: float


class DrydenState(NamedTuple):
    """States of the three filters."""

    along_m_s: float
    across_1: float
    across_2: float
    vertical_1: float
    vertical_2: float


STILL: Final = DrydenState(0.0, 0.0, 0.0, 0.0, 0.0)


def dryden(wind_at_20_ft_m_s: float, altitude_m: float, speed_m_s: float, dt_s: float) -> Dryden:
    """The filters at an altitude, for an intensity given by the wind speed at 20 ft (light 7.7, moderate 15.4 m/s)."""
    height_ft = max(altitude_m, _LOWEST_M) / _FOOT_M
    thin = 0.177 + 0.000823 * height_ft
    vertical_m_s = 0.1 * wind_at_20_ft_m_s
    horizontal_m_s = vertical_m_s / thin**0.4
    vertical_length_m = height_ft * _FOOT_M
    horizontal_length_m = vertical_length_m / thin**1.2
    speed = max(speed_m_s, _LEAST_SPEED_M_S)
    decay = math.exp(-dt_s * speed / horizontal_length_m)
    return Dryden(
        decay,
        horizontal_m_s * math.sqrt(1.0 - decay * decay),
        _transverse(horizontal_m_s, horizontal_length_m / speed, dt_s),
        _transverse(vertical_m_s, vertical_length_m / speed, dt_s),
    )


def _transverse(deviation_m_s: float, tau_s: float, dt_s: float) -> Transverse:
    """``x1' = -x1/τ + w``, ``x2' = -x2/τ + x1``; with intensity σ²τ of w the output has the standard deviation σ."""
    a = 2.0 / tau_s
    e = math.exp(-a * dt_s)
    intensity = deviation_m_s * deviation_m_s * tau_s
    # Integrals of exp(-a s), s exp(-a s) and s² exp(-a s) over the step.
    q11 = intensity * (1.0 - e) / a
    q12 = intensity * (1.0 - e * (1.0 + a * dt_s)) / a**2
    q22 = intensity * (2.0 - e * (2.0 + 2.0 * a * dt_s + (a * dt_s) ** 2)) / a**3
    n11 = math.sqrt(q11)
    n21 = q12 / n11 if n11 > 0.0 else 0.0
    gain = math.sqrt(3.0) / tau_s
    return Transverse(
        math.exp(-dt_s / tau_s), dt_s, n11, n21, math.sqrt(max(q22 - n21 * n21, 0.0)), gain, gain * _SHAPE / tau_s
    )


def dryden_step(
    params: Dryden, state: DrydenState, noise: tuple[float, float, float, float, float]
) -> tuple[DrydenState, Vector]:
    """The turbulence one step later, (along, across, vertical) in m/s, under five independent normal numbers."""
    along = params.along_decay * state.along_m_s + params.along_drive * noise[0]
    a1, a2, across = _transverse_step(params.across, state.across_1, state.across_2, noise[1], noise[2])
    v1, v2, vertical = _transverse_step(params.vertical, state.vertical_1, state.vertical_2, noise[3], noise[4])
    return DrydenState(along, a1, a2, v1, v2), (along, across, vertical)


def _transverse_step(p: Transverse, x1: float, x2: float, n1: float, n2: float) -> tuple[float, float, float]:
    x2 = p.decay * (x2 + p.step_s * x1) + p.noise_21 * n1 + p.noise_22 * n2
    x1 = p.decay * x1 + p.noise_11 * n1
    return x1, x2, p.output_1 * x1 + p.output_2 * x2
