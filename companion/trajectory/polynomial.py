"""Piecewise polynomials in time: what waypoints, samples and transfers become. Evaluated in pure floats."""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass, field
from itertools import accumulate

from companion.control.types import Reference
from companion.trajectory.series import polynomial
from companion.trajectory.trajectory import heading, instant

_TURN = (0.0, 0.0, 0.0, 10.0, -15.0, 6.0)  # from 0 to 1 with rate and acceleration zero at both ends
MOVING_M_S = 0.05  # slower than this a path has no direction that is worth turning to
_PROBES = 200


@dataclass(frozen=True)
class Piece:
    """A stretch of time: north, east and down as coefficients from the constant one up, and the heading at its ends."""

    duration_s: float
    north: tuple[float, ...]
    east: tuple[float, ...]
    down: tuple[float, ...]
    yaw_rad: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class Piecewise:
    """Pieces one after the other. With `along_path` the heading is that of the velocity in place of their own."""

    pieces: tuple[Piece, ...]
    along_path: bool = False
    _ends_s: tuple[float, ...] = field(init=False, repr=False, compare=False)
    _moving_s: tuple[float, float] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_ends_s", tuple(accumulate(piece.duration_s for piece in self.pieces)))
        object.__setattr__(self, "_moving_s", self._moving() if self.along_path else (0.0, self.duration_s))

    @property
    def duration_s(self) -> float:
        """Of all pieces."""
        return self._ends_s[-1]

    def at(self, time_s: float) -> Reference:
        """The instant. Before and after it, at rest where it begins and ends."""
        now = self._at(min(max(time_s, 0.0), self.duration_s))
        if self.along_path:
            first_s, last_s = self._moving_s
            now = now._replace(yaw_rad=heading(self._at(min(max(time_s, first_s), last_s))))
        return now if 0.0 <= time_s <= self.duration_s else _stopped(now)

    def _at(self, time_s: float) -> Reference:
        index = min(bisect_right(self._ends_s, time_s), len(self.pieces) - 1)
        piece = self.pieces[index]
        within = time_s - (self._ends_s[index] - piece.duration_s)
        begin, end = piece.yaw_rad
        yaw = begin
        if end != begin:
            yaw += (end - begin) * polynomial(_TURN, min(max(within / piece.duration_s, 0.0), 1.0))[0]
        return instant(
            polynomial(piece.north, within), polynomial(piece.east, within), polynomial(piece.down, within), yaw
        )

    def _moving(self) -> tuple[float, float]:
        """From when to when it has a direction: at its ends, where it is at rest, it keeps that of the way there."""
        times = [self.duration_s * k / _PROBES for k in range(_PROBES + 1)]
        moving = [t for t in times if math.hypot(*self._at(t)[3:5]) > MOVING_M_S]
        return (moving[0], moving[-1]) if moving else (0.0, 0.0)


def _stopped(at: Reference) -> Reference:
    x, y, z, yaw = at.x_m, at.y_m, at.z_m, at.yaw_rad
    return Reference(x, y, z, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, yaw)


def quintic(begin: tuple[float, float, float], end: tuple[float, float, float], duration_s: float) -> tuple[float, ...]:
    """Coefficients between two states (position, velocity, acceleration)."""
    p0, v0, a0 = begin
    t = duration_s
    h = 0.5 * a0
    p, v, a = end[0] - p0 - v0 * t - h * t * t, end[1] - v0 - a0 * t, end[2] - a0
    return (
        p0, v0, h,
        (10.0 * p - 4.0 * v * t + 0.5 * a * t * t) / t**3,
        (-15.0 * p + 7.0 * v * t - a * t * t) / t**4,
        (6.0 * p - 3.0 * v * t + 0.5 * a * t * t) / t**5,
    )  # fmt: skip


def nonic(begin: tuple[float, ...], end: tuple[float, ...], duration_s: float) -> tuple[float, ...]:
    """Coefficients between two states (position, velocity, acceleration, jerk, snap): all of them continuous."""
    t = duration_s
    low = [value * t**k / math.factorial(k) for k, value in enumerate(begin)]
    # What the lower half leaves of each scaled derivative at the end: sum over the upper half of binomials.
    left = [value * t**k / math.factorial(k) for k, value in enumerate(end)]
    for k in range(5):
        left[k] -= sum(low[n] * math.comb(n, k) for n in range(k, 5))
    high = [sum(_INVERSE[row][k] * left[k] for k in range(5)) for row in range(5)]
    return tuple(c / t**n for n, c in enumerate((*low, *high)))


# Inverse of the matrix of comb(5 + column, row): exact integers.
_INVERSE = (
    (126.0, -56.0, 21.0, -6.0, 1.0),
    (-420.0, 196.0, -77.0, 23.0, -4.0),
    (540.0, -260.0, 106.0, -33.0, 6.0),
    (-315.0, 155.0, -65.0, 21.0, -4.0),
    (70.0, -35.0, 15.0, -5.0, 1.0),
)
