"""Rational numbers as a certificate writes them, read with care. Standard library only."""

from fractions import Fraction

MAX_BITS = 200  # of a numerator or denominator


def rationals(stated: object) -> tuple[Fraction, ...]:
    """A list of them, as `rational` reads each. Raises `ValueError`."""
    return tuple(rational(item) for item in list_of(stated))


def rational(stated: object) -> Fraction:
    """A short multiple of a power of two, of the form -3/8. Raises `ValueError`."""
    if not isinstance(stated, str) or len(stated) > 200 or not set(stated) <= set("-/0123456789"):
        raise ValueError("a number is not a rational of the form -3/8")
    number = Fraction(stated)
    # Powers of two, as the writer makes them: a common denominator is then one of them, and no file stalls this check.
    if number.denominator & (number.denominator - 1) or max(number.denominator, abs(number.numerator)) >> MAX_BITS:
        raise ValueError(f"a number is not a short multiple of a power of two: {stated[:40]}")
    return number


def list_of(stated: object) -> list[object]:
    """A list, or `ValueError`."""
    if not isinstance(stated, (list, tuple)):
        raise ValueError("a list is missing")
    return list(stated)
