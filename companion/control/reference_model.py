"""Second-order reference model (19) and its hedged form (20), discretised exactly over one tick.

Per axis: ``ẋ = A_r x + [0, 1]ᵀ a`` with ``A_r = [[0, 1], [-ωn², -2ζωn]]``, ``x = [position, velocity]``. The ideal
model takes ``a = ωn² c``; the hedged one takes ``a = ωn² c + g (w - u)``.
"""

from __future__ import annotations

import math
from typing import NamedTuple


class Transition(NamedTuple):
    """``x(t+dt) = Φ x(t) + Γ a`` for an acceleration input ``a`` held over the tick."""

    phi11: float
    phi12: float
    phi21: float
    phi22: float
    gamma1: float
    gamma2: float


def transition(natural_frequency_rad_s: float, damping_ratio: float, dt_s: float) -> Transition:
    """Exact zero-order-hold discretisation, in closed form for every damping ratio.

    With ``σ = ζωn``: ``exp(A_r t) = e^{-σt} (C I + S (A_r + σI))``; C and S are cos and sin/ω below critical damping,
    cosh and sinh/ω above it, and 1 and t at it. ``Γ = A_r⁻¹ (Φ - I) [0, 1]ᵀ``.
    """
    phi11, phi12, phi21, phi22, gamma1, gamma2 = discretise(natural_frequency_rad_s, damping_ratio, dt_s)
    return Transition(phi11, phi12, phi21, phi22, gamma1, gamma2)


def discretise(
    natural_frequency_rad_s: float, damping_ratio: float, dt_s: float
) -> tuple[float, float, float, float, float, float]:
    """The same as plain numbers, for the tick."""
    stiffness = natural_frequency_rad_s * natural_frequency_rad_s
    sigma = damping_ratio * natural_frequency_rad_s
    discriminant = stiffness - sigma * sigma
    if discriminant > 1e-9 * stiffness:
        omega = math.sqrt(discriminant)
        c = math.cos(omega * dt_s)
        s = math.sin(omega * dt_s) / omega
    elif discriminant < -1e-9 * stiffness:
        omega = math.sqrt(-discriminant)
        c = math.cosh(omega * dt_s)
        s = math.sinh(omega * dt_s) / omega
    else:
        c = 1.0
        s = dt_s
    decay = math.exp(-sigma * dt_s)
    phi11 = decay * (c + s * sigma)
    phi12 = decay * s
    phi22 = decay * (c - s * sigma)
    return phi11, phi12, -stiffness * phi12, phi22, (1.0 - phi11) / stiffness, phi12
