"""Taylor series in time up to the fourth order: (c0, ..., c4) of ``f(t + h) = sum c_k h^k``. Pure floats.

Derivatives of curves follow from the series of their phase without a formula for each: a product is a convolution,
and sine and cosine of a series obey ``k s_k = sum j p_j c_(k-j)``, ``k c_k = -sum j p_j s_(k-j)``.
"""

from __future__ import annotations

import math

Series = tuple[float, float, float, float, float]

CONSTANT_TAIL = (0.0, 0.0, 0.0, 0.0)


def sine_cosine(phase: Series) -> tuple[Series, Series]:
    """Sine and cosine of a phase in radians."""
    p0, p1, p2, p3, p4 = phase
    s0, c0 = math.sin(p0), math.cos(p0)
    s1, c1 = p1 * c0, -p1 * s0
    if p2 == 0.0 and p3 == 0.0 and p4 == 0.0:  # at a constant rate, which is most of the time
        half, third = 0.5 * p1 * p1, p1 / 3.0
        s2, c2 = -half * s0, -half * c0
        return (s0, s1, s2, third * c2, -0.5 * half * s2 / 3.0), (c0, c1, c2, -third * s2, -0.5 * half * c2 / 3.0)
    s2, c2 = (p1 * c1 + 2.0 * p2 * c0) / 2.0, -(p1 * s1 + 2.0 * p2 * s0) / 2.0
    s3 = (p1 * c2 + 2.0 * p2 * c1 + 3.0 * p3 * c0) / 3.0
    c3 = -(p1 * s2 + 2.0 * p2 * s1 + 3.0 * p3 * s0) / 3.0
    s4 = (p1 * c3 + 2.0 * p2 * c2 + 3.0 * p3 * c1 + 4.0 * p4 * c0) / 4.0
    c4 = -(p1 * s3 + 2.0 * p2 * s2 + 3.0 * p3 * s1 + 4.0 * p4 * s0) / 4.0
    return (s0, s1, s2, s3, s4), (c0, c1, c2, c3, c4)


def polynomial(coefficients: tuple[float, ...], at: float) -> Series:
    """Series of a polynomial about `at`; its coefficients from the constant one up.

    Horner's scheme for the value and the first four Taylor coefficients at once.
    """
    c0 = c1 = c2 = c3 = c4 = 0.0
    for coefficient in reversed(coefficients):
        c4 = c4 * at + c3
        c3 = c3 * at + c2
        c2 = c2 * at + c1
        c1 = c1 * at + c0
        c0 = c0 * at + coefficient
    return c0, c1, c2, c3, c4


def scaled(series: Series, by: float) -> Series:
    """A multiple."""
    c0, c1, c2, c3, c4 = series
    return by * c0, by * c1, by * c2, by * c3, by * c4
