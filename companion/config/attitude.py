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
    """First order: the M of (18)."""
    natural_frequency_rad_s: Range | None = None
    """Second order: its natural frequency. Needs `damping_ratio` beside it."""
    damping_ratio: Range | None = None
    """[1] Second order: its damping ratio. Needs `natural_frequency_rad_s` beside it."""
    numerator: tuple[Coefficient, ...] | None = None
    """[1] Transfer function: coefficients of the numerator in s (rad/s), highest power first. The last one equals that
    of the denominator: unit gain at rest."""
    denominator: tuple[Coefficient, ...] | None = None
    """[1] Transfer function: coefficients of the denominator, highest power first, up to the sixth."""
    delay_s: NonNegative | tuple[NonNegative, NonNegative] = 0.0
    """Transport delay of vehicle and link together, both ways. What the certificate leaves of it to the link is the
    default limit of `guards.link_delay_s`."""
    pade_order: Annotated[int, Field(ge=1, le=4)] = 1
    """Order of the Pade approximant that stands for the delay in the certificate. Each order adds a state."""

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
    """The tuned closed loop from attitude set-point to attitude: what the certificate is about. x is pitch, y is roll.

    `companion identify LOG --config FILE --write` fills it in.
    """

    x: ResponseSection
    """The response in pitch."""
    y: ResponseSection | None = None
    """The response in roll. A quadrotor needs it, a rig must not have it."""
    yaw_free: bool = False
    """Certify both responses for any angle between nose and control frame, whose x and y turn with the heading's
    set-point. Without it the certificate takes for granted that the nose points along the frame."""


class EnvelopeSection(Section):
    """The flight envelope of an axis, over which the sampled adaptation is checked. `guards.envelope` watches it."""

    position_m: Positive
    """Largest distance from the anchor along one axis."""
    velocity_m_s: Positive
    """Largest speed along one axis."""
