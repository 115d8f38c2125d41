"""The `mission` section: what to fly after engagement."""

from __future__ import annotations

from itertools import pairwise

from pydantic import model_validator

from companion.config.base import NonNegative, Positive, Section, Vector


class Waypoint(Section):
    """From a time on, a position relative to where control began (north, east, down)."""

    at_s: NonNegative
    offset_ned_m: Vector


class MissionSection(Section):
    """What to fly after engagement. Without waypoints the vehicle holds its position until it is released."""

    duration_s: Positive | None = None
    waypoints: tuple[Waypoint, ...] = ()

    @model_validator(mode="after")
    def _in_order(self) -> MissionSection:
        times = [waypoint.at_s for waypoint in self.waypoints]
        if any(later <= earlier for earlier, later in pairwise(times)):
            raise ValueError("waypoints must come in order of at_s, no two at the same time")
        if times and self.duration_s is not None and times[-1] >= self.duration_s:
            raise ValueError("the last waypoint lies at or after duration_s")
        return self
