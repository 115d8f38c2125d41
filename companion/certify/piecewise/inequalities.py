"""The inequalities of one proof in floating point: as matrices for the solver, and how well a candidate meets them."""

from __future__ import annotations

from fractions import Fraction
from typing import NamedTuple, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from companion.certify.piecewise.sectors import Channel, Inequality, Scale, Sector, pattern

Floats = NDArray[np.float64]
T = TypeVar("T")


class Plan(NamedTuple):
    """The inequalities of one proof."""

    channel: Channel
    rays: tuple[tuple[Fraction, Fraction], ...]
    scale: Scale
    cut: list[Sector]
    inequalities: list[Inequality]


def in_floats(exact: T) -> T:
    """Records, tuples and lists with each fraction as the nearest double: the same formulas, ten times as fast."""
    if isinstance(exact, Fraction):
        return cast(T, float(exact))
    if isinstance(exact, tuple | list):
        parts = [in_floats(part) for part in exact]
        return cast(T, type(exact)(*parts) if hasattr(exact, "_fields") else type(exact)(parts))
    return exact


class Forms:
    """The inequalities of a plan as arrays. Unknowns: the entries of T, then the multipliers of the squares."""

    def __init__(self, wanted: Plan) -> None:
        self._wanted = wanted
        self._places = pattern(wanted.cut)
        self._arrays = [_arrays(inequality) for inequality in wanted.inequalities]
        self._groups = [
            [i for i, inequality in enumerate(wanted.inequalities) if bool(inequality.rate) == falling]
            for falling in (True, False)
        ]

    def identity(self) -> Floats:
        """T as the identity."""
        return np.array([float(i == j) for i, j in self._places])

    def matrices(self, number: int) -> tuple[NDArray[np.intp], Floats]:
        """Unknowns of one inequality, and the symmetric matrix of each."""
        inequality = self._wanted.inequalities[number]
        sector = self._wanted.cut[inequality.sector]
        g, h, squares = self._arrays[number]
        i, j = np.triu_indices(len(g))
        signs = np.array(sector.signs, dtype=float)
        chosen = [self._place(sector, int(a), int(b)) for a, b in zip(i, j, strict=True)]
        halved = np.where(i == j, 0.5, 1.0) * signs[i] * signs[j]
        if inequality.rate:
            product = g[i][:, :, None] * h[j][:, None, :] + g[j][:, :, None] * h[i][:, None, :]
            matrices = -halved[:, None, None] * (product + product.transpose(0, 2, 1))
        else:
            product = g[i][:, :, None] * g[j][:, None, :]
            matrices = halved[:, None, None] * (product + product.transpose(0, 2, 1))
        entries = len(self._places)
        columns = np.array([*chosen, *range(entries, entries + len(squares))], dtype=np.intp)
        return columns, np.concatenate([matrices, squares])

    def margins(self, unknowns: Floats) -> tuple[Floats, Floats]:
        """Least eigenvalue of each inequality, and the sign multiplier that serves it best.

        Of what is left of the first two coordinates when the others are eliminated, the multiplier takes the product
        away if it is positive; zero where there are no rays.
        """
        entries = len(self._places)
        count = len(self._wanted.inequalities)
        margins, signs = np.empty(count), np.zeros(count)
        p = [self._lyapunov(unknowns, sector) for sector in self._wanted.cut]
        for group in self._groups:
            if not group:
                continue
            sectors = [self._wanted.inequalities[i].sector for i in group]
            chosen = np.array([p[sector] for sector in sectors])
            g, h, squares = (np.array([self._arrays[i][k] for i in group]) for k in range(3))
            if self._wanted.inequalities[group[0]].rate:
                product = np.swapaxes(g, 1, 2) @ chosen @ h
                forms = -(product + np.swapaxes(product, 1, 2))
            else:
                forms = chosen.copy()
            forms += np.einsum("k,ikab->iab", unknowns[entries:], squares)
            if self._wanted.rays:
                signs[group] = turned = _best_signs(forms)
                forms[:, 0, 1] -= turned
                forms[:, 1, 0] -= turned
            margins[group] = np.linalg.eigvalsh(forms)[:, 0]
        return margins, signs

    def _place(self, sector: Sector, i: int, j: int) -> int:
        a, b = sector.places[i], sector.places[j]
        return self._places[min(a, b), max(a, b)]

    def _lyapunov(self, unknowns: Floats, sector: Sector) -> Floats:
        n, signs = len(sector.places), np.array(sector.signs, dtype=float)
        entries = [[unknowns[self._place(sector, i, j)] for j in range(n)] for i in range(n)]
        return np.array(entries) * np.outer(signs, signs)


def _best_signs(forms: Floats) -> Floats:
    rest = forms[:, 2:, 2:]
    least = np.linalg.eigvalsh(rest)[:, 0]
    rest = rest + np.maximum(1e-12 - least, 0.0)[:, None, None] * np.eye(rest.shape[1])  # it fails anyhow
    cross = forms[:, :2, 2:]
    left = forms[:, :2, :2] - cross @ np.linalg.solve(rest, np.swapaxes(cross, 1, 2))
    return np.maximum(left[:, 0, 1], 0.0)


def _arrays(inequality: Inequality) -> tuple[Floats, Floats, Floats]:
    """G, H, and minus Q of each multiplier."""
    g = np.array(inequality.state, dtype=float)
    h = np.array(inequality.rate, dtype=float)
    width = g.shape[1]
    squares = np.zeros((len(inequality.squares), width, width))
    for number, square in enumerate(inequality.squares):
        for factor, row in square.terms:
            values = np.array(row, dtype=float)
            squares[number] -= float(factor) * np.outer(values, values)
    return g, h, squares
