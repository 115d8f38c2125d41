"""The `controller` section: the paper's reference models, projection and adaptation, and what is never asked for."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from companion.config.attitude import EnvelopeSection
from companion.config.base import NUMBER, Fraction, NonNegative, Number, Positive, Section


class AdaptationRates(Section):
    """γ of (22), which the two controllers may not share: γ_H and γ_M of the paper."""

    hedged: NonNegative
    """[1] With hedging. `companion check` refuses one that is unstable at `tick.floor_hz` within the envelope."""
    standard: NonNegative
    """[1] Without hedging."""


Bound = Positive | tuple[Number, Number]


class AxisSection(Section):
    """Reference model, adaptation and projection of one horizontal axis."""

    natural_frequency_rad_s: Positive
    """Natural frequency of the reference model, ωn of (19): how fast the vehicle is to answer."""
    damping_ratio: Positive
    """[1] Damping ratio of the reference model, ζ of (19)."""
    position_weight_bound: Bound
    """[1/m] Projection bounds of the weight on position, whose nominal value is ωn²/g. One number is plus and minus it.
    The upper bound costs attitude bandwidth."""
    velocity_weight_bound: Bound
    """[s/m] Projection bounds of the weight on velocity, whose nominal value is 2ζωn/g."""
    adaptation_rate: AdaptationRates
    """γ of (22) for the weights on position and velocity."""
    lyapunov_q: tuple[Positive, Positive] = (1.0, 1.0)
    """[1] Diagonal of Q in (23), for position and velocity: what the adaptation weighs of the error."""

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
    """The horizontal axes of the control frame, which turns with the heading. x is pitch, y is roll."""

    x: AxisSection
    """Forward, by pitch."""
    y: AxisSection | None = None
    """To the right, by roll. A quadrotor needs it, a rig must not have it."""


class AltitudeSection(Section):
    """The altitude cascade (4), its gains over the mass: climb rate from height error, vertical force from climb rate.

    A quadrotor needs it; a rig, whose thrust stays at hover, does not read it.
    """

    position_gain_1_s: NonNegative
    """Climb rate wanted per metre of height error."""
    velocity_gain_1_s: NonNegative
    """Acceleration per m/s of climb rate error."""
    integral_gain_1_s2: NonNegative
    """Acceleration per metre of climb rate error added up."""
    derivative_gain: NonNegative = 0.0
    """[1] Acceleration asked for against a measured one, which is filtered."""
    filter_bandwidth_rad_s: Positive = 30.0
    """Bandwidth of the derivative's filter, T of sT/(s + T)."""
    integral_limit_m_s2: NonNegative = 3.0
    """Largest acceleration, up or down, that the integrator may hold: what a wrong hover thrust may cost."""
    velocity_limit_m_s: Positive = 1.0
    """Largest climb or sink rate asked for."""


class BiasSection(Section):
    """A weight on the regressor 1 on each horizontal axis, with its own projection: it takes up constant forces.

    Left out, nothing does: a steady wind or a crooked mount leaves an offset.
    """

    bound: Positive
    """[g] Largest steady push it holds against, as specific force over g. 0.2 is what accelerates the vehicle at
    0.2 g."""
    adaptation_rate: AdaptationRates
    """γ of (22) for this weight. The sampled check adds it to that of the axes."""


class Limits(Section):
    """What the controller never asks for. Altitude comes first; a horizontal force that is cut keeps its direction."""

    tilt_deg: Annotated[float, Field(gt=0.0, le=60.0), NUMBER] = 35.0
    """Largest tilt of the thrust. `guards.tilt_deg` must lie above it."""
    thrust_min: Annotated[Fraction, Field(gt=0.0)] = 0.05
    """[1] Smallest collective thrust, normalised."""
    thrust_max: Fraction = 0.95
    """[1] Largest collective thrust, normalised."""
    acceleration_m_s2: Positive | None = None
    """Largest horizontal acceleration asked for. Left out: as much as tilt and thrust allow."""
    yaw_rate_deg_s: Positive = 45.0
    """How fast the flown heading turns towards the one wanted."""
    speed_m_s: Positive | None = None
    """How fast the flown set-point travels, on a straight line in space, to the one wanted. Left out: it jumps. At most
    `envelope.velocity_m_s`."""

    @model_validator(mode="after")
    def _in_order(self) -> Limits:
        if self.thrust_min >= self.thrust_max:
            raise ValueError("thrust_min must be below thrust_max")
        return self


class EstimateCorrectionSection(Section):
    """Corrects position and velocity by how much they disagree; `companion.control.estimate_correction`."""

    filter_s: Positive = 0.3
    """Time constant of the low pass on the disagreement."""
    position_gain_s: NonNegative = 0.75
    """Metres added to the position for each m/s by which it moves faster than the velocity says. The best is one over
    the gain of the estimator from innovation to position: 0.75 s for PX4's EKF2 with GPS."""
    velocity_gain: NonNegative = 1.0
    """[1] Share of the disagreement that is added to the velocity. One: at low frequency the velocity is the slope of
    the position."""
    limit_m_s: Positive = 0.6
    """Largest disagreement that is believed. A healthy EKF2 with GPS shows 0.6 m/s at most; what is more is a jump or a
    slide, and the guards' business."""


class ControllerSection(Section):
    """The position controller."""

    hedging: bool = True
    """Hedged MRAC, which the certificate is about. `false`: standard MRAC, for comparison."""
    anchor: Literal["engage", "setpoint"] = "setpoint"
    """Where the regressors are measured from. `engage`: where control began, as in the paper. `setpoint`: from the
    flown set-point, so that the adaptation is as fast everywhere."""
    initial_weights: Literal["zero", "nominal"] = "nominal"
    """Ŵ(0) of (22). `zero`: as in the paper, no feedback at first. `nominal`: feedback from the first tick."""
    estimate_correction: EstimateCorrectionSection | None = None
    """Corrects what the estimator says of position and velocity. Left out, it is believed as it is."""
    axes: Axes
    """Reference model and adaptation of each axis."""
    bias: BiasSection | None = None
    """A weight against constant forces."""
    envelope: EnvelopeSection
    """How far and how fast the regressors may go."""
    altitude: AltitudeSection | None = None
    """Gains of the altitude cascade."""
    limits: Limits = Limits()
    """What is never asked for."""
