"""The `plant` section: the simulated vehicle that `companion sitl` flies. The real vehicle never reads it."""

from __future__ import annotations

from pydantic import Field, model_validator

from companion.config.base import NonNegative, Positive, Section


class Angle(Section):
    """How one angle follows its set-point when the attitude loop is replaced by a linear response."""

    bandwidth_rad_s: Positive | None = None
    natural_frequency_rad_s: Positive | None = None
    damping_ratio: Positive | None = None

    @model_validator(mode="after")
    def _one_of_two(self) -> Angle:
        second = self.natural_frequency_rad_s is not None and self.damping_ratio is not None
        partly = self.natural_frequency_rad_s is not None or self.damping_ratio is not None
        if (self.bandwidth_rad_s is not None) == second or partly != second:
            raise ValueError("give either bandwidth_rad_s, or natural_frequency_rad_s and damping_ratio")
        return self


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


class Plant(Section):
    """One of the two, the transport delay in front of its attitude loop, and its autopilot's parameters."""

    rig: RigPlant | None = None
    quadrotor: QuadrotorPlant | None = None
    setpoint_delay_s: NonNegative = 0.0
    parameters: dict[str, int | float] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _one_vehicle(self) -> Plant:
        if (self.rig is None) == (self.quadrotor is None):
            raise ValueError("give either rig or quadrotor")
        return self
