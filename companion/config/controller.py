"""The `controller` section: the paper's reference models, projection and adaptation, and what is never asked for."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from companion.config.attitude import EnvelopeSection
from companion.config.base import Fraction, NonNegative, Positive, Section


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


class BiasSection(Section):
    """A weight on the regressor 1 on each horizontal axis, with its own projection: it takes up constant forces."""

    bound: Positive  # specific force over g: 0.2 holds against what would push the vehicle away at 0.2 g
    adaptation_rate: AdaptationRates


class Limits(Section):
    """What the controller never asks for. Without a speed the set-point jumps to the target."""

    tilt_deg: Annotated[float, Field(gt=0.0, le=60.0)] = 35.0
    thrust_min: Annotated[Fraction, Field(gt=0.0)] = 0.05
    thrust_max: Fraction = 0.95
    acceleration_m_s2: Positive | None = None  # horizontal
    yaw_rate_deg_s: Positive = 45.0  # of the flown heading
    speed_m_s: Positive | None = None  # of the flown set-point, on a straight line to the target

    @model_validator(mode="after")
    def _in_order(self) -> Limits:
        if self.thrust_min >= self.thrust_max:
            raise ValueError("thrust_min must be below thrust_max")
        return self


class ControllerSection(Section):
    """The position controller.

    `anchor`: where the regressors are measured from. `engage` is the paper's, where control began; `setpoint` goes
    along with the flown set-point, so that the adaptation is as fast everywhere.
    """

    hedging: bool = True
    anchor: Literal["engage", "setpoint"] = "setpoint"
    initial_weights: Literal["zero", "nominal"] = "nominal"
    axes: Axes
    bias: BiasSection | None = None
    envelope: EnvelopeSection
    altitude: AltitudeSection | None = None
    limits: Limits = Limits()
