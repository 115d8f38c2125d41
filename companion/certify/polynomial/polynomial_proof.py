"""A homogeneous polynomial Lyapunov function, checked exactly with the standard library alone.

By integer elimination

    P > 0   and   -(L_i^T P + P L_i) + N_i > 0   for every vertex i,

the lifted inequality (25): L_i is vertex i lifted to monomials of half the degree, N_i an element of the Gram null
space. Then z^T P z is positive and falls along every solution, however the weights move inside their bounds.
"""

import math
from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import NamedTuple

from companion.attitude_response.realisation import Matrix
from companion.certify.exact.elimination import positive_definite
from companion.certify.exact.rational import list_of, rational, rationals
from companion.certify.polynomial.lifting import gram_null_space, lift, monomials

MAX_DEGREE = 16
MAX_SIZE = 130  # of the lifted matrices: bounds the time a malformed file can take

KEYS = {"degree", "time_scale", "coordinates", "lyapunov", "multipliers"}


class Proof(NamedTuple):
    """A Lyapunov polynomial for a set of vertices, in exact rationals.

    Attributes
    ----------
    degree
        Even degree 2 d of the polynomial.
    time_scale
        Unit of the scaled time in s.
    coordinates
        (n, n) invertible T: the polynomial is written in y, x = T y.
    lyapunov
        Lower triangle, row by row, of the Gram matrix P over the monomials of degree d in y.
    multipliers
        Per vertex, one factor per relation of the Gram null space.
    """

    degree: int
    time_scale: Fraction
    coordinates: Matrix
    lyapunov: tuple[Fraction, ...]
    multipliers: tuple[tuple[Fraction, ...], ...]


def proof_of(stated: object) -> Proof:
    """A proof as it stands in a certificate. Raises `ValueError` for one that is malformed."""
    if not isinstance(stated, Mapping) or set(stated) != KEYS:
        raise ValueError("not the keys of a proof")
    degree = stated["degree"]
    if not isinstance(degree, int) or isinstance(degree, bool):
        raise ValueError("degree is not an integer")
    return Proof(
        degree,
        rational(stated["time_scale"]),
        tuple(rationals(row) for row in list_of(stated["coordinates"])),
        rationals(stated["lyapunov"]),
        tuple(rationals(row) for row in list_of(stated["multipliers"])),
    )


def check(proof: Proof, vertices: Sequence[Matrix]) -> str:
    """Check one proof exactly.

    Returns
    -------
    str
        Empty if it holds, else one line that says what fails.
    """
    half, n = proof.degree // 2, len(vertices[0])
    if proof.degree % 2 or not 2 <= proof.degree <= MAX_DEGREE or math.comb(n + half - 1, half) > MAX_SIZE:
        return f"degree {proof.degree} is not supported"
    if proof.time_scale <= 0:
        return "time scale is not positive"
    size, relations = len(monomials(n, half)), gram_null_space(n, half)
    if len(proof.coordinates) != n or any(len(row) != n for row in proof.coordinates):
        return f"coordinates are not {n} by {n}"
    if len(proof.lyapunov) != size * (size + 1) // 2:
        return "Lyapunov matrix has the wrong size"
    if len(proof.multipliers) != len(vertices) or any(len(m) != len(relations) for m in proof.multipliers):
        return "multipliers do not match the vertices"
    back = inverse(proof.coordinates)
    if back is None:
        return "coordinates are singular"

    unit = math.lcm(*(v.denominator for v in proof.lyapunov), *(v.denominator for m in proof.multipliers for v in m))
    p = _symmetric([int(v * unit) for v in proof.lyapunov], size)
    if not positive_definite(p):
        return "Lyapunov matrix is not positive definite"
    for number, (vertex, multipliers) in enumerate(zip(vertices, proof.multipliers, strict=True)):
        a = _product(_product(back, vertex), proof.coordinates)
        a = tuple(tuple(entry * proof.time_scale for entry in row) for row in a)
        common = math.lcm(*(entry.denominator for row in a for entry in row))
        decay = _decay(p, lift([[int(entry * common) for entry in row] for row in a], half))
        for (i, j, k, l), multiplier in zip(relations, multipliers, strict=True):  # noqa: E741
            factor = int(multiplier * unit) * common
            decay[j][i] += 2 * factor if i == j else factor
            decay[l][k] -= 2 * factor if k == l else factor
        if not positive_definite(decay):
            return f"the polynomial does not fall at vertex {number}"
    return ""


def inverse(matrix: Matrix) -> Matrix | None:
    """Exact inverse by Gauss-Jordan elimination, or None if the matrix is singular."""
    n = len(matrix)
    rows = [[*row, *(Fraction(i == j) for j in range(n))] for i, row in enumerate(matrix)]
    for k in range(n):
        pivot = next((i for i in range(k, n) if rows[i][k]), None)
        if pivot is None:
            return None
        rows[k], rows[pivot] = rows[pivot], rows[k]
        rows[k] = [entry / rows[k][k] for entry in rows[k]]
        for i in range(n):
            if i != k and rows[i][k]:
                rows[i] = [entry - rows[i][k] * other for entry, other in zip(rows[i], rows[k], strict=True)]
    return tuple(tuple(row[n:]) for row in rows)


def _decay(p: list[list[int]], lifted: list[dict[int, int]]) -> list[list[int]]:
    """Lower triangle of -2 (L^T P + P L): twice, so that the null space needs no halves."""
    size = len(p)
    product = [[0] * size for _ in range(size)]
    for k, row in enumerate(lifted):
        for column, entry in row.items():
            for i in range(size):
                product[i][column] += p[i][k] * entry
    return [[-2 * (product[i][j] + product[j][i]) for j in range(i + 1)] for i in range(size)]


def _symmetric(lower: list[int], size: int) -> list[list[int]]:
    position = [[max(i, j) * (max(i, j) + 1) // 2 + min(i, j) for j in range(size)] for i in range(size)]
    return [[lower[p] for p in row] for row in position]


def _product(left: Matrix, right: Matrix) -> Matrix:
    columns = list(zip(*right, strict=True))
    return tuple(
        tuple(sum((a * b for a, b in zip(row, column, strict=True)), Fraction(0)) for column in columns) for row in left
    )
