"""Rectangular projection of (22): each weight stays between its own bounds, which need not be symmetric."""

from __future__ import annotations


def projected_rate(value: float, rate: float, lower: float, upper: float) -> float:
    """Proj[value, rate] of (22), one element: the rate, or zero where it would push the value out of its bounds."""
    if (value >= upper and rate > 0.0) or (value <= lower and rate < 0.0):
        return 0.0
    return rate


def adapt(value: float, rate: float, lower: float, upper: float, dt_s: float) -> float:
    """One explicit step of ``Ẇ = Proj[W, rate]``; it ends on the bound where the step would leave the box."""
    return min(max(value + dt_s * projected_rate(value, rate, lower, upper), lower), upper)
