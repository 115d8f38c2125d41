"""The `service`, `log`, `steering` and `release` sections: operating system, disk, live set-points, end of control."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from companion.config.base import NUMBER, Id, NonNegative, Positive, Priority, Section


class ServiceSection(Section):
    """What is asked of the operating system. What it does not permit is reported, and flown without."""

    realtime_priority: Priority = 0
    """Priority of SCHED_FIFO to ask for; 0: none. The unit file allows up to 60."""
    lock_memory: bool = False
    """Ask that no page of the process is ever swapped out or waited for (mlockall)."""


class LogSection(Section):
    """How much of the disk the flights of one folder may take: the oldest are deleted first (`docs/flight_log.md`)."""

    quota_gb: Positive = 20.0
    """[GB] All flights in the folder together, the one being written among them. An hour is about 0.2 GB at 250 Hz."""
    free_gb: NonNegative = 0.5
    """[GB] What is left free on the disk for everybody else."""


class StreamSection(Section):
    """A planner that streams: SET_POSITION_TARGET_LOCAL_NED with velocity (`docs/trajectories.md`)."""

    timeout_s: Annotated[float, Field(ge=0.05, le=2.0), NUMBER] = 0.25
    """Without a new sample for so long the stream has ended: the vehicle brakes along the path and hovers."""
    late_s: Annotated[float, Field(ge=0.01, le=1.0), NUMBER] = 0.1
    """A sample that took so much longer than the quickest ones is refused."""


class SteeringSection(Section):
    """Who may move the set-point by SET_POSITION_TARGET_LOCAL_NED, addressed to the companion's own component."""

    enabled: bool = False
    """Take live commands. Needs `guards.fence` with a box, and a speed or an envelope that holds the way."""
    system_ids: tuple[Id, ...] = ()
    """MAVLink systems that may steer, 255 for QGroundControl."""
    stream: StreamSection = StreamSection()
    """Trajectories that one of them streams, within `mission.limits` and four fifths of `controller.limits`."""

    @model_validator(mode="after")
    def _somebody(self) -> SteeringSection:
        if self.enabled and not self.system_ids:
            raise ValueError("give system_ids: the MAVLink systems that may steer")
        return self


class ReleaseSection(Section):
    """The mode that is asked of the vehicle when control ends for a fault, by the operator, or because it is over."""

    mode: Annotated[Literal["hold", "land", "return", "position"], Field(description="asked for when control ends")] = (
        "hold"
    )
