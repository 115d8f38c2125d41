"""A linear system lifted to the monomials of one degree, in exact integers. Standard library only.

If x' = A x, the vector z of all monomials of degree d in x obeys z' = L z with a constant L. A homogeneous polynomial
of degree 2 d is z^T P z, and P is not unique: adding an element of the Gram null space (z^T N z = 0 for all x)
changes nothing."""

import functools
import itertools
from collections.abc import Sequence
from typing import NamedTuple

Monomial = tuple[int, ...]


class LiftedEntry(NamedTuple):
    """L[row, column] += factor * A[i, j]."""

    row: int
    column: int
    i: int
    j: int
    factor: int


class GramRelation(NamedTuple):
    """Two ways to write one monomial of degree 2 d: z[i] z[j] = z[k] z[l], with i <= j and k <= l."""

    i: int
    j: int
    k: int
    l: int  # noqa: E741


@functools.cache
def monomials(n: int, degree: int) -> tuple[Monomial, ...]:
    """Exponents of all monomials of the degree in n variables, in lexicographic order from x1^degree on."""
    chosen = itertools.combinations_with_replacement(range(n), degree)
    return tuple(tuple(variables.count(i) for i in range(n)) for variables in chosen)


@functools.cache
def lifted_pattern(n: int, degree: int) -> tuple[LiftedEntry, ...]:
    """How L follows from A: d/dt of x^alpha is the sum over i, j of alpha_i A[i, j] x^(alpha - e_i + e_j)."""
    basis = monomials(n, degree)
    index = {monomial: position for position, monomial in enumerate(basis)}
    entries = []
    for row, monomial in enumerate(basis):
        for i, j in itertools.product(range(n), repeat=2):
            if monomial[i]:
                other = list(monomial)
                other[i] -= 1
                other[j] += 1
                entries.append(LiftedEntry(row, index[tuple(other)], i, j, monomial[i]))
    return tuple(entries)


@functools.cache
def gram_null_space(n: int, degree: int) -> tuple[GramRelation, ...]:
    """A basis of the Gram null space: every product of two monomials against the first that gives the same."""
    basis = monomials(n, degree)
    first: dict[Monomial, tuple[int, int]] = {}
    relations = []
    for i, j in itertools.combinations_with_replacement(range(len(basis)), 2):
        product = tuple(a + b for a, b in zip(basis[i], basis[j], strict=True))
        if product in first:
            relations.append(GramRelation(i, j, *first[product]))
        else:
            first[product] = (i, j)
    return tuple(relations)


def lift(a: Sequence[Sequence[int]], degree: int) -> list[dict[int, int]]:
    """Rows of L for an integer A, each as {column: entry} of what is not zero."""
    n = len(a)
    rows: list[dict[int, int]] = [{} for _ in monomials(n, degree)]
    for row, column, i, j, factor in lifted_pattern(n, degree):
        if a[i][j]:
            rows[row][column] = rows[row].get(column, 0) + factor * a[i][j]
    return rows
