"""Bisection between what is certified and what is not: in floating point, and proven where it ends."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from decimal import Decimal
from typing import NamedTuple

from companion.certify.certificate import AnyProof

TOLERANCE = 5e-4  # relative, of every bisection
REACH = 32.0  # how many times the start is searched before giving up


class Certified(NamedTuple):
    """A number and the exactly checked proof at that number."""

    value: Decimal
    proof: AnyProof


class Found(NamedTuple):
    """A number at which floating point sees a proof, and what makes it exact, or None."""

    value: Decimal
    prove: Callable[[], AnyProof | None]


Attempt = Callable[[float], Found | None]


def certified(found: Sequence[Found]) -> Certified | None:
    """The last of a search that is proven."""
    for value, prove_it in reversed(found):
        proof = prove_it()
        if proof is not None:
            return Certified(value, proof)
    return None


def boundary(attempt: Attempt, start: float, above: float) -> list[Found]:
    """Falling values that succeed, by doubling and bisection from `start`; values up to `above` are known to fail."""
    found, high = attempt(start), start
    while found is None:
        above, high = high, 1.5 * high
        if high > REACH * start:
            return []
        found = attempt(high)
    good = [found]
    low = max(above, 0.8 * high)
    while low > above and (better := attempt(low)) is not None:
        good.append(better)
        high, low = low, max(above, 0.8 * low)
        if high < start / 1000:
            return good
    while high - low > TOLERANCE * high:
        middle = (low + high) / 2
        better = attempt(middle)
        if better is None:
            low = middle
        else:
            good.append(better)
            high = middle
    return good


def first(attempt: Attempt, start: float, low: float, high: float) -> list[Found]:
    """Rising values that succeed, from `start` up or, where that does not, below it."""
    value, top = start, high
    while (good := attempt(value)) is None:
        if value <= low:
            return []
        value, top = max(0.7 * value, low), value
    return [good, *(rise(attempt, value, high) if value == start else between(attempt, value, top))]


def rise(attempt: Attempt, low: float, high: float) -> list[Found]:
    """Rising values that succeed between `low`, which does, and `high`."""
    good: list[Found] = []
    step = max(0.1 * low, 0.01 * high)
    while low + step < high and (better := attempt(low + step)) is not None:
        good.append(better)
        low, step = low + step, 2 * step
    return good + between(attempt, low, min(high, low + step))


def between(attempt: Attempt, low: float, high: float, tolerance: float = TOLERANCE) -> list[Found]:
    """Rising values that succeed, by bisection: `low` does, `high` does not."""
    good: list[Found] = []
    while high - low > tolerance * high:
        middle = (low + high) / 2
        better = attempt(middle)
        if better is None:
            high = middle
        else:
            good.append(better)
            low = middle
    return good
