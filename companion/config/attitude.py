"""The `attitude` section: the tuned closed-loop attitude response per axis, as numbers or as identified intervals."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from companion.config.base import NonNegative, Number, Positive, Section

Range = Positive | tuple[Positive, Positive]
Coefficient = Number | tuple[Number, Number]


class ResponseSection(Section):
    """One axis: first order, second order, or a transfer function; each with a transport delay.

    A parameter is a value or an interval `[lower, upper]`, whose ends are certified too.
    """

    bandwidth_rad_s: Range | None = None
    natural_frequency_rad_s: Range | None = None
    damping_ratio: Range | None = None
    numerator: tuple[Coefficient, ...] | None = None  # highest power of s first
    denominator: tuple[Coefficient, ...] | None = None
    delay_s: NonNegative | tuple[NonNegative, NonNegative] = 0.0
    pade_order: Annotated[int, Field(ge=1, le=4)] = 1

    @model_validator(mode="after")
    def _one_kind(self) -> ResponseSection:
        kinds = {
            "first order": (self.bandwidth_rad_s,),
            "second order": (self.natural_frequency_rad_s, self.damping_ratio),
            "transfer function": (self.numerator, self.denominator),
        }
        given = [name for name, values in kinds.items() if any(value is not None for value in values)]
        if len(given) != 1 or any(value is None for value in kinds[given[0]]):
            raise ValueError(
                "give bandwidth_rad_s, or natural_frequency_rad_s and damping_ratio, or numerator and denominator"
            )
        return self


class AttitudeSection(Section):
    """x is pitch, y is roll."""

    x: ResponseSection
    y: ResponseSection | None = None
    yaw_free: bool = False  # certify both for any angle to the control frame, which turns with the set-point


class EnvelopeSection(Section):
    """The flight envelope of one axis, over which the sampled adaptation is checked."""

    position_m: Positive  # largest distance from the anchor
    velocity_m_s: Positive
