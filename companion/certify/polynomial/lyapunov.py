"""A common homogeneous polynomial Lyapunov function by sum of squares: eq. (25) lifted to monomials.

The conic problem goes to Clarabel directly, which spares the modelling layer its rebuild at every step of a bisection.
What comes back is a floating point candidate and nothing more; `companion.certify.proof` decides.

Without scaling this fails numerically from degree 6 on. So time is scaled by the slow modes of the vertices, and the
coordinates by the Cholesky factor of a quadratic Lyapunov matrix: of one that falls nearly as fast, or rises nearly
as slowly, as any can.
"""

import functools
import math
from typing import Any, NamedTuple

import clarabel
import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from companion.certify.polynomial.lifting import gram_null_space, lifted_pattern, monomials
from companion.certify.search import conic

Floats = NDArray[np.float64]

MARGIN_CAP = 1.0  # the scaled problem has decay rates near 1: more margin than that means nothing
DECIDED_MARGIN = 1e-4  # the solver may stop above: the exact check needs no better one
SLACK = 0.2  # decay rate given away to keep P round: the fastest P is a needle along fast modes


class Candidate(NamedTuple):
    """A polynomial that the solver believes in, over the monomials of half its degree.

    Attributes
    ----------
    lyapunov
        (N, N) Gram matrix P.
    multipliers
        (vertices, relations) factors of the Gram null space.
    margin
        Smallest eigenvalue that the solver aims at; positive if it believes in the candidate.
    """

    lyapunov: Floats
    multipliers: Floats
    margin: float


def coordinates(vertices: Floats, rounds: int = 8) -> tuple[float, Floats]:
    """Time unit and coordinates in which a good quadratic Lyapunov function, also a rising one, is close to round.

    Parameters
    ----------
    vertices
        (m, n, n) closed-loop matrices in SI units.
    rounds
        Number of solve-and-rescale rounds.

    Returns
    -------
    time_scale, transform
        A power of two in s, and a (n, n) lower triangular T with powers of two on its diagonal and short binary
        fractions below, so that T and its inverse are short exact numbers; x = T y.
    """
    n = vertices.shape[1]
    exponents = np.zeros(n)
    size = np.abs(vertices).max(axis=0)
    for _ in range(20):  # Osborne balancing by powers of two
        scaled = size * 2.0 ** (exponents[None, :] - exponents[:, None])
        off = scaled - np.diag(np.diag(scaled))
        column, row = off.sum(axis=0), off.sum(axis=1)
        exponents += np.round(0.25 * np.log2(np.where((column > 0) & (row > 0), row / np.maximum(column, 1e-300), 1.0)))
    transform = np.diag(2.0**exponents)
    slow = np.sort(np.abs(np.linalg.eigvals(vertices)), axis=1)[:, : min(n, 3)]  # not the poles of a short delay
    time_scale = 2.0 ** -round(math.log2(slow.mean()))
    for _ in range(rounds):
        scaled = rescale(vertices, time_scale, transform)
        decay = -float(np.linalg.eigvalsh(scaled + scaled.transpose(0, 2, 1)).max()) / 2  # rate at which |y| falls
        candidate = solve(scaled + (decay - SLACK) * np.eye(n), 2)
        if candidate is None or candidate.margin <= 0:
            break
        # P = U U^T with U upper triangular (Cholesky in reverse order): x^T P x = |y|^2 for y = U^T x
        reverse = np.linalg.cholesky(candidate.lyapunov[::-1, ::-1])
        transform = transform @ np.linalg.inv(reverse.T[::-1, ::-1])
    return time_scale, _short(transform)


def rescale(vertices: Floats, time_scale: float, transform: Floats) -> Floats:
    """(m, n, n) vertices in scaled time and coordinates: `time_scale T^-1 A T`."""
    return np.asarray(time_scale * np.linalg.solve(transform, vertices @ transform), dtype=np.float64)


def solve(vertices: Floats, degree: int) -> Candidate | None:
    """Look for a common polynomial of the degree, in coordinates already scaled.

    Maximises t subject to `P >= t I`, `-(L_i^T P + P L_i) + N_i >= t I` and `trace P = N`.

    Parameters
    ----------
    vertices
        (m, n, n) scaled closed-loop matrices.
    degree
        Even degree of the polynomial.

    Returns
    -------
    Candidate or None
        None if the solver has no finite answer. A candidate may still be wrong.
    """
    problem = _conic_problem(vertices, degree)
    psd = clarabel.PSDTriangleConeT(problem.size)
    cones = [clarabel.ZeroConeT(1), clarabel.NonnegativeConeT(1), *([psd] * (len(vertices) + 1))]
    x = np.asarray(conic.solve(problem.linear, problem.matrix, problem.offset, cones, _is_decided).x)
    if not np.all(np.isfinite(x)):
        return None
    entries = problem.size * (problem.size + 1) // 2
    scale = _monomial_scale(vertices.shape[1], degree // 2)
    lyapunov = _matrix(x[:entries], problem.size) * np.outer(scale, scale)
    return Candidate(lyapunov, x[entries:-1].reshape(len(vertices), -1), float(x[-1]))


def _is_decided(info: Any) -> bool:
    """Whether the margin is surely positive."""
    return bool(-info.cost_primal > max(DECIDED_MARGIN, 1e3 * info.res_primal))


class _ConicProblem(NamedTuple):
    """Minimise `linear^T x` with `offset - matrix x` in zero, nonnegative and semidefinite cones (P, vertices)."""

    size: int
    linear: Floats
    matrix: sparse.csc_matrix
    offset: Floats


def _conic_problem(vertices: Floats, degree: int) -> _ConicProblem:
    m, n = len(vertices), vertices.shape[1]
    half = degree // 2
    size = len(monomials(n, half))
    entries = size * (size + 1) // 2
    null = _null_space(n, half)
    relations = null.shape[1]
    identity = _vector(np.eye(size))
    columns = entries + m * relations + 1

    lifted = _lifted(vertices, half)
    basis = _basis(size)
    on_margin = sparse.csc_matrix(identity[:, None])
    blocks: list[list[Any]] = [[None] * (m + 2) for _ in range(m + 1)]
    blocks[0][0] = -sparse.identity(entries)
    blocks[0][-1] = on_margin
    for i in range(m):
        product = basis @ lifted[i]
        derivative = _vector(product + product.transpose(0, 2, 1)).T
        blocks[i + 1][0] = sparse.csc_matrix(derivative)
        blocks[i + 1][i + 1] = -null
        blocks[i + 1][-1] = on_margin
    for i in range(m):  # an empty null space (degree 2) still needs its column of blocks
        if relations == 0:
            blocks[i + 1][i + 1] = sparse.csc_matrix((entries, 0))
    trace = sparse.csc_matrix((identity, (np.zeros(entries, int), np.arange(entries))), shape=(1, columns))
    cap = sparse.csc_matrix(([1.0], ([0], [columns - 1])), shape=(1, columns))
    matrix = sparse.vstack([trace, cap, sparse.bmat(blocks)], format="csc")
    offset = np.concatenate([[size, MARGIN_CAP], np.zeros((m + 1) * entries)])
    linear = np.zeros(columns)
    linear[-1] = -1.0
    return _ConicProblem(size, linear, matrix, offset)


@functools.cache
def _monomial_scale(n: int, degree: int) -> Floats:
    """Root of the multinomial coefficient of each monomial: |z| = |x|^d, and a round P stays round when lifted."""
    counts = [math.factorial(degree) // math.prod(math.factorial(e) for e in m) for m in monomials(n, degree)]
    return np.asarray(np.sqrt(np.array(counts, dtype=float)), dtype=np.float64)


def _lifted(vertices: Floats, degree: int) -> Floats:
    """(m, N, N) lifted matrices over the scaled monomials."""
    n = vertices.shape[1]
    row, column, i, j, factor = np.array(lifted_pattern(n, degree)).T
    scale = _monomial_scale(n, degree)
    lifted = np.zeros((len(vertices), len(scale), len(scale)))
    values = vertices[:, i, j] * factor * scale[row] / scale[column]
    np.add.at(lifted.transpose(1, 2, 0), (row, column), values.T)
    return lifted


@functools.cache
def _null_space(n: int, degree: int) -> sparse.csc_matrix:
    """(entries, relations) Gram null space over the scaled monomials, vectorised."""
    scale = _monomial_scale(n, degree)
    relations = gram_null_space(n, degree)
    rows, columns, values = [], [], []
    for number, (i, j, k, l) in enumerate(relations):  # noqa: E741
        for sign, a, b in ((1.0, i, j), (-1.0, k, l)):
            rows.append(b * (b + 1) // 2 + a)
            columns.append(number)
            values.append(sign / (scale[a] * scale[b]) * (1.0 if a == b else math.sqrt(0.5)))
    size = len(scale)
    return sparse.csc_matrix((values, (rows, columns)), shape=(size * (size + 1) // 2, len(relations)))


@functools.cache
def _triangle(size: int) -> tuple[NDArray[np.intp], NDArray[np.intp], Floats]:
    """Upper triangle by columns, as Clarabel orders it, and the weights that keep the inner product."""
    columns, rows = np.tril_indices(size)
    return rows, columns, np.where(rows == columns, 1.0, math.sqrt(2.0))


def _vector(matrices: Floats) -> Floats:
    """Symmetric matrices (..., N, N) as vectors (..., N (N + 1) / 2)."""
    rows, columns, weights = _triangle(matrices.shape[-1])
    return np.asarray(matrices[..., rows, columns] * weights)


def _matrix(vector: Floats, size: int) -> Floats:
    rows, columns, weights = _triangle(size)
    matrix = np.zeros((size, size))
    matrix[rows, columns] = matrix[columns, rows] = vector / weights
    return matrix


@functools.cache
def _basis(size: int) -> Floats:
    """(entries, N, N) symmetric matrices whose vectors are the unit vectors."""
    rows, columns, weights = _triangle(size)
    basis = np.zeros((len(rows), size, size))
    index = np.arange(len(rows))
    basis[index, rows, columns] = basis[index, columns, rows] = 1.0 / weights
    return basis


def _short(transform: Floats) -> Floats:
    """Lower triangular T, its diagonal rounded to powers of two and the rest to 6 bits of the diagonal of its row."""
    powers = 2.0 ** np.round(np.log2(np.abs(np.diag(transform))))
    unit = transform / np.diag(transform)[None, :] * powers[None, :]
    return np.asarray(np.tril(np.round(unit / powers[:, None] * 64) / 64 * powers[:, None], -1) + np.diag(powers))
