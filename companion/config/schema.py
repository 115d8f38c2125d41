"""What a config file may say. Units are in the names; the shipped files in `config/` explain each key by example."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from companion.config.attitude import AttitudeSection
from companion.config.base import Id, Number, Positive, Section
from companion.config.consistency import check_delay, check_fence, check_guards, check_steering
from companion.config.controller import ControllerSection
from companion.config.guards.rows import Guards
from companion.config.link import LinkSection, TickSection
from companion.config.mission import MissionSection
from companion.config.plant import Plant
from companion.config.reach import amplitude_deg, check_reach
from companion.config.service import ReleaseSection, ServiceSection, SteeringSection

ParameterName = Annotated[str, Field(pattern="^[A-Z0-9_]{1,16}$")]


class VehicleSection(Section):
    """The vehicle and where it is on MAVLink."""

    kind: Literal["rig", "quadrotor"]
    hover_thrust: Annotated[float, Field(gt=0.0, lt=1.0)]
    # What is flown: the value above; PX4's MPC_THR_HOVER, with the value above where it is not answered; or what is
    # estimated in flight, beginning with either.
    hover_thrust_source: Literal["config", "parameter", "estimated"] = "config"
    system_id: Id = 1
    component_id: Id = 1
    parameters: dict[ParameterName, Number] = Field(default_factory=dict)  # PX4's, when its response was identified


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
    release: ReleaseSection = ReleaseSection()
    steering: SteeringSection = SteeringSection()
    service: ServiceSection = ServiceSection()
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
        check_guards(self.guards, self.controller, self.tick)
        check_fence(self.guards.fence, self.mission)
        check_steering(self.steering, self.guards.fence, self.controller)
        check_reach(self.controller, self.mission)
        flown = self.mission.identification
        if flown is not None:
            amplitude_deg(self.controller, self.guards.fence, flown)  # or it raises
        check_delay(self.guards, self.attitude)
        if self.vehicle.kind == "rig" and (
            self.vehicle.hover_thrust_source == "estimated"
            or any(w.yaw_deg is not None for w in self.mission.waypoints)
        ):
            raise ValueError("a rig keeps its thrust and its heading: no estimated hover thrust, no yaw_deg")
        if self.plant is not None and (self.plant.rig is None) == (self.vehicle.kind == "rig"):
            raise ValueError(f"plant: give the {self.vehicle.kind}, as vehicle.kind says")
        return self
