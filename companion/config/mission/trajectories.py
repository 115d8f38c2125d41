"""The `mission.trajectories` section: what is flown one after the other, as data."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from companion.config.base import NUMBER, FileBesideConfig, Number, Positive, Section, Vector
from companion.config.mission.waypoint import Waypoint, check_order

Heading = Literal["kept", "path"]
Ramp = Annotated[float, Field(ge=0.2, le=60.0), NUMBER]
Size = Annotated[float, Field(ge=0.05, le=10_000.0), NUMBER]
Speed = Annotated[float, Field(ge=0.01, le=100.0), NUMBER]
Laps = Annotated[float, Field(gt=0.0, le=1000.0), NUMBER]


class StairsSection(Section):
    """Set-points from given times on, to which the flown one travels at `controller.limits.speed_m_s`."""

    duration_s: Positive
    """How long the stairs take."""
    waypoints: tuple[Waypoint, ...]
    """Where to be from which time on, since the stairs began."""

    @model_validator(mode="after")
    def _in_order(self) -> StairsSection:
        check_order(self.waypoints, self.duration_s)
        return self


class CircleSection(Section):
    """A horizontal circle that begins at its origin, northwards, and ends at rest."""

    radius_m: Size
    """Radius."""
    speed_m_s: Speed
    """Speed between the ramps."""
    laps: Laps = 1.0
    """[1] How often around."""
    ramp_s: Ramp = 3.0
    """How long the speed rises at the beginning and falls at the end."""
    clockwise: bool = True
    """Seen from above: its centre lies east of its origin. Otherwise west."""
    heading: Heading = "kept"
    """`kept`: as at engagement. `path`: where the path goes."""


class LemniscateSection(Section):
    """A horizontal figure of eight that begins and ends at rest in its middle, its length along north."""

    length_m: Size = 4.0
    """From end to end."""
    width_m: Size = 2.0
    """Across."""
    speed_m_s: Speed
    """In the middle, where it is the largest."""
    laps: Laps = 4.0
    """[1] How often around."""
    ramp_s: Ramp = 3.0
    """How long the speed rises at the beginning and falls at the end."""
    heading: Heading = "kept"
    """`kept`: as at engagement. `path`: where the path goes."""


class PlaceSection(Section):
    """One place to come through."""

    offset_ned_m: Vector
    """North, east, down of the trajectory's origin."""
    yaw_deg: Number | None = None
    """Heading there, clockwise from above. Left out: that of the place before."""


class ThroughSection(Section):
    """The smoothest way through places (minimum snap), from rest to rest, as fast as the limits allow."""

    places: Annotated[tuple[PlaceSection, ...], Field(min_length=2, max_length=200)]
    """The places, the first one included."""
    heading: Heading = "kept"
    """`kept`: that of the places. `path`: where the path goes."""


class SamplesSection(Section):
    """Samples of a file: `time_s`, `x_m`, `y_m`, `z_m`, and perhaps velocities, accelerations and `yaw_deg`."""

    file: FileBesideConfig
    """CSV, or Parquet where pyarrow is installed; a relative path starts at the config's folder."""
    heading: Heading = "kept"
    """`kept`: that of `yaw_deg`. `path`: where the path goes."""


class PlanSection(Section):
    """Waypoints of a QGroundControl plan, the smoothest way through them. Relative: the first one is the origin.
    Absolute: the planned home is the local origin."""

    file: FileBesideConfig
    """A `.plan` file; a relative path starts at the config's folder."""
    heading: Heading = "kept"
    """`kept`: that of the waypoints. `path`: where the path goes."""


class TrajectorySection(Section):
    """One trajectory: exactly one of the kinds, and where it is."""

    hold_s: Positive | None = None
    """Stay in a place for so long."""
    stairs: StairsSection | None = None
    """Steps of the set-point."""
    circle: CircleSection | None = None
    """A circle."""
    lemniscate: LemniscateSection | None = None
    """A figure of eight."""
    through: ThroughSection | None = None
    """A way through places."""
    samples: SamplesSection | None = None
    """A table of samples."""
    plan: PlanSection | None = None
    """A plan of QGroundControl."""
    offset_ned_m: Vector | None = None
    """Where its origin lies: north, east, down of where control began, or of the local origin. Left out: at it; a
    `hold_s` without it stays where the one before has ended."""
    yaw_deg: Number = 0.0
    """Heading, from the one at engagement, or from north. Where a kind has headings of its own they are added."""
    absolute: bool = False
    """Count from the local origin and from north, not from where control began and its heading."""

    @property
    def kind(self) -> str:
        """The key of the kind that is given."""
        return next(name for name in KINDS if getattr(self, name) is not None)

    @model_validator(mode="after")
    def _one_kind(self) -> TrajectorySection:
        if sum(getattr(self, name) is not None for name in KINDS) != 1:
            raise ValueError(f"give exactly one of {', '.join(KINDS)}")
        return self


KINDS = ("hold_s", "stairs", "circle", "lemniscate", "through", "samples", "plan")


class TrajectoryLimitsSection(Section):
    """What a trajectory may ask for beside `controller.limits`, of whose acceleration, tilt and thrust it gets four
    fifths: the rest is left to the feedback."""

    speed_m_s: Positive = 5.0
    """Largest speed along a trajectory."""
    jerk_m_s3: Positive = 20.0
    """[m/s3] Largest jerk along a trajectory."""
