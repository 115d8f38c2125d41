"""How far a bounded disturbance drives a loop from its trajectory: a proof of a bound, and its exact check.

V is the functional of `companion.certify.piecewise.sectors` with its integrals weighted by `e^(-a (t - s))`. Let

    (the form that must be negative there, weighted) + r (z' T z - m d^2) < 0     with 0 <= r <= a

hold in every sector, at both ends of the delay and at every corner of weights and response, r free to differ from
corner to corner (not between the ends of the delay), and

    (the form that must be positive there, weighted) - c c' > 0,   c the row of one state,    T_XX > 0.

Then V' <= -r (V - m d^2) wherever the weights move in their box, so that V <= m D^2 is not left while |d| <= D, and the
state stays within sqrt(m) D if it begins there. Of the position, the first state, that is the tube; of the bias weight,
the last, it says up to which D that weight stays inside its bound, as the loop takes it to. The weighting costs the
delayed terms a factor e^(-a h), of which the check takes a lower bound; T_XX > 0, of the integrals X_i, keeps the form
convex in h. With r = 0 and d = 0 this is `sectors`. Standard library only.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from typing import NamedTuple

from companion.attitude_response.realisation import ONE, ZERO, Row
from companion.certify.exact.elimination import positive_definite
from companion.certify.piecewise.sector_proof import combined, form_of, integers_of, matrix_of
from companion.certify.piecewise.sectors import (
    ORDER,
    Channel,
    Inequality,
    Scale,
    Sector,
    Square,
    delayed,
    falls,
    multipliers,
    pattern,
    positive,
    sectors,
)


class TubeProof(NamedTuple):
    """A bound on one loop, in exact rationals.

    Attributes
    ----------
    rays, scale, lyapunov, krasovskii
        As in a `SectorProof`; the position's unit is 1 m.
    rates
        r of each group of inequalities that differ by the delay alone, in scaled time.
    squared_gain
        m, in scaled units of the state for each (m/s^2)^2.
    state
        The one that is bounded: the first or the last of the loop.
    sign_multipliers
        u of each inequality: those that fall, then those of the state.
    """

    rays: tuple[tuple[Fraction, Fraction], ...]
    scale: Scale
    lyapunov: tuple[Fraction, ...]
    krasovskii: tuple[Fraction, ...]
    rates: tuple[Fraction, ...]
    squared_gain: Fraction
    state: int
    sign_multipliers: tuple[Fraction, ...]

    @property
    def gain(self) -> float:
        """What the state reaches for each m/s^2, SI units."""
        return math.sqrt(self.squared_gain) * float(self.scale.states[self.state])


def check_tube(proof: TubeProof, channel: Channel) -> str:
    """Check one bound exactly.

    Parameters
    ----------
    proof, channel
        A bound, and the loop it is of.

    Returns
    -------
    str
        Empty if it holds, else one line that says what fails.
    """
    loop = channel.corners[0][0]
    if len(channel.corners[0]) != 4 or len(loop.bounds) != 1 or channel.held:
        return "a tube is of one axis in continuous time"
    if proof.scale.time_s <= 0 or len(proof.scale.states) != len(loop.a) + 1 or min(proof.scale.states) <= 0:
        return "the scale does not fit"
    if proof.scale.states[-1] != 1 or proof.state not in (0, len(loop.a) - 1):
        return "the disturbance is not in m/s^2, or the state is neither the first nor the last"
    if len(proof.krasovskii) != multipliers(channel)[0] or min(proof.krasovskii, default=ZERO) < 0:
        return "the multipliers of the delay do not fit"
    if min(proof.sign_multipliers, default=ZERO) < 0 or min(proof.rates, default=ZERO) < 0 or proof.squared_gain <= 0:
        return "a multiplier is negative"
    try:
        cut = sectors(channel, proof.rays)
    except ValueError as error:
        return str(error)
    places = pattern(cut)
    if len(proof.lyapunov) != len(places) or not proof.rays:
        return "Lyapunov matrix has the wrong size"
    p = [matrix_of(proof.lyapunov, places, sector) for sector in cut]
    falling, rising = list(falls(channel, cut, proof.scale)), list(positive(channel, cut, proof.scale))
    ends = len(channel.delays_s)
    if len(proof.rates) * ends != len(falling) or len(proof.sign_multipliers) != len(falling) + len(rising):
        return "multipliers do not match the inequalities"
    keep = kept(max(proof.rates) * channel.delays_s[-1] / proof.scale.time_s)
    signs = iter(proof.sign_multipliers)
    for number, inequality in enumerate(falling):
        rate, sign = proof.rates[number // ends], next(signs)
        weights = (*proof.krasovskii, rate * proof.squared_gain)
        form = form_of(weighted(inequality, keep), p[inequality.sector], weights, sign)
        _subtract(form, rate, inequality.state, p[inequality.sector])
        if not positive_definite(integers_of(form)):
            return f"V does not fall in sector {inequality.sector}, inequality {number}"
    for inequality in rising:
        form = form_of(weighted(inequality, keep), p[inequality.sector], (*proof.krasovskii, ZERO), next(signs))
        _subtract(form, ONE, (level(cut[inequality.sector], proof.state, len(form)),), [[ONE]])
        if not positive_definite(integers_of(form)):
            return f"V does not bound the state in sector {inequality.sector}"
    if delayed(channel):
        n = len(p[0])
        block = [p[0][i][n - ORDER : i + 1] for i in range(n - ORDER, n)]
        if not positive_definite(integers_of(block)):
            return "the form is not convex in the delay"
    return ""


def kept(exponent: Fraction) -> Fraction:
    """A little less than e^-exponent, of one that is not negative; not below zero."""
    return max(ZERO, 1 - exponent + exponent**2 / 2 - exponent**3 / 6)


def weighted(inequality: Inequality, keep: Fraction) -> Inequality:
    """Its integrals weighted: what they are bounded by from below is less by the factor."""
    delays = len(inequality.squares) - 1
    squares = [
        Square(tuple((f * keep if f < 0 else f, row) for f, row in square.terms))
        for square in inequality.squares[:delays]
    ]
    return inequality._replace(squares=(*squares, inequality.squares[-1]))


def level(sector: Sector, state: int, width: int) -> Row:
    """The row of a state over the coordinates of a sector."""
    if state == 0:
        return (*sector.basis[0], *(ZERO for _ in range(width - 2)))
    return tuple(ONE if i == state else ZERO for i in range(width))


def _subtract(
    form: list[list[Fraction]], factor: Fraction, rows: Sequence[Row], p: Sequence[Sequence[Fraction]]
) -> None:
    """`form - factor rows' p rows`, of the lower triangle."""
    if not factor:
        return
    through = [combined(row, rows) for row in p]
    for i in range(len(form)):
        product = combined([row[i] for row in rows], through)
        for j in range(i + 1):
            form[i][j] -= factor * product[j]
