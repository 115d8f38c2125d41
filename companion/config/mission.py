"""The `mission` section: what to fly after engagement."""

from __future__ import annotations

from itertools import pairwise

from pydantic import model_validator

from companion.config.base import NonNegative, Number, Positive, Section, Vector
from companion.config.identification import IdentificationSection


class Waypoint(Section):
    """From a time on, a position and a heading relative to where control began. Without a heading it stays."""

    at_s: NonNegative
    offset_ned_m: Vector
    yaw_deg: Number | None = None  # clockwise from above, from the heading at engagement


class MissionSection(Section):
    """What to fly after engagement. Without waypoints the vehicle holds its position until it is released.

    A config may write `mission: {file: stairs.yaml}`, a path from the config's own folder, to a file with these keys;
    keys beside `file` count more than those in it. `load_config` puts the content in its place.
    """

    duration_s: Positive | None = None
    waypoints: tuple[Waypoint, ...] = ()
    identification: IdentificationSection | None = None  # in place of the other two: it ends by itself

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
