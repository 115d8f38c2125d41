"""The stairs of the config, as a command over time."""

from __future__ import annotations

from companion.config.schema import MissionSection
from companion.control.types import Command


class Mission:
    """Waypoints relative to where control began."""

    def __init__(self, section: MissionSection) -> None:
        self._waypoints = [(waypoint.at_s, waypoint.offset_ned_m) for waypoint in section.waypoints]
        self._duration_s = section.duration_s

    def command(self, elapsed_s: float, origin: Command) -> Command:
        """Where to be, `elapsed_s` after engagement at `origin`."""
        offset = (0.0, 0.0, 0.0)
        for at_s, wanted in self._waypoints:
            if at_s > elapsed_s + 1e-9:
                break
            offset = wanted
        return Command(origin.x_m + offset[0], origin.y_m + offset[1], origin.z_m + offset[2], origin.yaw_rad)

    def over(self, elapsed_s: float) -> bool:
        """Whether the mission has ended; one without a duration never does."""
        return self._duration_s is not None and elapsed_s >= self._duration_s - 1e-9
