"""The `plant` section: the simulated vehicle that `companion sitl` flies. The real vehicle never reads it."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from companion.attitude_response.kind import LinearResponse, ParametricKind
from companion.config.attitude import ResponseKeys
from companion.config.base import Fraction, NonNegative, Positive, Section, Vector


class Angle(ResponseKeys[Positive]):
    """How one angle follows its set-point when the attitude loop is replaced by a linear response."""

    delay_s: Annotated[NonNegative, Field(le=0.5)] = 0.0
    """Transport delay of this angle, on top of `setpoint_delay_s`."""

    @property
    def response(self) -> LinearResponse:
        """The response without its delay."""
        kind = self.kind
        assert issubclass(kind, ParametricKind)  # the section has the keys of no other
        return LinearResponse(kind, self.values)


class RateLoop(Section):
    """PI_R and D_R of (7) over the inertia."""

    proportional_1_s: Positive
    integral_1_s2: NonNegative = 0.0
    derivative: NonNegative = 0.0
    filter_bandwidth_rad_s: Positive = 100.0
    integral_limit_rad_s2: NonNegative = 10.0


class Cascade(Section):
    """The attitude cascade (7): K_p^R as its gain about each axis, and one rate loop for all."""

    roll_gain_1_s: Positive = 6.0
    pitch_gain_1_s: Positive = 6.0
    yaw_gain_1_s: Positive = 3.0
    rate: RateLoop


class RigPlant(Section):
    """(27)-(28) with the friction of its guides, over the mass."""

    viscous_friction_1_s: NonNegative
    coulomb_friction_m_s2: NonNegative
    coulomb_width_m_s: Positive = 0.005
    pitch: Angle | None = None
    cascade: Cascade | None = None

    @model_validator(mode="after")
    def _one_loop(self) -> RigPlant:
        if (self.pitch is None) == (self.cascade is None):
            raise ValueError("give either the linear response (pitch) or the cascade")
        return self


class QuadrotorPlant(Section):
    """(1)-(2) with body drag."""

    mass_kg: Positive
    drag_n_s2_m2: NonNegative
    inertia_kg_m2: tuple[Positive, Positive, Positive]
    roll: Angle | None = None
    pitch: Angle | None = None
    yaw: Angle | None = None
    cascade: Cascade | None = None

    @model_validator(mode="after")
    def _one_loop(self) -> QuadrotorPlant:
        linear = [angle is not None for angle in (self.roll, self.pitch, self.yaw)]
        if all(linear) == (self.cascade is not None) or any(linear) != all(linear):
            raise ValueError("give either the linear responses (roll, pitch and yaw) or the cascade")
        return self


class MismatchSection(Section):
    """What the vehicle really has, over what this file says and autopilot and companion believe."""

    mass: Positive = 1.0
    thrust: Positive = 1.0  # at the same set-point
    drag: NonNegative = 1.0


class GustSection(Section):
    """A gust of 1-cosine shape (MIL-F-8785C, 3.7.1.3) that rises, stays and falls; again every `every_s`."""

    peak_ned_m_s: Vector
    start_s: NonNegative = 0.0
    rise_s: Positive = 1.0
    hold_s: NonNegative = 0.0
    every_s: NonNegative = 0.0  # 0: once


class TurbulenceSection(Section):
    """Dryden turbulence at low altitude (MIL-F-8785C, 3.7.3.4)."""

    wind_at_20_ft_m_s: NonNegative  # its intensity: light 7.7, moderate 15.4
    altitude_m: Positive = 6.0


class WindSection(Section):
    """Wind, acting through `quadrotor.drag_n_s2_m2`; vectors say where the air goes to."""

    mean_ned_m_s: Vector = (0.0, 0.0, 0.0)
    gust: GustSection | None = None
    turbulence: TurbulenceSection | None = None


class SensorsSection(Section):
    """How the estimate differs from the truth: standard deviations per axis, and its age."""

    position_m: NonNegative = 0.0
    velocity_m_s: NonNegative = 0.0
    attitude_deg: NonNegative = 0.0
    correlation_s: Positive = 0.5
    delay_s: Annotated[NonNegative, Field(le=0.5)] = 0.0
    jitter_s: Annotated[NonNegative, Field(le=0.5)] = 0.0


class DirectionSection(Section):
    """What frames meet on their way in one direction; chances are per frame."""

    delay_s: NonNegative = 0.0
    jitter_s: NonNegative = 0.0  # uniform, on top of the delay; frames keep their order
    loss: Fraction = 0.0
    burst_begins: Fraction = 0.0  # Gilbert-Elliott: from good to bad, where everything is lost,
    burst_ends: Fraction = 1.0  # and back
    duplication: Fraction = 0.0
    reordering: Fraction = 0.0
    corruption: Fraction = 0.0  # one to eight flipped bits


class RadioSection(Section):
    """The link between autopilot and companion."""

    down: DirectionSection = DirectionSection()  # autopilot to companion
    up: DirectionSection = DirectionSection()


class Plant(Section):
    """One of the two vehicles, its autopilot's parameters, and everything that keeps it from being ideal."""

    rig: RigPlant | None = None
    quadrotor: QuadrotorPlant | None = None
    setpoint_delay_s: NonNegative = 0.0  # transport delay in front of the attitude loop
    parameters: dict[str, int | float] = Field(default_factory=dict)
    seed: int = 1  # of all that is random: the same seed gives the same flight
    mismatch: MismatchSection = MismatchSection()
    wind: WindSection | None = None
    battery_sag_1_s: NonNegative = 0.0  # share of the thrust lost a second
    sensors: SensorsSection | None = None
    link: RadioSection | None = None

    @model_validator(mode="after")
    def _one_vehicle(self) -> Plant:
        if (self.rig is None) == (self.quadrotor is None):
            raise ValueError("give either rig or quadrotor")
        if self.rig is not None and self.wind is not None:
            raise ValueError("wind does not reach a rig: its guides hold it")
        return self
