"""The mission of a config, as a command over time: stairs, or trajectories one after the other."""

from __future__ import annotations

import math
from bisect import bisect_right

from companion.config.mission import MissionSection
from companion.config.mission.flown import legs_of, limits_of
from companion.config.schema import Config
from companion.control.types import PositionSetpoint, Reference
from companion.trajectory.course import Course
from companion.trajectory.streamed import Streamed
from companion.trajectory.trajectory import moved


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

    def begin(self, origin: PositionSetpoint) -> None:
        """Control begins."""

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

    def wanted(self, elapsed_s: float, origin: PositionSetpoint) -> tuple[PositionSetpoint, Reference | None]:
        """Where to be, and, on a trajectory, the instant of it."""
        return self.command(elapsed_s, origin), None

    def over(self, elapsed_s: float) -> bool:
        """Whether the mission has ended; one without a duration never does."""
        return self._duration_s is not None and elapsed_s >= self._duration_s - 1e-9


class TrajectoryMission:
    """Trajectories from where control began. Where the estimate jumps they jump along, as the origin does."""

    def __init__(self, config: Config) -> None:
        self._limits = limits_of(config.mission, config.controller, config.attitude, config.vehicle.hover_thrust)
        self._legs = legs_of(config.mission, self._limits)
        self._course: Course | None = None
        self._began = PositionSetpoint(0.0, 0.0, 0.0, 0.0)

    def begin(self, origin: PositionSetpoint) -> None:
        """Control begins: what is between the trajectories is found."""
        self._began = origin
        self._course = Course(self._legs, origin, self._limits)

    def wanted(self, elapsed_s: float, origin: PositionSetpoint) -> tuple[PositionSetpoint, Reference | None]:
        """Where to be `elapsed_s` after `begin`, with the origin as it is now; and the instant of the trajectory."""
        assert self._course is not None  # begin comes first
        instant, steps = self._course.at(elapsed_s)
        if origin is not self._began:
            x, y, z, yaw = (now - before for now, before in zip(origin, self._began, strict=True))
            instant = moved(instant, (x, y, z, yaw))
        place = PositionSetpoint(instant.x_m, instant.y_m, instant.z_m, instant.yaw_rad)
        return place, None if steps else instant

    def over(self, elapsed_s: float) -> bool:
        """Whether the last one has ended."""
        return self._course is not None and elapsed_s >= self._course.duration_s - 1e-9


def mission_of(config: Config) -> Mission | TrajectoryMission:
    """What a config has to fly."""
    return TrajectoryMission(config) if config.mission.trajectories else Mission(config.mission)


def stream_of(config: Config) -> Streamed | None:
    """What flies a planner's stream; None where none may be flown, since the frame could not move along."""
    steering, controller = config.steering, config.controller
    if not steering.enabled or controller.anchor != "setpoint":
        return None
    limits = limits_of(config.mission, controller, config.attitude, config.vehicle.hover_thrust)
    return Streamed(limits, timeout_s=steering.stream.timeout_s, late_s=steering.stream.late_s)
