"""The inequalities of a tube in floating point, as matrices over the unknowns T, S and R."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_continuous_lyapunov

from companion.certify.piecewise.inequalities import Floats, in_floats
from companion.certify.piecewise.sector_search import rays
from companion.certify.piecewise.sectors import (
    ORDER,
    Channel,
    Inequality,
    Scale,
    Sector,
    delayed,
    falls,
    pattern,
    positive,
    sectors,
    size,
    whole,
)
from companion.certify.tube.tube_proof import kept, level, weighted

DECAY_1_S: Final = 1.0
"""a of the search: no rate r is above it."""


class Form(NamedTuple):
    """One inequality `sum x M > ...` over its unknowns.

    Attributes
    ----------
    columns, matrices
        Of the entries of T.
    squares
        Of S and R.
    levels
        z' T z, of the entries of T.
    group
        Of its rate; -1 where V is to be positive.
    row
        c, or nothing.
    """

    columns: NDArray[np.intp]
    matrices: Floats
    squares: Floats
    levels: Floats
    group: int
    row: Floats


class Plan(NamedTuple):
    """Everything one bound has to satisfy; `convex` are the places of T_XX, none without a delay."""

    channel: Channel
    rays: tuple[tuple[Fraction, Fraction], ...]
    scale: Scale
    cut: list[Sector]
    forms: list[Form]
    entries: int
    late: int
    groups: int
    convex: tuple[int, ...]


def plan(channel: Channel, count: int, scale: Scale, state: int) -> Plan:
    """The inequalities with so many rays, to bound a state, the first or the last."""
    chosen = rays(count)
    cut = sectors(channel, chosen)
    places = pattern(cut)
    near, near_cut, near_scale = in_floats(channel), in_floats(cut), in_floats(scale)
    keep = in_floats(kept(Fraction(DECAY_1_S) * channel.delays_s[-1]))
    ends, late = len(channel.delays_s), 2 if delayed(channel) else 0
    forms = []
    falling = list(falls(near, near_cut, near_scale))
    for number, inequality in enumerate((*falling, *positive(near, near_cut, near_scale))):
        group = number // ends if inequality.rate else -1
        row = () if inequality.rate else level(near_cut[inequality.sector], state, len(inequality.state))
        forms.append(_form(weighted(inequality, keep), cut[inequality.sector], places, late, group, np.array(row)))
    last = cut[0].places[size(channel) - ORDER :]
    convex = tuple(places[pair] for pair in ((last[0], last[0]), (last[0], last[1]), (last[1], last[1])) if late)
    return Plan(channel, chosen, scale, cut, forms, len(places), late, len(falling) // ends, convex)


def natural_scale(channel: Channel, frequency_rad_s: float) -> Scale:
    """Powers of two near what a random disturbance moves each state by, for 1 m of the position."""
    corner = channel.corners[-1]
    mean = np.mean([np.array(in_floats(whole(loop)), dtype=float) for loop in corner], axis=0)
    inlet = np.array(in_floats(corner[0].d), dtype=float)
    if np.linalg.eigvals(mean).real.max() >= 0.0:
        spread = np.ones(len(mean))
    else:
        spread = np.sqrt(np.diag(solve_continuous_lyapunov(mean, -inlet @ inlet.T)))
    states = [Fraction(2) ** round(math.log2(value / spread[0])) for value in spread]
    return Scale(1 / Fraction(2) ** round(math.log2(frequency_rad_s)), (*states, Fraction(1)))


def _form(
    inequality: Inequality, sector: Sector, places: dict[tuple[int, int], int], late: int, group: int, row: Floats
) -> Form:
    signs = np.array(sector.signs, dtype=float)
    g = np.array(inequality.state, dtype=float)
    i, j = np.triu_indices(len(g))
    pairs = [(sector.places[a], sector.places[b]) for a, b in zip(i, j, strict=True)]
    columns = np.array([places[min(pair), max(pair)] for pair in pairs], dtype=np.intp)
    halved = (np.where(i == j, 0.5, 1.0) * signs[i] * signs[j])[:, None, None]
    levels = halved * _symmetric(g[i][:, :, None] * g[j][:, None, :])
    if inequality.rate:
        h = np.array(inequality.rate, dtype=float)
        product = g[i][:, :, None] * h[j][:, None, :] + g[j][:, :, None] * h[i][:, None, :]
        matrices = -halved * _symmetric(product)
    else:
        matrices = levels
    squares = np.zeros((late, g.shape[1], g.shape[1]))
    for number in range(late):
        for factor, terms in inequality.squares[number].terms:
            values = np.array(terms, dtype=float)
            squares[number] -= float(factor) * np.outer(values, values)
    return Form(columns, matrices, squares, levels, group, row)


def _symmetric(product: Floats) -> Floats:
    return product + product.transpose(0, 2, 1)
