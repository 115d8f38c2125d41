"""The `plant` section: the simulated vehicle that `companion sitl` flies. The real vehicle never reads it."""

from __future__ import annotations

from typing import Annotated, Literal

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
    """The rate loop, PI_R and D_R of (7) over the inertia: angular acceleration from rate error. One for all axes."""

    proportional_1_s: Positive
    """Angular acceleration per rad/s of rate error."""
    integral_1_s2: NonNegative = 0.0
    """Angular acceleration per radian of rate error added up."""
    derivative: NonNegative = 0.0
    """[1] Angular acceleration against a measured one, which is filtered."""
    filter_bandwidth_rad_s: Positive = 100.0
    """Bandwidth of the derivative's filter."""
    integral_limit_rad_s2: NonNegative = 10.0
    """Largest angular acceleration that the integrator may hold."""


class Cascade(Section):
    """The attitude cascade (7): K_p^R as its gain about each axis, and one rate loop for all."""

    roll_gain_1_s: Positive = 6.0
    """Roll rate wanted per radian of error."""
    pitch_gain_1_s: Positive = 6.0
    """Pitch rate wanted per radian of error."""
    yaw_gain_1_s: Positive = 3.0
    """Yaw rate wanted per radian of error."""
    rate: RateLoop
    """The rate loop."""


class RigPlant(Section):
    """The ANT-X rig, (27)-(28) with the friction of its guides, over the mass. `pitch` or `cascade`."""

    viscous_friction_1_s: NonNegative
    """Deceleration of the guides per m/s."""
    coulomb_friction_m_s2: NonNegative
    """Deceleration of the guides at any speed."""
    coulomb_width_m_s: Positive = 0.005
    """Speed over which Coulomb friction changes its sign, as tanh(v / width)."""
    pitch: Angle | None = None
    """Pitch as a linear response."""
    cascade: Cascade | None = None
    """Pitch by the paper's attitude cascade; of the gains only that of pitch counts."""

    @model_validator(mode="after")
    def _one_loop(self) -> RigPlant:
        if (self.pitch is None) == (self.cascade is None):
            raise ValueError("give either the linear response (pitch) or the cascade")
        return self


class QuadrotorPlant(Section):
    """The 6-DoF quadrotor, (1)-(2) with body drag. `roll`, `pitch` and `yaw`, or `cascade`."""

    mass_kg: Positive
    """Mass."""
    drag_n_s2_m2: NonNegative
    """Drag c_D in -c_D |v| v, with the velocity v against the air. Wind acts through it."""
    inertia_kg_m2: tuple[Positive, Positive, Positive]
    """Moments of inertia about the body's x, y and z. Only the cascade needs them."""
    roll: Angle | None = None
    """Roll as a linear response."""
    pitch: Angle | None = None
    """Pitch as a linear response."""
    yaw: Angle | None = None
    """Yaw as a linear response."""
    cascade: Cascade | None = None
    """All three by the paper's attitude cascade."""

    @model_validator(mode="after")
    def _one_loop(self) -> QuadrotorPlant:
        linear = [angle is not None for angle in (self.roll, self.pitch, self.yaw)]
        if all(linear) == (self.cascade is not None) or any(linear) != all(linear):
            raise ValueError("give either the linear responses (roll, pitch and yaw) or the cascade")
        return self


class MismatchSection(Section):
    """What a quadrotor really has, over what this file says and autopilot and companion believe."""

    mass: Positive = 1.0
    """[1] True mass over `mass_kg`."""
    thrust: Positive = 1.0
    """[1] True thrust over the one believed, at the same set-point."""
    drag: NonNegative = 1.0
    """[1] True drag over `drag_n_s2_m2`."""


class GustSection(Section):
    """A gust of 1-cosine shape (MIL-F-8785C, 3.7.1.3) that rises, stays and falls; again every `every_s`."""

    peak_ned_m_s: Vector
    """What it adds to the mean wind at its peak."""
    start_s: NonNegative = 0.0
    """When it begins, since the plant's boot."""
    rise_s: Positive = 1.0
    """How long it rises, and falls."""
    hold_s: NonNegative = 0.0
    """How long it stays at its peak."""
    every_s: NonNegative = 0.0
    """From one beginning to the next; 0: it comes once."""


class TurbulenceSection(Section):
    """Dryden turbulence at low altitude (MIL-F-8785C, 3.7.3.4)."""

    wind_at_20_ft_m_s: NonNegative
    """Its intensity, as the wind speed at 20 ft: light 7.7, moderate 15.4."""
    altitude_m: Positive = 6.0
    """Height at which its scale lengths are taken."""


class WindSection(Section):
    """Wind, acting through `quadrotor.drag_n_s2_m2`; vectors say where the air goes to. A rig has none."""

    mean_ned_m_s: Vector = (0.0, 0.0, 0.0)
    """The steady wind."""
    gust: GustSection | None = None
    """A gust on top of it."""
    turbulence: TurbulenceSection | None = None
    """Turbulence on top of it."""


class SensorsSection(Section):
    """How the estimate differs from the truth: the errors of an estimator, plain noise on top of them, and its age.

    Left out, autopilot and companion see the truth.
    """

    preset: Literal["gps", "rtk", "optical_flow", "motion_capture"] | None = None
    """What aids the estimator. Position and velocity errors then have the sizes, the correlation and the times that
    PX4's EKF2 has with it; `docs/plant.md` says where they are from."""
    position_m: NonNegative = 0.0
    """Standard deviation of the position."""
    velocity_m_s: NonNegative = 0.0
    """Standard deviation of the velocity."""
    attitude_deg: NonNegative = 0.0
    """Standard deviation of roll, pitch and yaw."""
    correlation_s: Positive = 0.5
    """Correlation time of the noise."""
    delay_s: Annotated[NonNegative, Field(le=0.5)] = 0.0
    """How old the state is that is reported as the present one."""
    jitter_s: Annotated[NonNegative, Field(le=0.5)] = 0.0
    """Largest random age on top of the delay, uniform."""


class DirectionSection(Section):
    """What frames meet on their way in one direction; chances are per frame."""

    delay_s: NonNegative = 0.0
    """How long a frame is on its way."""
    jitter_s: NonNegative = 0.0
    """Largest random time on top of the delay, uniform. Frames keep their order."""
    loss: Fraction = 0.0
    """[1] Chance to be lost."""
    burst_begins: Fraction = 0.0
    """[1] Gilbert-Elliott: chance that a burst begins, in which everything is lost."""
    burst_ends: Fraction = 1.0
    """[1] Gilbert-Elliott: chance that the burst ends."""
    duplication: Fraction = 0.0
    """[1] Chance to arrive twice."""
    reordering: Fraction = 0.0
    """[1] Chance to be overtaken: to arrive 20 ms later than it would."""
    corruption: Fraction = 0.0
    """[1] Chance of one to eight flipped bits."""


class RadioSection(Section):
    """The link between autopilot and companion."""

    down: DirectionSection = DirectionSection()
    """Autopilot to companion."""
    up: DirectionSection = DirectionSection()
    """Companion to autopilot."""


class Plant(Section):
    """The vehicle that `companion sitl` simulates: one of the two kinds, its autopilot's parameters, and everything
    that keeps it from being ideal. The real vehicle never reads it."""

    rig: RigPlant | None = None
    """The rig, where `vehicle.kind` is `rig`."""
    quadrotor: QuadrotorPlant | None = None
    """The quadrotor, where `vehicle.kind` is `quadrotor`."""
    setpoint_delay_s: NonNegative = 0.0
    """Transport delay of set-points in front of the attitude loop."""
    parameters: dict[str, int | float] = Field(default_factory=dict)
    """PX4 parameters by name, those that the plant has. The others keep the defaults of PX4 v1.17."""
    seed: int = 1
    """Of all that is random. The same seed gives the same flight."""
    mismatch: MismatchSection = MismatchSection()
    """The true vehicle against the believed one."""
    wind: WindSection | None = None
    """Wind."""
    battery_sag_1_s: NonNegative = 0.0
    """Share of the thrust lost a second."""
    sensors: SensorsSection | None = None
    """Noise and age of the estimate."""
    link: RadioSection | None = None
    """What the radio does to frames."""

    @model_validator(mode="after")
    def _one_vehicle(self) -> Plant:
        if (self.rig is None) == (self.quadrotor is None):
            raise ValueError("give either rig or quadrotor")
        if self.rig is not None and self.wind is not None:
            raise ValueError("wind does not reach a rig: its guides hold it")
        return self
