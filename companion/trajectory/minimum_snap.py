"""The smoothest way through places at given times: the least integral of squared snap. Needs numpy; before flight.

Every piece is a polynomial of degree 7, fixed by position, velocity, acceleration and jerk at its two ends. In units of
its duration T these are ``d_k = T^k p^(k)``, and the integral of its squared snap is ``T^-7 d^T H d``, H constant.
Positions are given, the derivatives at the places between are free: the sum is a quadratic form whose minimum solves a
block tridiagonal system, three numbers a place, in a time that grows with the number of places. Where derivatives are
free the higher ones up to the sixth come out continuous, as the minimum wants it. (Mellinger and Kumar, "Minimum snap
trajectory generation and control for quadrotors", ICRA 2011, with the elimination of Richter, Bry and Roy, 2013.)
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np

_HALF = 4  # derivatives at an end: from the position to the jerk


@lru_cache(maxsize=1)
def _hermite() -> tuple[Any, Any]:
    """((8, 8) coefficients of a unit piece from the derivatives at its ends, (8, 8) H)."""
    import numpy as np  # noqa: PLC0415 - flying does without

    powers = np.arange(2 * _HALF)
    ends = np.zeros((2 * _HALF, 2 * _HALF))
    for k in range(_HALF):
        falling = np.prod([powers - j for j in range(k)], axis=0) if k else np.ones(2 * _HALF)
        ends[k] = np.where(powers == k, falling, 0.0)
        ends[_HALF + k] = falling
    coefficients = np.linalg.inv(ends)
    falling = powers * (powers - 1) * (powers - 2) * (powers - 3)
    degree = powers[:, None] + powers[None, :] - 7
    snap = np.where(degree > 0, np.outer(falling, falling) / np.maximum(degree, 1), 0.0)
    return coefficients, coefficients.T @ snap @ coefficients


def minimum_snap(
    places: np.typing.NDArray[np.float64], durations_s: np.typing.NDArray[np.float64], *, at_rest: bool = True
) -> np.typing.NDArray[np.float64]:
    """Coefficients of the pieces, from the constant one up.

    Parameters
    ----------
    places
        (n, axes) positions, n >= 2, m.
    durations_s
        (n - 1,) of the pieces, positive.
    at_rest
        Whether velocity, acceleration and jerk vanish at both ends; otherwise they are free there too, and n is at
        least 4.

    Returns
    -------
    (n - 1, 8, axes) coefficients in the time since each piece began, m/s^k.
    """
    import numpy as np  # noqa: PLC0415

    basis, h = _hermite()
    count, axes = places.shape
    scale = durations_s[:, None] ** np.arange(_HALF)  # (n - 1, 4): of the unit derivatives
    full = np.concatenate([scale, scale], axis=1)
    blocks = h * full[:, :, None] * full[:, None, :] / durations_s[:, None, None] ** 7
    # Unknown u_i = (velocity, acceleration, jerk) at place i; B u_(i-1) + A u_i + C u_(i+1) = r.
    own = np.zeros((count, 3, 3))
    own[:-1] += blocks[:, 1:4, 1:4]
    own[1:] += blocks[:, 5:8, 5:8]
    after = blocks[:, 1:4, 5:8]
    right = np.zeros((count, 3, axes))
    right[:-1] -= blocks[:, 1:4, 0, None] * places[:-1, None] + blocks[:, 1:4, 4, None] * places[1:, None]
    right[1:] -= blocks[:, 5:8, 0, None] * places[:-1, None] + blocks[:, 5:8, 4, None] * places[1:, None]
    derivatives = np.zeros((count, 3, axes))
    first, last = (1, count - 1) if at_rest else (0, count)
    for i in range(first + 1, last):  # forward elimination
        factor = np.linalg.solve(own[i - 1], after[i - 1]).T
        own[i] = own[i] - factor @ after[i - 1]
        right[i] = right[i] - factor @ right[i - 1]
    for i in range(last - 1, first - 1, -1):
        known = right[i] - after[i] @ derivatives[i + 1] if i + 1 < last else right[i]
        derivatives[i] = np.linalg.solve(own[i], known)
    states = np.concatenate([places[:, None], derivatives], axis=1)  # (n, 4, axes)
    unit = np.concatenate([states[:-1] * scale[:, :, None], states[1:] * scale[:, :, None]], axis=1)
    coefficients: np.typing.NDArray[np.float64] = (basis @ unit) / (durations_s[:, None] ** np.arange(2 * _HALF))[
        :, :, None
    ]
    return coefficients
