"""The stairs of the config, as a command over time."""

from __future__ import annotations

import math
from bisect import bisect_right

from companion.config.mission import MissionSection
from companion.control.types import Command


class Mission:
    """Waypoints relative to where control began."""

    def __init__(self, section: MissionSection) -> None:
        self._times = [waypoint.at_s for waypoint in section.waypoints]
        self._offsets = [(0.0, 0.0, 0.0, 0.0)]
        for waypoint in section.waypoints:
            turn = self._offsets[-1][3] if waypoint.yaw_deg is None else math.radians(waypoint.yaw_deg)
            self._offsets.append((*waypoint.offset_ned_m, turn))
        self._duration_s = section.duration_s

    def command(self, elapsed_s: float, origin: Command) -> Command:
        """Where to be, `elapsed_s` after engagement at `origin`."""
        north, east, down, turn = self._offsets[bisect_right(self._times, elapsed_s + 1e-9)]
        x, y, z, yaw = origin
        return Command(x + north, y + east, z + down, yaw + turn)

    def over(self, elapsed_s: float) -> bool:
        """Whether the mission has ended; one without a duration never does."""
        return self._duration_s is not None and elapsed_s >= self._duration_s - 1e-9
