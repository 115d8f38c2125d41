"""What a config file may say. Units are in the names.

The text below a key is its description in `docs/config.md`, which `companion.config.reference` writes. It begins with
the unit in brackets where the key's name has none; [1] is a pure number.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from companion.config.attitude import AttitudeSection
from companion.config.base import NUMBER, Id, Number, Positive, Section
from companion.config.consistency import check_delay, check_fence, check_guards, check_steering
from companion.config.controller import ControllerSection
from companion.config.estimator import EstimatorSection
from companion.config.guards.rows import Guards
from companion.config.link import LinkSection, TickSection
from companion.config.mission import MissionSection
from companion.config.mission.flown import check_trajectories
from companion.config.plant import Plant
from companion.config.reach import amplitude_deg, check_reach
from companion.config.service import LogSection, ReleaseSection, ServiceSection, SteeringSection
from companion.config.vehicles import VEHICLE_KINDS, VehicleKind, VehicleName

ParameterName = Annotated[str, Field(pattern="^[A-Z0-9_]{1,16}$")]


class VehicleSection(Section):
    """The vehicle and where it is on MAVLink."""

    kind: VehicleName
    """What it can do: a rig moves along one guide at hover thrust, a quadrotor flies free."""
    hover_thrust: Annotated[float, Field(gt=0.0, lt=1.0), NUMBER]
    """[1] Normalised thrust that carries the weight. It lies between `controller.limits.thrust_min` and
    `thrust_max`."""
    hover_thrust_source: Literal["config", "parameter", "estimated"] = "config"
    """What is believed. `config`: the value above. `parameter`: PX4's MPC_THR_HOVER, or the value above where it is not
    answered or more than 20 % off. `estimated`: begins with what the vehicle hovers at in stand-by, or with either, and
    is then estimated in flight; not for a rig. Control begins with the thrust that the vehicle hovers at, whatever is
    believed."""
    system_id: Id = 1
    """MAVLink system id of the autopilot. Nobody else is believed."""
    component_id: Id = 1
    """MAVLink component id of the autopilot."""
    parameters: dict[ParameterName, Number] = Field(default_factory=dict)
    """PX4 parameters, the attitude gains above all, as they were when the response was identified. Where the vehicle's
    differ `companion run` refuses (`certificate_stale`). Gains that are not stated are read before stand-by and pinned:
    a change from then on counts the same."""
    px4_version: Annotated[str, Field(pattern=r"^\d+\.\d+$")] | None = None
    """PX4's version when the response was identified, as "1.17": another one answers otherwise, and `companion run`
    refuses it (`certificate_stale`). Left out: any."""


class PaperMetrics(Section):
    """One controller's row in a table of the paper: error against the ideal reference."""

    peak_error_m: Positive
    """Largest error."""
    rms_error_m: Positive
    """Root mean square of the error."""


class PaperSection(Section):
    """The paper's figures, which `companion sitl` sets ours beside."""

    table: str
    """Title of the table."""
    hedged: PaperMetrics
    """What the paper gives for the hedged controller."""
    standard: PaperMetrics
    """What the paper gives for the standard controller."""
    figures: dict[str, str] = Field(default_factory=dict)
    """Title of each figure to draw, by controller and axis, as in `hedged_x: Figure 6`."""


class Config(Section):
    """A whole config file."""

    vehicle: VehicleSection
    """The vehicle, and where it is on MAVLink."""
    link: LinkSection
    """The way to the autopilot."""
    tick: TickSection
    """How often the loop runs."""
    controller: ControllerSection
    """The position controller."""
    attitude: AttitudeSection
    """The tuned attitude loop."""
    estimator: EstimatorSection | None = None
    """How wrong the estimate is, for `companion design`."""
    mission: MissionSection = MissionSection()
    """What to fly."""
    guards: Guards = Guards()
    """What ends control."""
    release: ReleaseSection = ReleaseSection()
    """What is asked for then."""
    steering: SteeringSection = SteeringSection()
    """Who may move the set-point live."""
    service: ServiceSection = ServiceSection()
    """What is asked of the operating system."""
    log: LogSection = LogSection()
    """How much of the disk flights may take."""
    plant: Plant | None = None
    """The simulated vehicle."""
    paper: PaperSection | None = None
    """The paper's figures."""

    @property
    def vehicle_kind(self) -> VehicleKind:
        """What the vehicle can do."""
        return VEHICLE_KINDS[self.vehicle.kind]

    @model_validator(mode="after")
    def _axes_of_the_vehicle(self) -> Config:
        kind, controller = self.vehicle_kind, self.controller
        if kind.one_axis:
            if controller.axes.y is not None or self.attitude.y is not None:
                raise ValueError(f"a {kind.name} has one axis: remove controller.axes.y and attitude.y")
        elif controller.axes.y is None or self.attitude.y is None or controller.altitude is None:
            raise ValueError(f"a {kind.name} needs controller.axes.y, controller.altitude and attitude.y")
        limits, hover = self.controller.limits, self.vehicle.hover_thrust
        if not limits.thrust_min < hover < limits.thrust_max:
            raise ValueError("vehicle.hover_thrust must lie between controller.limits.thrust_min and thrust_max")
        if (self.link.system_id, self.link.component_id) == (self.vehicle.system_id, self.vehicle.component_id):
            raise ValueError("link.system_id and component_id are the vehicle's own: the companion needs others")
        check_guards(self.guards, self.controller, self.tick)
        check_fence(self.guards.fence, self.mission)
        check_steering(self.steering, self.guards.fence, self.controller)
        check_reach(self.controller, self.mission)
        if self.mission.trajectories:
            if kind.one_axis:
                raise ValueError(f"a {kind.name} flies along one axis: mission.trajectories are for free flight")
            check_trajectories(self.mission, self.controller, self.attitude, self.guards.fence, hover)
        flown = self.mission.identification
        if flown is not None:
            amplitude_deg(self.controller, self.guards.fence, flown)  # or it raises
        check_delay(self.guards, self.attitude)
        if kind.one_axis and (
            self.vehicle.hover_thrust_source == "estimated"
            or any(w.yaw_deg is not None for w in self.mission.waypoints)
        ):
            raise ValueError(f"a {kind.name} keeps its thrust and its heading: no estimated hover thrust, no yaw_deg")
        if self.plant is not None and self.plant.kind is not kind:
            raise ValueError(f"plant: give the {kind.name}, as vehicle.kind says")
        return self
