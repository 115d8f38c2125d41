"""Closed-loop attitude dynamics as an exact linear system with unit gain at rest. Standard library only.

The realisations are chosen so that every entry is affine in each parameter by itself. The closed loop of eq. (24) is
then affine in each parameter and in each weight by itself, and its values over a box of parameters lie in the hull of
those at the corners."""

import itertools
import math
from fractions import Fraction
from typing import NamedTuple

from companion.certify.problem import AttitudeResponse, FirstOrder, Interval, SecondOrder, TransferFunction

Row = tuple[Fraction, ...]
Matrix = tuple[Row, ...]

ZERO, ONE = Fraction(0), Fraction(1)


class StateSpace(NamedTuple):
    """x' = a x + b u, w = c x + d u, one input and one output; exact rationals, time in s."""

    a: Matrix
    b: Row
    c: Row
    d: Fraction


def corners(response: AttitudeResponse) -> list[StateSpace]:
    """Realisations at every corner of the parameter box, one if all parameters are plain values.

    Returns
    -------
    list of StateSpace
        Strictly proper, unit gain at rest; the state has the order of the dynamics, plus `pade_order` if there is a
        delay.
    """
    delays = [delay_line(delay, response.pade_order) for delay in _ends(response.delay_s)]
    return [series(line, dynamics) for line in delays for dynamics in _dynamics_corners(response.dynamics)]


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


def _ends(value: Interval) -> list[Fraction]:
    return sorted({Fraction(value.lower), Fraction(value.upper)})


def _dynamics_corners(dynamics: FirstOrder | SecondOrder | TransferFunction) -> list[StateSpace]:
    if isinstance(dynamics, FirstOrder):
        return [StateSpace(((-m,),), (m,), (ONE,), ZERO) for m in _ends(dynamics.bandwidth_rad_s)]
    if isinstance(dynamics, SecondOrder):
        # states w and w'/wn: affine in wn and in zeta, which [w, w'] is not
        return [
            StateSpace(((ZERO, wn), (-wn, -2 * zeta * wn)), (ZERO, wn), (ONE, ZERO), ZERO)
            for wn in _ends(dynamics.natural_frequency_rad_s)
            for zeta in _ends(dynamics.damping_ratio)
        ]
    # the constant terms of numerator and denominator are one parameter: unit gain at rest at every corner
    free = [_ends(c) for c in (*dynamics.numerator[:-1], *dynamics.denominator)]
    split = len(dynamics.numerator) - 1
    return [companion_form([*values[:split], values[-1]], list(values[split:])) for values in itertools.product(*free)]
