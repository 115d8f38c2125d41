"""What a config file may say. Units are in the names; the shipped files in `config/` explain each key by example."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Annotated, Literal

from pydantic import Field, model_validator

from companion.config.attitude import AttitudeSection, EnvelopeSection
from companion.config.base import Fraction, Id, NonNegative, Positive, Section, Vector
from companion.config.plant import Plant


class VehicleSection(Section):
    """The vehicle and where it is on MAVLink."""

    kind: Literal["rig", "quadrotor"]
    hover_thrust: Annotated[float, Field(gt=0.0, lt=1.0)]
    system_id: Id = 1
    component_id: Id = 1


class LinkSection(Section):
    """The way to the autopilot, and who we are on it."""

    url: str
    connect_timeout_s: Positive = 10.0
    system_id: Id = 1
    component_id: Id = 191


class TickSection(Section):
    """How often the loop runs: the rate asked of the autopilot, and the rate below which we do not fly."""

    rate_hz: Annotated[float, Field(gt=0.0, le=1000.0)]
    floor_hz: Positive

    @model_validator(mode="after")
    def _floor_below_rate(self) -> TickSection:
        if self.floor_hz > self.rate_hz:
            raise ValueError(f"floor_hz ({self.floor_hz:g}) must not be above rate_hz ({self.rate_hz:g})")
        return self


class AdaptationRates(Section):
    """γ of (22), which the two controllers may not share: γ_H and γ_M of the paper."""

    hedged: NonNegative
    standard: NonNegative


Bound = Positive | tuple[float, float]


class AxisSection(Section):
    """Reference model, adaptation and projection of one horizontal axis."""

    natural_frequency_rad_s: Positive
    damping_ratio: Positive
    position_weight_bound: Bound
    velocity_weight_bound: Bound
    adaptation_rate: AdaptationRates
    lyapunov_q: tuple[Positive, Positive] = (1.0, 1.0)

    @model_validator(mode="after")
    def _bounds_in_order(self) -> AxisSection:
        for name in ("position_weight_bound", "velocity_weight_bound"):
            lower, upper = interval(getattr(self, name))
            if lower >= upper:
                raise ValueError(f"{name}: the lower bound ({lower:g}) must be below the upper one ({upper:g})")
        return self


def interval(bound: Bound) -> tuple[float, float]:
    """A bound as (lower, upper): one number means plus and minus it."""
    return bound if isinstance(bound, tuple) else (-bound, bound)


class Axes(Section):
    """x is pitch, y is roll; a rig has x alone."""

    x: AxisSection
    y: AxisSection | None = None


class AltitudeSection(Section):
    """Gains of (4), over the mass."""

    position_gain_1_s: NonNegative
    velocity_gain_1_s: NonNegative
    integral_gain_1_s2: NonNegative
    derivative_gain: NonNegative = 0.0
    filter_bandwidth_rad_s: Positive = 30.0
    integral_limit_m_s2: NonNegative = 3.0
    velocity_limit_m_s: Positive = 1.0


class Limits(Section):
    """What the controller never asks for."""

    tilt_deg: Annotated[float, Field(gt=0.0, le=60.0)] = 35.0
    thrust_min: Annotated[Fraction, Field(gt=0.0)] = 0.05
    thrust_max: Fraction = 0.95

    @model_validator(mode="after")
    def _in_order(self) -> Limits:
        if self.thrust_min >= self.thrust_max:
            raise ValueError("thrust_min must be below thrust_max")
        return self


class ControllerSection(Section):
    """The position controller."""

    hedging: bool = True
    initial_weights: Literal["zero", "nominal"] = "nominal"
    axes: Axes
    envelope: EnvelopeSection
    altitude: AltitudeSection | None = None
    limits: Limits = Limits()


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


class GuardSection(Section):
    """One failsafe: on or off, and the limit past which control ends."""

    enabled: bool = True
    limit: Positive


class Guards(Section):
    """Every failsafe, with the unit of its limit in its name."""

    pose_age_s: GuardSection = GuardSection(limit=0.25)
    heartbeat_age_s: GuardSection = GuardSection(limit=3.0)


class PaperMetrics(Section):
    """One column of a table of the paper."""

    peak_error_m: Positive
    rms_error_m: Positive


class PaperSection(Section):
    """The figures to set ours beside."""

    table: str
    hedged: PaperMetrics
    standard: PaperMetrics
    figures: dict[str, str] = Field(default_factory=dict)


class Config(Section):
    """A whole config file."""

    vehicle: VehicleSection
    link: LinkSection
    tick: TickSection
    controller: ControllerSection
    attitude: AttitudeSection
    mission: MissionSection = MissionSection()
    guards: Guards = Guards()
    plant: Plant | None = None
    paper: PaperSection | None = None

    @model_validator(mode="after")
    def _axes_of_the_vehicle(self) -> Config:
        if self.vehicle.kind == "quadrotor":
            if self.controller.axes.y is None or self.attitude.y is None or self.controller.altitude is None:
                raise ValueError("a quadrotor needs controller.axes.y, controller.altitude and attitude.y")
        elif self.controller.axes.y is not None or self.attitude.y is not None:
            raise ValueError("a rig has one axis: remove controller.axes.y and attitude.y")
        limits, hover = self.controller.limits, self.vehicle.hover_thrust
        if not limits.thrust_min < hover < limits.thrust_max:
            raise ValueError("vehicle.hover_thrust must lie between controller.limits.thrust_min and thrust_max")
        if (self.link.system_id, self.link.component_id) == (self.vehicle.system_id, self.vehicle.component_id):
            raise ValueError("link.system_id and component_id are the vehicle's own: the companion needs others")
        reach = max((math.hypot(*waypoint.offset_ned_m[:2]) for waypoint in self.mission.waypoints), default=0.0)
        if reach > self.controller.envelope.position_m:
            raise ValueError(
                f"a waypoint lies {reach:g} m from where control begins, beyond controller.envelope.position_m "
                f"({self.controller.envelope.position_m:g}), for which the adaptation rate is checked"
            )
        if self.plant is not None and (self.plant.rig is None) == (self.vehicle.kind == "rig"):
            raise ValueError(f"plant: give the {self.vehicle.kind}, as vehicle.kind says")
        return self
