"""The `mission` section: what to fly after engagement."""

from __future__ import annotations

from itertools import pairwise

from pydantic import model_validator

from companion.config.base import NonNegative, Number, Positive, Section, Vector
from companion.config.mission.identification import IdentificationSection


class Waypoint(Section):
    """From a time on, a position and a heading relative to where control began."""

    at_s: NonNegative
    """Since control began. Waypoints come in this order, no two at the same time."""
    offset_ned_m: Vector
    """North, east, down of where control began. It must lie inside `guards.fence` and within what
    `controller.envelope` allows."""
    yaw_deg: Number | None = None
    """Heading, clockwise from above, from the one at engagement. Left out: as it is. A rig has none."""


class MissionSection(Section):
    """What to fly after engagement. Without waypoints the vehicle holds its position until it is released.

    A config may write `mission: {file: stairs.yaml}`, a path from the config's own folder, to a file with these keys;
    keys beside `file` count more than those in it.
    """

    duration_s: Positive | None = None
    """Control ends so long after it began (`mission_complete`). Left out: it goes on."""
    waypoints: tuple[Waypoint, ...] = ()
    """Where to be from which time on."""
    identification: IdentificationSection | None = None
    """Attitude doublets in place of waypoints and duration. The option `--identify` gives it with its defaults."""

    @model_validator(mode="after")
    def _in_order(self) -> MissionSection:
        times = [waypoint.at_s for waypoint in self.waypoints]
        if any(later <= earlier for earlier, later in pairwise(times)):
            raise ValueError("waypoints must come in order of at_s, no two at the same time")
        if times and self.duration_s is not None and times[-1] >= self.duration_s:
            raise ValueError("the last waypoint lies at or after duration_s")
        if self.identification is not None and (self.waypoints or self.duration_s is not None):
            raise ValueError("identification ends by itself: leave out waypoints and duration_s")
        return self
