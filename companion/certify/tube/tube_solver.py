"""A candidate for a tube: the least squared gain as a conic problem for Clarabel. What it says is checked exactly.

The rates r multiply T and the squared gain m. With r given the problem is linear; from a solution it is improved by
its linearisation in all of r, T and m, r within a trust region.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from companion.certify.piecewise.inequalities import Floats
from companion.certify.piecewise.sector_solver import Blocks, sign_form
from companion.certify.search import conic
from companion.certify.tube.tube_forms import Plan

_MARGIN = 1e-7  # least eigenvalue asked for: what rounding may take
_SETTINGS: dict[str, Any] = {
    "chordal_decomposition_enable": False,
    "max_iter": 60,
    "tol_gap_rel": 1e-3,
    "tol_gap_abs": 1e-4,
    "tol_feas": 1e-7,
}


class Candidate(NamedTuple):
    """Entries of T, S and R, u of each inequality, r of each group, and m."""

    unknowns: Floats
    signs: Floats
    rates: Floats
    squared_gain: float


def solve(wanted: Plan, rates: Floats, about: Candidate | None = None, trust: float = 0.0) -> Candidate | None:
    """The least m at these rates; or, about a candidate, in the linearisation, rates moving by a share of `trust`."""
    import clarabel  # noqa: PLC0415 - it takes its time to load
    from scipy import sparse  # noqa: PLC0415

    known = wanted.entries + wanted.late
    first_rate = known + len(wanted.forms)
    count = first_rate + (wanted.groups if about else 0) + 1
    gain = count - 1
    blocks = Blocks()
    right: list[float] = []
    cones: list[Any] = []
    for place in range(wanted.entries, first_rate):  # S, R and u
        blocks.rows(len(right), [place], -1.0)
        right.append(0.0)
    for group in range(wanted.groups if about else 0):
        for side in (1.0, -1.0):
            blocks.rows(len(right), [first_rate + group], side)
            right.append(trust * float(rates[group]))
    cones.append(clarabel.NonnegativeConeT(len(right)))
    for number, form in enumerate(wanted.forms):
        width = form.matrices.shape[1]
        matrices, columns, offset = form.matrices, form.columns, -_MARGIN * np.eye(width)
        more: list[tuple[int, Floats]] = [(known + number, sign_form(width))]
        if form.group < 0:
            offset = offset - np.outer(form.row, form.row)
        else:
            rate = float(rates[form.group])
            matrices = matrices - rate * form.levels
            more.append((gain, rate * _corner(width)))
            if about:
                at = np.einsum("k,kab->ab", about.unknowns[form.columns], form.levels)
                more.append((first_rate + form.group, about.squared_gain * _corner(width) - at))
        columns = np.concatenate([columns, np.arange(wanted.entries, known), [place for place, _ in more]])
        matrices = np.concatenate([matrices, form.squares, np.array([matrix for _, matrix in more])])
        right += blocks.cone(len(right), columns, matrices, offset)
        cones.append(clarabel.PSDTriangleConeT(width))
    if wanted.convex:
        units = np.array([[[1.0, 0.0], [0.0, 0.0]], [[0.0, 1.0], [1.0, 0.0]], [[0.0, 0.0], [0.0, 1.0]]])
        right += blocks.cone(len(right), np.array(wanted.convex), units, -_MARGIN * np.eye(2))
        cones.append(clarabel.PSDTriangleConeT(2))
    linear = np.zeros(count)
    linear[gain] = 1.0
    matrix = sparse.csc_matrix(blocks.entries(), shape=(len(right), count))
    solution = conic.solve(linear, matrix, np.array(right), cones, **_SETTINGS)
    x = np.asarray(solution.x)
    if str(solution.status) not in ("Solved", "AlmostSolved") or not np.all(np.isfinite(x)) or x[gain] <= 0.0:
        return None
    moved = x[first_rate:gain] if about else 0.0
    return Candidate(x[:known], x[known:first_rate], rates + moved, float(x[gain]))


def _corner(width: int) -> Floats:
    matrix = np.zeros((width, width))
    matrix[-1, -1] = 1.0
    return matrix
