"""What a config file may say. Units are in the names; the shipped files in `config/` explain each key by example."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import Field, model_validator

from companion.config.attitude import AttitudeSection
from companion.config.base import Id, Positive, Section
from companion.config.controller import ControllerSection
from companion.config.guards import Guards
from companion.config.link import LinkSection, TickSection
from companion.config.mission import MissionSection
from companion.config.plant import Plant


class VehicleSection(Section):
    """The vehicle and where it is on MAVLink."""

    kind: Literal["rig", "quadrotor"]
    hover_thrust: Annotated[float, Field(gt=0.0, lt=1.0)]
    system_id: Id = 1
    component_id: Id = 1


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
