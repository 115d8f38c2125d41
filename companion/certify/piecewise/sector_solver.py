"""A candidate for a proof by sectors: the inequalities of `sectors` as a conic problem for Clarabel.

What the solver says is never asked: its numbers, rounded to rationals, are checked exactly.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from companion.certify.piecewise.inequalities import Floats, Forms, Plan
from companion.certify.piecewise.sectors import multipliers, pattern
from companion.certify.search import conic

_CAP: Final = 1.0  # of the margin: more means nothing
_NEGATIVE: Final = 1e-6  # below minus this there is none
_BEGUN: Final = 3  # iterations: with fewer it has failed
_DECIDED: Final = 1e-4  # the solver may stop above: the exact check needs no better one


class Candidate(NamedTuple):
    """What the solver believes in: entries of T and multipliers of squares, and the margin it aims at."""

    unknowns: Floats
    margin: float


def solve(wanted: Plan, forms: Forms, chosen: Sequence[int]) -> Candidate | None:
    """Maximise the smallest eigenvalue over the chosen inequalities. None if the solver has no finite answer."""
    import clarabel  # noqa: PLC0415 - it takes its time to load
    from scipy import sparse  # noqa: PLC0415

    entries, extra = len(pattern(wanted.cut)), sum(multipliers(wanted.channel))
    signs = len(chosen) if wanted.rays else 0
    count = entries + extra + signs  # then the margin
    blocks = Blocks()
    diagonal = [place for (i, j), place in pattern(wanted.cut).items() if i == j]
    blocks.rows(0, diagonal, 1.0)
    offset = [float(len(diagonal))]
    cones: list[Any] = [clarabel.ZeroConeT(1), clarabel.NonnegativeConeT(1 + extra + signs)]
    blocks.rows(1, [count], 1.0)
    offset.append(_CAP)
    for number in range(extra + signs):
        blocks.rows(2 + number, [entries + number], -1.0)
    offset += [0.0] * (extra + signs)
    first = len(offset)
    for number, inequality in enumerate(chosen):
        columns, matrices = forms.matrices(inequality)
        if wanted.rays:
            columns = np.append(columns, entries + extra + number)
            matrices = np.concatenate([matrices, sign_form(matrices.shape[1])[np.newaxis]])
        width = matrices.shape[1]
        blocks.semidefinite(first, columns, matrices, count)
        cones.append(clarabel.PSDTriangleConeT(width))
        first += width * (width + 1) // 2
    matrix = sparse.csc_matrix(blocks.entries(), shape=(first, count + 1))
    linear = np.zeros(count + 1)
    linear[-1] = -1.0
    right = np.concatenate([offset, np.zeros(first - len(offset))])
    solution = conic.solve(linear, matrix, right, cones, _is_decided, chordal_decomposition_enable=False)
    x = np.asarray(solution.x)
    if solution.iterations < _BEGUN or not np.all(np.isfinite(x)):
        return None
    return Candidate(x[: entries + extra], float(x[-1]))


def _is_decided(info: Any) -> bool:
    """Whether the margin is surely positive, or surely negative."""
    positive = -info.cost_primal > max(_DECIDED, 1e3 * info.res_primal)
    negative = info.cost_dual > max(_NEGATIVE, 1e2 * info.res_dual)
    return bool(positive or negative)


class Blocks:
    """Entries of the constraint matrix as they come."""

    def __init__(self) -> None:
        self._rows: list[NDArray[np.intp]] = []
        self._columns: list[NDArray[np.intp]] = []
        self._values: list[Floats] = []

    def rows(self, row: int, columns: Sequence[int], value: float) -> None:
        """The same value in some columns of a row."""
        self._add(np.full(len(columns), row), np.asarray(columns), np.full(len(columns), value))

    def semidefinite(self, first: int, columns: NDArray[np.intp], matrices: Floats, margin: int) -> None:
        """`sum_k x_k M_k - margin I` in the cone, as vectors of the upper triangle by columns."""
        width = matrices.shape[1]
        self.cone(first, columns, matrices, np.zeros((width, width)))
        column, row = np.tril_indices(width)
        on_diagonal = np.nonzero(row == column)[0]
        self._add(first + on_diagonal, np.full(width, margin), np.ones(width))

    def cone(self, first: int, columns: NDArray[np.intp], matrices: Floats, offset: Floats) -> list[float]:
        """`sum_k x_k M_k + offset` in the cone, likewise; the right side, of the offset, is returned."""
        column, row = np.tril_indices(matrices.shape[1])
        factors = np.where(row == column, 1.0, math.sqrt(2.0))
        vectors = matrices[:, row, column] * factors
        which, place = np.nonzero(vectors)
        self._add(first + place, columns[which], -vectors[which, place])
        return [float(value) for value in offset[row, column] * factors]

    def entries(self) -> tuple[Floats, tuple[NDArray[np.intp], NDArray[np.intp]]]:
        """Values, and their rows and columns."""
        return np.concatenate(self._values), (np.concatenate(self._rows), np.concatenate(self._columns))

    def _add(self, rows: NDArray[np.intp], columns: NDArray[np.intp], values: Floats) -> None:
        self._rows.append(rows)
        self._columns.append(columns)
        self._values.append(values)


def sign_form(width: int) -> Floats:
    """`-(b1 b2' + b2 b1')`, what a sign multiplier multiplies."""
    matrix = np.zeros((width, width))
    matrix[0, 1] = matrix[1, 0] = -1.0
    return matrix
