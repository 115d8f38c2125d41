"""A candidate for a proof by sectors: the inequalities of `sectors` as a conic problem for Clarabel.

What the solver says is never asked: its numbers, rounded to rationals, are checked exactly.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from companion.certify.piecewise.sector_proof import SectorProof, check_sectors
from companion.certify.piecewise.sectors import (
    Channel,
    Inequality,
    Scale,
    Sector,
    falls,
    multipliers,
    pattern,
    positive,
    sectors,
)

Floats = NDArray[np.float64]

_CAP: Final = 1.0  # of the margin: more means nothing
_DECIDED: Final = 1e-4  # the solver may stop above: the exact check needs no better one
_LEAST: Final = 1e-8  # below, rounding eats it
_ROUNDING_BITS: Final = (20, 30, 42)
_RAY_BITS: Final = 8


class Candidate(NamedTuple):
    """What the solver believes in: the unknowns in the order of a proof, and the margin it aims at."""

    unknowns: Floats
    margin: float


class Plan(NamedTuple):
    """The inequalities of one proof."""

    channel: Channel
    rays: tuple[tuple[Fraction, Fraction], ...]
    scale: Scale
    cut: list[Sector]
    inequalities: list[Inequality]


def rays(count: int) -> tuple[tuple[Fraction, Fraction], ...]:
    """Rays at even angles, both axes exactly; `count` is even, or zero for none."""
    unit = 1 << _RAY_BITS
    angles = [math.pi * k / count for k in range(count)]
    return tuple((Fraction(round(math.cos(a) * unit), unit), Fraction(round(math.sin(a) * unit), unit)) for a in angles)


def natural_scale(channel: Channel, frequency_rad_s: float) -> Scale:
    """Powers of two near the time and the speeds of the reference model, for one axis or two."""
    power = Fraction(2) ** round(math.log2(frequency_rad_s))
    count, axes = len(channel.corners[0][0].a), len(channel.corners[0][0].c)
    states = [Fraction(1)] * axes + [power] * axes + [power * power / 8] * (count - 2 * axes)
    gain = max((float(abs(entry)) for corner in channel.corners for row in corner[0].c for entry in row), default=1.0)
    weight = Fraction(2) ** round(math.log2(max(gain, 1e-9)))
    states[2 * axes :] = [power * power / weight] * (count - 2 * axes)
    return Scale(1 / power, tuple(states))


def plan(channel: Channel, count: int, scale: Scale) -> Plan:
    """The inequalities with so many rays."""
    chosen = rays(count)
    cut = sectors(channel, chosen)
    return Plan(channel, chosen, scale, cut, [*falls(channel, cut, scale), *positive(channel, cut, scale)])


def prove_by_sectors(channel: Channel, count: int, frequency_rad_s: float) -> SectorProof | None:
    """An exactly checked proof with so many rays, or None.

    Parameters
    ----------
    channel
        What is to be proven.
    count
        Rays: even, or zero for one quadratic function.
    frequency_rad_s
        Natural frequency of the reference model: it sets the scale.
    """
    wanted = plan(channel, count, natural_scale(channel, frequency_rad_s))
    candidate = solve(wanted)
    if candidate is None or candidate.margin < _LEAST:
        return None
    for bits in _ROUNDING_BITS:
        if candidate.margin < 2.0 ** -(bits + 2):
            continue
        proof = rounded(wanted, candidate, bits)
        if not check_sectors(proof, channel):
            return proof
    return None


def rounded(wanted: Plan, candidate: Candidate, bits: int) -> SectorProof:
    """The candidate in rationals with `bits` binary places."""
    numbers = [Fraction(round(math.ldexp(float(value), bits)), 1 << bits) for value in candidate.unknowns]
    entries, extra = len(pattern(wanted.cut)), multipliers(wanted.channel)
    rest = [max(number, Fraction(0)) for number in numbers[entries:]]
    return SectorProof(wanted.rays, wanted.scale, tuple(numbers[:entries]), tuple(rest[:extra]), tuple(rest[extra:]))


def solve(wanted: Plan) -> Candidate | None:
    """Maximise the smallest eigenvalue over all inequalities. None if the solver has no finite answer."""
    import clarabel  # noqa: PLC0415 - it takes its time to load
    from scipy import sparse  # noqa: PLC0415

    entries, extra = len(pattern(wanted.cut)), multipliers(wanted.channel)
    signs = len(wanted.inequalities) if wanted.rays else 0
    count = entries + extra + signs  # then the margin
    blocks = _Blocks()
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
    for number, inequality in enumerate(wanted.inequalities):
        columns, matrices = _matrices(wanted, inequality)
        if wanted.rays:
            columns = np.append(columns, entries + extra + number)
            matrices = np.concatenate([matrices, _sign(matrices.shape[1])])
        width = matrices.shape[1]
        blocks.semidefinite(first, columns, matrices, count)
        cones.append(clarabel.PSDTriangleConeT(width))
        first += width * (width + 1) // 2
    matrix = sparse.csc_matrix(blocks.entries(), shape=(first, count + 1))
    linear = np.zeros(count + 1)
    linear[-1] = -1.0
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    settings.presolve_enable = False
    settings.chordal_decomposition_enable = False
    settings.direct_solve_method = "faer"
    none = sparse.csc_matrix((count + 1, count + 1))
    right = np.concatenate([offset, np.zeros(first - len(offset))])
    solver = clarabel.DefaultSolver(none, linear, matrix, right, cones, settings)
    interrupt = _Interrupt()
    solver.set_termination_callback(interrupt.guarded(_is_decided))
    x = np.asarray(solver.solve().x)
    interrupt.reraise()
    return Candidate(x[:-1], float(x[-1])) if np.all(np.isfinite(x)) else None


class _Interrupt:
    """Clarabel swallows what its callback raises, Ctrl-C too: it is kept and raised after the solve."""

    def __init__(self) -> None:
        self._raised: BaseException | None = None

    def guarded(self, decided: Callable[[Any], bool]) -> Callable[[Any], bool]:
        def callback(info: Any) -> bool:
            try:
                return decided(info)
            except BaseException as error:
                self._raised = error
                return True

        return callback

    def reraise(self) -> None:
        if self._raised is not None:
            raise self._raised


def _is_decided(info: Any) -> bool:
    """Whether the margin is surely positive."""
    return bool(-info.cost_primal > max(_DECIDED, 1e3 * info.res_primal))


class _Blocks:
    """Entries of the constraint matrix as they come."""

    def __init__(self) -> None:
        self._rows: list[NDArray[np.intp]] = []
        self._columns: list[NDArray[np.intp]] = []
        self._values: list[Floats] = []

    def rows(self, row: int, columns: Sequence[int], value: float) -> None:
        self._add(np.full(len(columns), row), np.asarray(columns), np.full(len(columns), value))

    def semidefinite(self, first: int, columns: NDArray[np.intp], matrices: Floats, margin: int) -> None:
        """`sum_k x_k M_k - margin I` in the cone, as vectors of the upper triangle by columns."""
        width = matrices.shape[1]
        column, row = np.tril_indices(width)
        vectors = matrices[:, row, column] * np.where(row == column, 1.0, math.sqrt(2.0))
        which, place = np.nonzero(vectors)
        self._add(first + place, columns[which], -vectors[which, place])
        on_diagonal = np.nonzero(row == column)[0]
        self._add(first + on_diagonal, np.full(width, margin), np.ones(width))

    def entries(self) -> tuple[Floats, tuple[NDArray[np.intp], NDArray[np.intp]]]:
        return np.concatenate(self._values), (np.concatenate(self._rows), np.concatenate(self._columns))

    def _add(self, rows: NDArray[np.intp], columns: NDArray[np.intp], values: Floats) -> None:
        self._rows.append(rows)
        self._columns.append(columns)
        self._values.append(values)


def _matrices(wanted: Plan, inequality: Inequality) -> tuple[NDArray[np.intp], Floats]:
    """Unknowns of an inequality, and the symmetric matrix of each."""
    sector, places = wanted.cut[inequality.sector], pattern(wanted.cut)
    g = np.array(inequality.state, dtype=float)
    n, width = g.shape
    i, j = np.triu_indices(n)
    signs = np.array(sector.signs, dtype=float)
    chosen = [places[min(a, b), max(a, b)] for a, b in zip(_at(sector, i), _at(sector, j), strict=True)]
    halved = np.where(i == j, 0.5, 1.0) * signs[i] * signs[j]
    if inequality.rate:
        h = np.array(inequality.rate, dtype=float)
        product = g[i][:, :, None] * h[j][:, None, :] + g[j][:, :, None] * h[i][:, None, :]
        matrices = -halved[:, None, None] * (product + product.transpose(0, 2, 1))
    else:
        product = g[i][:, :, None] * g[j][:, None, :]
        matrices = halved[:, None, None] * (product + product.transpose(0, 2, 1))
    entries = len(places)
    squares = []
    for square in inequality.squares:
        total = np.zeros((width, width))
        for factor, row in square.terms:
            values = np.array(row, dtype=float)
            total -= float(factor) * np.outer(values, values)
        squares.append(total)
    columns = np.array([*chosen, *range(entries, entries + len(squares))], dtype=np.intp)
    return columns, np.concatenate([matrices, np.array(squares).reshape(-1, width, width)])


def _at(sector: Sector, index: NDArray[np.intp]) -> list[int]:
    return [sector.places[k] for k in index]


def _sign(width: int) -> Floats:
    matrix = np.zeros((1, width, width))
    matrix[0, 0, 1] = matrix[0, 1, 0] = -1.0
    return matrix
