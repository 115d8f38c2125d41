"""The `mission` section: what to fly after engagement."""

from __future__ import annotations

from pydantic import model_validator

from companion.config.base import Positive, Section
from companion.config.mission.identification import IdentificationSection
from companion.config.mission.trajectories import TrajectoryLimitsSection, TrajectorySection
from companion.config.mission.waypoint import Waypoint, check_order

__all__ = ["MissionSection", "Waypoint"]


class MissionSection(Section):
    """What to fly after engagement. Without waypoints the vehicle holds its position until it is released.

    A config may write `mission: {file: stairs.yaml}`, a path from the config's own folder, to a file with these keys;
    keys beside `file` count more than those in it.
    """

    duration_s: Positive | None = None
    """Control ends so long after it began (`mission_complete`). Left out: it goes on."""
    waypoints: tuple[Waypoint, ...] = ()
    """Where to be from which time on."""
    trajectories: tuple[TrajectorySection, ...] = ()
    """Trajectories in place of waypoints and duration, one after the other; control ends with the last one. What asks
    for more than the limits allow is refused."""
    limits: TrajectoryLimitsSection = TrajectoryLimitsSection()
    """Of the trajectories."""
    stretch: bool = False
    """Fly a trajectory that asks for too much as much slower as it takes. Otherwise it is refused."""
    identification: IdentificationSection | None = None
    """Attitude doublets in place of waypoints and duration. The option `--identify` gives it with its defaults."""

    @model_validator(mode="after")
    def _in_order(self) -> MissionSection:
        check_order(self.waypoints, self.duration_s)
        if self.identification is not None and (self.waypoints or self.duration_s is not None):
            raise ValueError("identification ends by itself: leave out waypoints and duration_s")
        if self.trajectories and (self.waypoints or self.duration_s is not None or self.identification is not None):
            raise ValueError("trajectories end by themselves: leave out waypoints, duration_s and identification")
        return self
