"""Rectangular projection of (22): each weight stays between its own bounds, which need not be symmetric."""

from __future__ import annotations


def adapt(value: float, rate: float, lower: float, upper: float, dt_s: float) -> float:
    """One explicit step of ``Ẇ = Proj[W, rate]``: it ends on the bound where it would leave the box."""
    moved = value + dt_s * rate
    return lower if moved < lower else upper if moved > upper else moved
