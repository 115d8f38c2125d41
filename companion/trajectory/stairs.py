"""Stairs: places to be at from given times on. The flown set-point travels to them at its own speed."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass

from companion.control.types import Reference
from companion.trajectory.trajectory import Place, rest


@dataclass(frozen=True)
class Stairs:
    """Before the first time it is at its origin."""

    duration_s: float
    times_s: tuple[float, ...]
    places: tuple[Place, ...]

    def at(self, time_s: float) -> Reference:
        """The place wanted then, at rest."""
        count = bisect_right(self.times_s, time_s + 1e-9)
        return rest(self.places[count - 1] if count else (0.0, 0.0, 0.0, 0.0))
