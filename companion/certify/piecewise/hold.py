"""What the tick does to the loop, as a few bounded errors of a loop in continuous time. Standard library only.

What flies. At the ticks t_k, at most T apart and otherwise as they like, the controller takes its weights, which may be
any in their box, and holds the command over the tick; the reference model (20) is driven by the mean of two samples of
the attitude:

    x' = A_r x + B (m_k + s_k),   s_k = W_k' x(t_k),   m_k = (w(t_k) + w(t_k+1)) / 2,   w(t) = y(t - h),
    xa' = A_a xa - b B_a s_k,   y = C xa,

`x` position and velocity, B = (0, g). With T to zero this is (24). Between two ticks, theta half of what lies between
them, let s be the signal of the same mean as s_k that follows the state:

    (1 + theta g W2) s = W1 (p - theta v) + W2 (v - theta ((A_r x)_2 + g (w + E))) + Z.

s_k - s and m_k - w - E have no mean over a tick (E is how far the mean of two samples is from the mean of w); let R and
N be their integrals, zero at every tick. In the coordinates ``v - g (N + R)`` and ``xa + b B_a R`` they drive nothing,
and what is left is a loop in continuous time with four errors:

    E;   Q = N + R;   F = b R;   Z, what the state moves over half a tick beyond its velocity, and `W2 g Q`.

Each is bounded, in the L2 norm from tick to tick and so from start to now: with Wirtinger's inequality
``|R| <= (T/pi) |R'| <= (T/pi)^2 |R''|``; the error of the trapezoidal rule, ``|E| <= T^2/sqrt(120) |w''|``, or
``T/sqrt(12) |w'|`` where w' jumps within a tick; ``T^2 sqrt(1/120 + 1/(4 pi^2)) |f'|`` for
``(1/T) int (T - u) f(u) du - T/2 f(t)``, a constant and what has no mean. The bounds refer to each other (R'' is s',
which has s_k in it); solved for, they are combinations of the norms of v, v', y' and xa', which are rows of the loop.
A delay moves w in time and leaves its norm. In the inequality of `sectors` each error has a multiplier.

s is a fraction of two functions affine in W1, W2 and theta each by itself, so that it lies between its values at the
corners: theta zero, where two corners of W count in a sector as they do without a tick, and T/2, where all four count.

What it takes for granted: ticks at most T apart, and applied by the vehicle as far apart. The tracking error e enters
as it does in (24): a bounded signal from outside, which `guards.tracking_error_m` watches.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from fractions import Fraction
from typing import Final, NamedTuple

from companion.attitude_response.realisation import ONE, ZERO, Row, StateSpace
from companion.certify.piecewise.sectors import Channel, Loop, Square

UNITS: Final = (0, -1, 0, 0, 0)
"""Of E, Q, F, Z and the delayed F: radians times this power of a frequency."""

_E, _Q, _F, _Z, _LATE = range(5)
_OVER_PI: Final = Fraction(106, 333)  # a little more than 1 / pi
_MEAN: Final = Fraction(1836, 10000)  # likewise, than sqrt(1 / 120 + 1 / (4 pi^2))
_BITS: Final = 24  # to which coefficients are rounded up: short numbers, and bounds all the same


class Reference(NamedTuple):
    """Of one axis, exact, SI units: A_r = [[0, 1], [-stiffness, -damping]], and the ends of its weights."""

    stiffness: Fraction
    damping: Fraction
    gravity_m_s2: Fraction
    weights: tuple[tuple[Fraction, Fraction], tuple[Fraction, Fraction]]  # of position, of velocity


class TooSlowError(ValueError):
    """The tick is so slow that its errors have no bound."""


def held(reference: Reference, responses: Sequence[StateSpace], delays_s: tuple[Fraction, ...], tick_s: Fraction) -> (
    Channel
):  # fmt: skip
    """One axis, held over ticks of at most `tick_s`.

    Parameters
    ----------
    reference
        Axis.
    responses
        At the corners of the response: without delay, of the same inlet but for a factor.
    delays_s
        Ends of the interval of the delay; (0,) for none.
    tick_s
        Longest tick in s, above zero.

    Raises
    ------
    TooSlowError
        If the bounds do not close.
    ValueError
        If the inlets of the responses have different directions.
    """
    inlet = _direction(responses)
    late = bool(delays_s[-1]) and any(_dot(response.c, inlet) for response in responses)
    errors = 5 if late else 4
    gains = _Gains(reference, responses, inlet, tick_s, bool(delays_s[-1]))
    corners = list(itertools.product(*reference.weights))

    def at(response: StateSpace, theta_s: Fraction) -> tuple[Loop, ...]:
        return tuple(_loop(reference, response, inlet, w, theta_s, errors, gains, late=late) for w in corners)

    return Channel(
        tuple(at(response, ZERO) for response in responses),
        delays_s,
        tuple(at(response, tick_s / 2) for response in responses),
        tick_s,
    )


def _direction(responses: Sequence[StateSpace]) -> Row:
    """b of `B_a = beta b`, its largest entry one."""
    found = set()
    for response in responses:
        largest = max(response.b, key=abs)
        found.add(tuple(entry / largest for entry in response.b))
    if len(found) != 1:
        raise ValueError("the tick of a response whose inlet turns with its parameters is not certified")
    return found.pop()


class _Gains:
    """Coefficients of the bounds, each on the norms of (v, v', y', xa'_1, ...), for all corners together."""

    def __init__(
        self, reference: Reference, responses: Sequence[StateSpace], inlet: Row, tick_s: Fraction, delayed: bool
    ) -> None:
        stiffness, damping, g, (first, second) = reference
        order = len(inlet)
        w1, w2 = max(map(abs, first)), max(map(abs, second))
        theta_s, over = tick_s / 2, tick_s * _OVER_PI
        least = min(ONE, 1 + theta_s * g * min(second))
        if least <= 0:
            raise TooSlowError("the tick is too slow")
        beta = max(max(map(abs, response.b)) for response in responses)
        through = beta * max(abs(_dot(response.c, inlet)) for response in responses)
        # |s'|, |v'| true, |w'| true <= K of themselves + those of the loop's own rows
        k = (
            (ZERO, w2 / least, w2 * theta_s * g / least),
            (g * over, ZERO, g * over),
            (through * over, ZERO, ZERO),
        )
        own = (_row(3 + order, {0: w1 / least}), _row(3 + order, {1: ONE}), _row(3 + order, {2: ONE}))
        slope, acceleration, rate = _closed(k, own)
        cross = max(abs(p - damping * v) for p in first for v in second)
        q = _sum((over * over, slope), (over * over, rate))
        half = tick_s**2 * _MEAN
        z = _sum(
            (g * (w2 + theta_s * cross), q),
            (half * cross, acceleration),
            (half * stiffness * w2, _row(3 + order, {0: ONE})),
        )
        f = _sum((beta * over * over, slope))
        if delayed and through:  # w' jumps wherever a command arrives
            e, e_factor = rate, tick_s**2 / 12
        else:
            turns = [
                sum(max(abs(r.c[i]) for r in responses) * max(abs(r.a[i][j]) for r in responses) for i in range(order))
                + ZERO
                for j in range(order)
            ]
            e = _sum(*((turns[j], _row(3 + order, {3 + j: ONE})) for j in range(order)))
            e = _sum((ONE, e), (sum(t * abs(b) for t, b in zip(turns, inlet, strict=True)) * beta * over, slope))
            e_factor = tick_s**4 / 120
        self.rows = (e, q, f, z, f)
        self.factors = (e_factor, ONE, ONE, ONE, ONE)
        speed = Fraction(2) ** round(math.log2(float(stiffness)) / 2)
        self.sizes = (1 / speed, ONE, speed / g, *(speed / g for _ in range(order)))  # of the norms, about

    def square(self, error: int, rows: Sequence[Row], unit: Row) -> Square:
        """`bound^2 - error^2` as a sum of squares: (sum c |r|)^2 <= sum c m times sum c/m |r|^2, for any m > 0."""
        gains = self.rows[error]
        total = sum((gain * size for gain, size in zip(gains, self.sizes, strict=True)), ZERO) * self.factors[error]
        bound = [
            (_up(total * gain / size), row) for gain, size, row in zip(gains, self.sizes, rows, strict=True) if gain
        ]
        return Square(((Fraction(-1), unit), *bound))


def _loop(
    reference: Reference,
    response: StateSpace,
    inlet: Row,
    weights: tuple[Fraction, Fraction],
    theta_s: Fraction,
    errors: int,
    gains: _Gains,
    *,
    late: bool,
) -> Loop:
    """The loop at one corner; its rows are over (p, v, xa, g w, errors)."""
    stiffness, damping, g, _ = reference
    order, n = len(inlet), 2 + len(inlet)
    width = n + 1 + errors

    def unit(place: int) -> Row:
        return _row(width, {place: ONE})

    def error(which: int) -> Row:
        return unit(n + 1 + which)

    p, v, w_force = unit(0), unit(1), unit(n)
    states = [unit(2 + j) for j in range(order)]
    shift = _dot(response.c, inlet)
    w = _sum((1 / g, w_force), (-shift, error(_LATE if late else _F)))  # the attitude that was reached
    w1, w2 = weights
    divisor = 1 + theta_s * g * w2
    s = _sum(
        ((w1 + theta_s * w2 * stiffness) / divisor, p),
        ((w2 - theta_s * (w1 - w2 * damping)) / divisor, v),
        (-theta_s * w2 * g / divisor, _sum((ONE, w), (ONE, error(_E)))),
        (1 / divisor, error(_Z)),
    )
    velocity = _sum((ONE, v), (g, error(_Q)))
    acceleration = _sum((-stiffness, p), (-damping, velocity), (g, w), (g, error(_E)), (g, s))
    reached = []
    for row, b in zip(response.a, response.b, strict=True):
        moved = [(entry, state) for entry, state in zip(row, states, strict=True)]
        reached.append(_sum(*moved, (-_dot(row, inlet), error(_F)), (-b, s)))
    output = _sum(*((c, row) for c, row in zip(response.c, reached, strict=True)))
    rates = (velocity, acceleration, *reached)
    norms = (velocity, acceleration, output, *reached)
    return Loop(
        tuple(row[:n] for row in rates),
        tuple(row[n : n + 1] for row in rates),
        ((ZERO, ZERO, *(g * c for c in response.c)),),
        tuple(row[n + 1 :] for row in rates),
        tuple(gains.square(which, norms, error(which)) for which in range(errors)),
    )


def _closed(k: Sequence[Row], own: Sequence[Row]) -> list[Row]:
    """The least v with v = K v + own, by elimination: right if it is not negative, K being so."""
    rows = [[(ONE if i == j else ZERO) - k[i][j] for j in range(3)] + list(own[i]) for i in range(3)]
    inverse = [[ONE if i == j else ZERO for j in range(3)] for i in range(3)]
    for i in range(3):
        pivot = rows[i][i]
        if pivot <= 0:  # of an M-matrix every pivot is positive
            raise TooSlowError("the tick is too slow")
        rows[i] = [entry / pivot for entry in rows[i]]
        inverse[i] = [entry / pivot for entry in inverse[i]]
        for j in range(3):
            if j != i and rows[j][i]:
                factor = rows[j][i]
                rows[j] = [x - factor * y for x, y in zip(rows[j], rows[i], strict=True)]
    return [tuple(_up(entry) for entry in row[3:]) for row in rows]


def _sum(*terms: tuple[Fraction, Row]) -> Row:
    """Sum of factor times row."""
    return tuple(
        sum((factor * row[i] for factor, row in terms if factor and row[i]), ZERO) for i in range(len(terms[0][1]))
    )


def _row(width: int, entries: dict[int, Fraction]) -> Row:
    return tuple(entries.get(i, ZERO) for i in range(width))


def _dot(left: Sequence[Fraction], right: Sequence[Fraction]) -> Fraction:
    return sum((x * y for x, y in zip(left, right, strict=True)), ZERO)


def _up(value: Fraction) -> Fraction:
    """A little more than a number that is not negative, with few digits."""
    if not value:
        return ZERO
    grid = Fraction(2) ** (_BITS - math.frexp(float(value))[1])
    return Fraction(math.ceil(value * grid)) / grid
