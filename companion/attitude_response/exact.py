"""Exact numbers: decimals as written, and intervals of them. Standard library only: the process in flight reads them.

A proof is then about the number as written ("0.02") and not about the double nearest to it.
"""

from __future__ import annotations

from decimal import Decimal
from fractions import Fraction
from typing import Final, NamedTuple

MAX_DIGITS: Final = 40
"""Of a decimal, on either side of the point: enough for any config, and no number can stall a verification."""


class Interval(NamedTuple):
    """A parameter between two ends, both included; equal ends mean a plain value."""

    lower: Decimal
    upper: Decimal


NO_DELAY: Final = Interval(Decimal(0), Decimal(0))


def decimal(value: str | int | float | Decimal) -> Decimal:
    """The decimal as written; a float stands for its shortest text.

    Raises
    ------
    ValueError
        If it is not a finite decimal number of at most `MAX_DIGITS` digits on either side of the point.
    """
    try:
        number = Decimal(str(value))
    except ArithmeticError:
        raise ValueError(f"{value!r} is not a decimal number") from None
    if not number.is_finite():
        raise ValueError(f"{value!r} is not a finite number")
    exponent = number.as_tuple().exponent
    if not isinstance(exponent, int) or exponent < -MAX_DIGITS or number.adjusted() > MAX_DIGITS:
        raise ValueError(f"{value!r} has more than {MAX_DIGITS} digits on one side of the point")
    return number


def interval(lower: str | int | float | Decimal, upper: str | int | float | Decimal | None = None) -> Interval:
    """An interval from its two ends, or from one plain value."""
    low = decimal(lower)
    return Interval(low, low if upper is None else decimal(upper))


def ends(value: Interval) -> list[Fraction]:
    """The ends of an interval from the lower one; one number for a plain value."""
    return sorted({Fraction(value.lower), Fraction(value.upper)})


def check_order(name: str, value: Interval) -> None:
    """Refuse an interval whose ends are swapped. Raises `ValueError`."""
    if value.lower > value.upper:
        raise ValueError(f"{name} interval is upside down: {value.lower} to {value.upper}")


FREQUENCIES_RAD_S: Final = (Decimal("0.001"), Decimal(10_000))
"""Between what a reference model's natural frequency and an attitude response's frequencies must lie."""


def check_frequency(name: str, value: Decimal) -> None:
    """Refuse a frequency in rad/s outside `FREQUENCIES_RAD_S`. Raises `ValueError`."""
    lowest, highest = FREQUENCIES_RAD_S
    if not lowest <= value <= highest:
        raise ValueError(f"{name} {value} rad/s is outside {lowest} to {highest} rad/s")
