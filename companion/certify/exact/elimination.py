"""Positive definiteness in exact integers. Standard library only."""

from collections.abc import Sequence


def positive_definite(lower: Sequence[Sequence[int]]) -> bool:
    """Whether a symmetric integer matrix, given by its lower triangle, is positive definite.

    Fraction-free LDL^T elimination (Bareiss): the pivots are the leading principal minors, exact integers (Sylvester).
    """
    rows = [list(row[: i + 1]) for i, row in enumerate(lower)]
    previous = 1
    for k, pivot_row in enumerate(rows):
        pivot = pivot_row[k]
        if pivot <= 0:
            return False
        column = [rows[i][k] for i in range(k + 1, len(rows))]
        for i, factor in enumerate(column, start=k + 1):
            row = rows[i]
            row[k + 1 :] = [
                (pivot * entry - factor * other) // previous for entry, other in zip(row[k + 1 :], column, strict=False)
            ]
        previous = pivot
    return True
