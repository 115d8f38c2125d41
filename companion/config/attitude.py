"""The `attitude` section: the tuned closed-loop attitude response per axis, as numbers or as identified intervals."""

from __future__ import annotations

from typing import Annotated, Any, Generic, TypeVar

from pydantic import Field, model_validator

from companion.attitude_response.exact import NO_DELAY, Interval
from companion.attitude_response.exact import interval as exact_interval
from companion.attitude_response.kind import Kind
from companion.attitude_response.kinds import KINDS
from companion.attitude_response.response import AttitudeResponse
from companion.config.base import NonNegative, Number, Positive, Section

Range = Positive | tuple[Positive, Positive]
Coefficient = Number | tuple[Number, Number]
T = TypeVar("T")


class ResponseKeys(Section, Generic[T]):
    """The keys of a response whose kind a few numbers describe: those of exactly one kind, all of them."""

    bandwidth_rad_s: T | None = None
    """First order: the M of (18)."""
    natural_frequency_rad_s: T | None = None
    """Second order: its natural frequency. Needs `damping_ratio` beside it."""
    damping_ratio: T | None = None
    """[1] Second order: its damping ratio. Needs `natural_frequency_rad_s` beside it."""

    @classmethod
    def kinds(cls) -> tuple[type[Kind], ...]:
        """The kinds whose keys this section has."""
        return tuple(kind for kind in KINDS if cls.model_fields.keys() >= set(kind.key_names()))

    @property
    def kind(self) -> type[Kind]:
        """The kind whose keys are given."""
        given = self._given()
        return next(kind for kind in self.kinds() if set(kind.key_names()) == given)

    @property
    def values(self) -> tuple[Any, ...]:
        """What is given, in the order of the kind's keys."""
        return tuple(getattr(self, key) for key in self.kind.key_names())

    def _given(self) -> set[str]:
        return {key for kind in self.kinds() for key in kind.key_names() if getattr(self, key) is not None}

    @model_validator(mode="after")
    def _one_kind(self) -> ResponseKeys[T]:
        keys = [kind.key_names() for kind in self.kinds()]
        if self._given() not in map(set, keys):
            raise ValueError("give " + ", or ".join(" and ".join(each) for each in keys))
        return self


class ResponseSection(ResponseKeys[Range]):
    """One axis: first order, second order, or a transfer function; each with a transport delay.

    A parameter is a value or an interval `[lower, upper]`, whose ends are certified too.
    """

    numerator: tuple[Coefficient, ...] | None = None
    """[1] Transfer function: coefficients of the numerator in s (rad/s), highest power first. The last one equals that
    of the denominator: unit gain at rest."""
    denominator: tuple[Coefficient, ...] | None = None
    """[1] Transfer function: coefficients of the denominator, highest power first, up to the sixth."""
    delay_s: NonNegative | tuple[NonNegative, NonNegative] = 0.0
    """Transport delay of vehicle and link together, both ways. What the certificate leaves of it to the link is the
    default limit of `guards.link_delay_s`. With 0 the certificate itself says how much the link may have."""
    pade_order: Annotated[int, Field(ge=1, le=4)] = 1
    """Order of the Pade approximant with which `companion check` searches for what is unstable. No proof uses it."""


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


def response_of(section: ResponseSection) -> AttitudeResponse:
    """The response in the numbers as written. Raises `ValueError` with one line for an impossible one."""
    kind = section.kind
    dynamics = kind.of(tuple(map(_interval, v)) if kind.of_lists else _interval(v) for v in section.values)
    delay = _interval(section.delay_s) if section.delay_s else NO_DELAY
    return AttitudeResponse(dynamics, delay, section.pade_order)


def _interval(value: float | tuple[float, float]) -> Interval:
    return exact_interval(*value) if isinstance(value, tuple) else exact_interval(value)


def certified_delay_s(attitude: AttitudeSection) -> float:
    """The longest delay for which every axis is certified; zero where the certificate knows of none."""
    return min(upper for _, upper in _delays(attitude))


def link_share_s(attitude: AttitudeSection) -> float:
    """What the link may take of the certified delay, which is that of the vehicle and the link together.

    Of an interval its width, since the vehicle alone has the lower end; of a plain number all of it, for lack of
    knowledge; zero where the certificate knows of no delay.
    """
    return min(upper - lower if upper > lower else upper for lower, upper in _delays(attitude))


def _delays(attitude: AttitudeSection) -> list[tuple[float, float]]:
    delays = [section.delay_s for section in (attitude.x, attitude.y) if section is not None]
    return [delay if isinstance(delay, tuple) else (delay, delay) for delay in delays]
