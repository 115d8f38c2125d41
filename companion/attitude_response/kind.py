"""What every kind of attitude response tells of itself: its parameters, and what follows from them.

A kind is a class, one response of it an object whose fields are intervals of exact numbers. The names of the fields
are the keys of the config, of the certificate and of `companion identify`. Standard library only.
"""

from __future__ import annotations

import itertools
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, fields, replace
from decimal import ROUND_CEILING, Context, Decimal
from fractions import Fraction
from typing import Any, ClassVar, Final, NamedTuple, Self

from companion.attitude_response.exact import Interval, check_frequency, check_order, ends
from companion.attitude_response.held import Held
from companion.attitude_response.realisation import StateSpace

EXACT: Final = Context(prec=200)
PLACES: Final = Decimal("0.0001")
"""Resolution of reported bandwidths and natural frequencies, rad/s."""

Value = Interval | tuple[Interval, ...]
State = tuple[float, ...]
"""Output, its rate, and what else the kind needs (`ParametricKind.further`), zero at rest; rad and s."""
Step = Callable[[State, float], State]
"""(state, set-point held over the step) -> state at the end of the step."""


class Parameter(NamedTuple):
    """One number that describes a response: its key with the unit in it, the unit, and its symbol on a screen."""

    key: str
    unit: str  # "rad/s", "s", or "1" for none
    symbol: str

    @property
    def name(self) -> str:
        """The key without its unit, as certificates name the assumption: "attitude_bandwidth"."""
        suffix = {"rad/s": "_rad_s", "s": "_s", "1": ""}[self.unit]
        return f"attitude_{self.key.removesuffix(suffix)}"


DELAY: Final = Parameter("delay_s", "s", "delay")


@dataclass(frozen=True)
class Kind(ABC):
    """One response without its delay: stable, strictly proper, of unit gain at rest.

    Class attributes: `name`, in certificates; `title`, on a screen; `parameters`, those that flight and identification
    know as numbers, none for a transfer function; `of_lists`, whether a key is a list of coefficients.
    """

    name: ClassVar[str]
    title: ClassVar[str]
    parameters: ClassVar[tuple[Parameter, ...]] = ()
    of_lists: ClassVar[bool] = False

    @classmethod
    def key_names(cls) -> tuple[str, ...]:
        """The keys that make a response of this kind, in order."""
        return tuple(field.name for field in fields(cls))

    @classmethod
    def of(cls, values: Iterable[Value]) -> Self:
        """The response of these values, in the order of `key_names`."""
        return cls(*values)  # a subclass has one field for each key

    def values(self) -> tuple[Value, ...]:
        """The values in the order of `key_names`."""
        return tuple(getattr(self, key) for key in self.key_names())

    @abstractmethod
    def check(self) -> None:
        """Refuse values that make no stable, strictly proper response of unit gain. Raises `ValueError`, one line."""

    @abstractmethod
    def corners(self) -> list[StateSpace]:
        """Exact realisations at every corner of the intervals."""

    @abstractmethod
    def bandwidth(self) -> Decimal:
        """The number called bandwidth, rad/s; of an interval the lower end."""

    @abstractmethod
    def with_bandwidth(self, bandwidth: Decimal) -> Self:
        """The same response with another bandwidth in rad/s; the widths of intervals keep their proportion."""


@dataclass(frozen=True)
class ParametricKind(Kind):
    """A kind that a few named numbers describe, every field an interval.

    Class attribute: `further`, how many states a step needs beside output and rate.
    """

    further: ClassVar[int] = 0

    @staticmethod
    @abstractmethod
    def realise(*values: Fraction) -> StateSpace:
        """The response as a linear system whose every entry is affine in each parameter by itself.

        The closed loop of eq. (24) is then affine in each parameter and in each weight by itself, and its values over
        a box of parameters lie in the hull of those at the corners.
        """

    @staticmethod
    @abstractmethod
    def step(values: Sequence[float], dt_s: float) -> Step:
        """The exact step of `dt_s` with the set-point held. At rest it stays where the set-point is."""

    @staticmethod
    def held(values: Sequence[float], dt_s: float) -> Held | None:  # noqa: ARG004
        """The same step as plain numbers; None for a kind that `Held` cannot describe, which campaigns do not fly."""
        return None

    @staticmethod
    @abstractmethod
    def lag(values: Sequence[float], of: Callable[[Any], Any]) -> Any:
        """How far the output is behind its set-point, after steps du_k of it at t_k.

        `of(p)` is ``sum_k du_k exp(p (t - t_k))`` for a pole p in 1/s, real or complex, at one time or at many.
        """

    def intervals(self) -> tuple[Interval, ...]:
        """The values in the order of `key_names`, as the intervals they are."""
        return tuple(getattr(self, key) for key in self.key_names())

    def check(self) -> None:
        for parameter, value in zip(self.parameters, self.intervals(), strict=True):
            words = parameter.name.replace("_", " ")
            check_order(words, value)
            if value.lower <= 0:
                raise ValueError(f"{words} must be positive, not {value.lower}")
            if parameter.unit == "rad/s":
                for end in value:
                    check_frequency(words, end)

    def corners(self) -> list[StateSpace]:
        return [self.realise(*corner) for corner in itertools.product(*map(ends, self.intervals()))]

    def bandwidth(self) -> Decimal:
        return self.intervals()[self._first_frequency()].lower

    def with_bandwidth(self, bandwidth: Decimal) -> Self:
        """Every frequency by the same factor; a number without a unit stays. A kind with times must say its own."""
        first, changes = self._first_frequency(), {}
        for place, (parameter, value) in enumerate(zip(self.parameters, self.intervals(), strict=True)):
            if parameter.unit == "rad/s":
                faster = bandwidth if place == first else ceiling(bandwidth * value.lower / self.bandwidth(), PLACES)
                changes[parameter.key] = _moved(value, faster)
        return replace(self, **changes)

    def _first_frequency(self) -> int:
        return next(place for place, parameter in enumerate(self.parameters) if parameter.unit == "rad/s")


class LinearResponse(NamedTuple):
    """One response in plain numbers, in the order of its kind's keys, and its delay: what can be stepped."""

    kind: type[ParametricKind]
    values: tuple[float, ...]
    delay_s: float = 0.0


def ceiling(value: Decimal, places: Decimal) -> Decimal:
    """The value rounded up to the places."""
    return value.quantize(places, ROUND_CEILING, EXACT)


def _moved(value: Interval, lower: Decimal) -> Interval:
    if value.lower == value.upper:
        return Interval(lower, lower)
    return Interval(lower, ceiling(lower * value.upper / value.lower, PLACES))
