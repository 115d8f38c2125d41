"""The inverse of an attitude response for slow signals: what to ask for to get one. Standard library only.

With ``H(s) = -c a^-1 b - c a^-2 b s - c a^-3 b s^2 - ... = 1 + h1 s + h2 s^2 + ...`` of a realisation and a delay T,

    e^(sT) / H(s) = 1 + l1 s + l2 s^2 + ...,    l1 = T - h1,    l2 = h1^2 - h2 - T h1 + T^2/2.

l1 is the lag of the response: 2 zeta/wn + T of a second order.
"""

from __future__ import annotations

from fractions import Fraction
from typing import NamedTuple

from companion.attitude_response.realisation import Matrix, Row, StateSpace
from companion.attitude_response.response import AttitudeResponse


class Inverse(NamedTuple):
    """l1 and l2 in the middle of the intervals of a response, and how far l1 is from there at their ends."""

    first_s: float
    second_s2: float
    spread_s: float
    delay_s: float


def inverse(response: AttitudeResponse) -> Inverse:
    """Of a response whose parameters and delay may be intervals: the mean over their corners."""
    delays = (Fraction(response.delay_s.lower), Fraction(response.delay_s.upper))
    found = [_at(corner, delay) for corner in response.dynamics.corners() for delay in delays]
    first = sum((l1 for l1, _ in found), Fraction(0)) / len(found)
    second = sum((l2 for _, l2 in found), Fraction(0)) / len(found)
    spread = max(abs(l1 - first) for l1, _ in found)
    return Inverse(float(first), float(second), float(spread), float(sum(delays) / 2))


def _at(space: StateSpace, delay: Fraction) -> tuple[Fraction, Fraction]:
    """(l1, l2) of a realisation."""
    once = _solve(space.a, space.b)
    twice = _solve(space.a, once)
    h1 = -sum((c * x for c, x in zip(space.c, twice, strict=True)), Fraction(0))
    h2 = -sum((c * x for c, x in zip(space.c, _solve(space.a, twice), strict=True)), Fraction(0))
    return delay - h1, h1 * h1 - h2 - delay * h1 + delay * delay / 2


def _solve(matrix: Matrix, right: Row) -> Row:
    """x of ``matrix x = right``; the matrix of a stable response is never singular."""
    rows = [[*row, value] for row, value in zip(matrix, right, strict=True)]
    for k in range(len(rows)):
        pivot = next(i for i in range(k, len(rows)) if rows[i][k])
        rows[k], rows[pivot] = rows[pivot], rows[k]
        rows[k] = [value / rows[k][k] for value in rows[k]]
        for i, row in enumerate(rows):
            if i != k and row[k]:
                rows[i] = [a - row[k] * b for a, b in zip(row, rows[k], strict=True)]
    return tuple(row[-1] for row in rows)
