"""The stairs of the config, as a command over time."""

from __future__ import annotations

import math
from bisect import bisect_right

from companion.config.mission import MissionSection
from companion.control.types import PositionSetpoint


class Mission:
    """Waypoints relative to where control began."""

    def __init__(self, section: MissionSection) -> None:
        self._times = [waypoint.at_s for waypoint in section.waypoints]
        self._offsets = [(0.0, 0.0, 0.0, 0.0)]
        for waypoint in section.waypoints:
            turn = self._offsets[-1][3] if waypoint.yaw_deg is None else math.radians(waypoint.yaw_deg)
            self._offsets.append((*waypoint.offset_ned_m, turn))
        self._duration_s = section.duration_s
        self._origin = self._command = PositionSetpoint(0.0, 0.0, 0.0, 0.0)
        self._begin_s = self._end_s = math.inf  # of the leg that the command is for

    def command(self, elapsed_s: float, origin: PositionSetpoint) -> PositionSetpoint:
        """Where to be, `elapsed_s` after engagement at `origin`."""
        at_s = elapsed_s + 1e-9
        if not self._begin_s <= at_s < self._end_s or origin is not self._origin:
            after = bisect_right(self._times, at_s)
            self._begin_s, self._end_s = (-math.inf, *self._times, math.inf)[after : after + 2]
            north, east, down, turn = self._offsets[after]
            x, y, z, yaw = self._origin = origin
            self._command = PositionSetpoint(x + north, y + east, z + down, yaw + turn)
        return self._command

    def over(self, elapsed_s: float) -> bool:
        """Whether the mission has ended; one without a duration never does."""
        return self._duration_s is not None and elapsed_s >= self._duration_s - 1e-9
