"""Linear systems as exact rationals: canonical form, transport delay, one behind the other. Standard library only."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Final, NamedTuple

Row = tuple[Fraction, ...]
Matrix = tuple[Row, ...]

ZERO: Final = Fraction(0)
ONE: Final = Fraction(1)


class StateSpace(NamedTuple):
    """x' = a x + b u, w = c x + d u, one input and one output; exact rationals, time in s."""

    a: Matrix
    b: Row
    c: Row
    d: Fraction


def delay_line(delay: Fraction, order: int) -> StateSpace:
    """Pade approximant of a transport delay in s, realised as `x' = (a x + b u) / delay`: affine in 1/delay.

    A delay of zero is a wire: no state, w = u.
    """
    if delay == 0:
        return StateSpace((), (), (), ONE)
    k = order
    scale = [
        Fraction(math.factorial(2 * k - j) * math.factorial(k), math.factorial(2 * k) * math.factorial(j))
        / math.factorial(k - j)
        for j in range(k, -1, -1)
    ]
    numerator = [coefficient * (-1) ** (k - i) for i, coefficient in enumerate(scale)]
    unit = companion_form(numerator, scale)
    return StateSpace(
        tuple(tuple(e / delay for e in row) for row in unit.a), tuple(e / delay for e in unit.b), unit.c, unit.d
    )


def companion_form(numerator: list[Fraction], denominator: list[Fraction]) -> StateSpace:
    """Controllable canonical form of a proper transfer function, highest power first."""
    n = len(denominator) - 1
    den = [c / denominator[0] for c in denominator]
    num = [ZERO] * (n + 1 - len(numerator)) + [c / denominator[0] for c in numerator]
    chain = [tuple(ONE if j == i + 1 else ZERO for j in range(n)) for i in range(n - 1)]
    last = tuple(-c for c in reversed(den[1:]))
    c = tuple(b - num[0] * a for b, a in zip(reversed(num[1:]), reversed(den[1:]), strict=True))
    return StateSpace((*chain, last), (ZERO,) * (n - 1) + (ONE,), c, num[0])


def series(first: StateSpace, second: StateSpace) -> StateSpace:
    """`second` driven by the output of `first`; states of `second` come first."""
    n1, n2 = len(first.b), len(second.b)
    upper = [second.a[i] + tuple(second.b[i] * c for c in first.c) for i in range(n2)]
    lower = [(ZERO,) * n2 + first.a[i] for i in range(n1)]
    b = tuple(e * first.d for e in second.b) + first.b
    c = second.c + tuple(second.d * e for e in first.c)
    return StateSpace((*upper, *lower), b, c, second.d * first.d)


def is_hurwitz(polynomial: list[Fraction]) -> bool:
    """Whether all roots lie in the open left half plane: exact Routh table, highest power first."""
    if polynomial[0] < 0:
        polynomial = [-c for c in polynomial]
    upper, lower = polynomial[0::2], polynomial[1::2]
    while lower:
        if upper[0] <= 0 or lower[0] <= 0:
            return False
        ratio = upper[0] / lower[0]
        padded = lower[1:] + [Fraction(0)] * (len(upper) - len(lower))
        upper, lower = lower, [u - ratio * p for u, p in zip(upper[1:], padded, strict=True)]
    return upper[0] > 0
