"""Which samples of a series can be believed: a bad one of thousands is left out, the rest is as it was."""

from __future__ import annotations

from bisect import bisect_right
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

Indices = npt.NDArray[np.intp]
Floats = npt.NDArray[np.float64]

LONGEST_RUN: Final = 8  # samples in a row whose time is wrong are no single bad ones: the clock was set back
NEWEST_S: Final = float(1 << 55) * 1e-6  # a time above this is none
_FAR_S: Final = 10.0  # a step of time by more, onto a few samples, is no step of the clock
_FEW: Final = 0.01  # of all samples
_UNIT: Final = 0.1  # by how much the norm of a quaternion may differ from one


class Backwards(NamedTuple):
    """A clock that was set back: by how much, and what it showed before."""

    by_s: float
    after_s: float


def in_order(time_s: Floats) -> Indices:
    """The longest run of indices along which time does not fall."""
    if not len(time_s) or bool((np.diff(time_s) >= 0.0).all()):
        return np.arange(len(time_s))
    ends: list[float] = []  # the lowest time that ends a run of each length, and where
    where: list[int] = []
    before = np.full(len(time_s), -1)
    for i, t in enumerate(time_s.tolist()):
        at = bisect_right(ends, t)
        before[i] = where[at - 1] if at else -1
        if at == len(ends):
            ends.append(t)
            where.append(i)
        else:
            ends[at], where[at] = t, i
    kept, at = [], where[-1]
    while at >= 0:
        kept.append(at)
        at = int(before[at])
    return np.array(kept[::-1], np.intp)


def without_far(time_s: Floats) -> Indices:
    """Leave out the few samples that a step of time of more than `_FAR_S` parts from all others; time does not fall."""
    edges = np.flatnonzero(np.diff(time_s) > _FAR_S) + 1
    pieces = np.split(np.arange(len(time_s)), edges)
    few = max(1.0, _FEW * len(time_s))
    return np.concatenate([piece for piece in pieces if len(piece) > few] or pieces)


def set_back(time_s: Floats, kept: Indices, tolerance_s: float = 0.0) -> Backwards | None:
    """Whether what `in_order` left out is the mark of a clock that was set back, and where it was most."""
    out = np.ones(len(time_s), bool)
    out[kept] = False
    edges = np.flatnonzero(np.diff(out.astype(np.int8), prepend=0, append=0))
    long = [(a, b) for a, b in zip(edges[::2], edges[1::2], strict=True) if b - a > LONGEST_RUN]
    for a, b in long:
        out[a:b] = False
    time_s = time_s[~out]
    late = np.maximum.accumulate(time_s) - time_s
    if not long or late.max() <= tolerance_s:
        return None
    first = int(np.argmax(late > 0.5 * late.max()))
    return Backwards(float(late[first]), float(time_s[first] + late[first]))


def rising(time_s: Floats) -> Indices:
    """The first sample of each time; time does not fall."""
    return np.flatnonzero(np.diff(time_s, prepend=-np.inf) > 0.0)


def rotations(q: npt.NDArray[Any]) -> npt.NDArray[np.bool_]:
    """Which of some quaternions, shape (n, 4), are finite and near enough to unit length to be a rotation."""
    with np.errstate(over="ignore", invalid="ignore"):
        norm = np.sqrt((q.astype(np.float64) ** 2).sum(axis=1))
    return np.asarray(np.abs(norm - 1.0) < _UNIT)
