"""Trajectories one after the other, from where control began: what is between them is joined without a jump.

Each leg counts its places from where control began, or, absolute, from the local origin. Where one does not begin as
the one before has ended, in place, heading and all derivatives, the way on goes between them: what ends in motion is
brought to rest, what begins in motion is led into from rest, and a transfer goes from the one place to the other.
Each is the polynomial of degree 9 that continues both its ends up to the snap.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

from companion.control.types import Reference
from companion.trajectory.feasibility import Limits, excess
from companion.trajectory.polynomial import Piece, Piecewise, nonic
from companion.trajectory.trajectory import Hold, Place, Trajectory, moved, rest

_SAME: Final = 1e-6
_ROUNDS: Final = 60
_SLOWER: Final = 1.15
_SHORTEST_S: Final = 0.5
_PEAKS: Final = (2.47, 8.0, 52.5)  # of velocity, acceleration and jerk on a way of one in a second, from rest to rest


@dataclass(frozen=True)
class Leg:
    """A trajectory and how it is placed.

    `name` for a person; `absolute`, its places are those of the local origin and its heading is north's; `from_north`,
    its headings are not turned by that of the engagement; `steps`, its places are set-points to
    travel to, not instants to be at; `stays`, it holds wherever the one before has ended.
    """

    name: str
    trajectory: Trajectory
    absolute: bool = False
    from_north: bool = False
    steps: bool = False
    stays: bool = False

    def origin(self, engaged: Place) -> Place:
        """What its places count from, where control began at `engaged`."""
        if self.absolute:
            return (0.0, 0.0, 0.0, 0.0)
        north, east, down, yaw = engaged
        return north, east, down, 0.0 if self.from_north else yaw


class Placed(NamedTuple):
    """A leg or a transfer in its place and time."""

    begin_s: float
    trajectory: Trajectory
    by: Place
    steps: bool


class Course:
    """Legs as they are flown from where control began.

    Attribute: `duration_s`, of all. Raises `ValueError` where no transfer fits the limits.
    """

    def __init__(self, legs: Sequence[Leg], engaged: Place, limits: Limits) -> None:
        self._placed: list[Placed] = []
        self.duration_s = 0.0
        here = rest(engaged)
        for leg in legs:
            by = leg.origin(engaged)
            if _moves(here) and (leg.stays or leg.steps or _apart(here, moved(leg.trajectory.at(0.0), by))):
                here = self._join(brake(here, limits))
            if leg.stays:
                hold = Hold(leg.trajectory.duration_s, (*here[:3], here.yaw_rad))
                self._append(Placed(self.duration_s, hold, _NOWHERE, False))
                continue
            first = moved(leg.trajectory.at(0.0), by)
            if not leg.steps and _apart(here, first):
                start = lead_in(first, limits) if _moves(first) else None
                into = first if start is None else start.at(0.0)
                if _apart(here, into):
                    self._join(transfer(here, into, limits))
                if start is not None:
                    self._join(start)
            self._append(Placed(self.duration_s, leg.trajectory, by, leg.steps))
            here = moved(leg.trajectory.at(leg.trajectory.duration_s), by)
        if _moves(here):
            self._join(brake(here, limits))
        self._begins = [placed.begin_s for placed in self._placed]

    def at(self, time_s: float) -> tuple[Reference, bool]:
        """(the instant, whether it is a set-point to travel to)."""
        index = bisect_right(self._begins, time_s) - 1
        begin_s, trajectory, by, steps = self._placed[index if index > 0 else 0]
        return moved(trajectory.at(time_s - begin_s), by), steps

    def _join(self, way: Piecewise) -> Reference:
        self._append(Placed(self.duration_s, way, _NOWHERE, False))
        return way.at(way.duration_s)

    def _append(self, placed: Placed) -> None:
        self._placed.append(placed)
        self.duration_s += placed.trajectory.duration_s


_NOWHERE: Final = (0.0, 0.0, 0.0, 0.0)


def transfer(begin: Reference, end: Reference, limits: Limits) -> Piecewise:
    """From rest to rest, as fast as the limits allow within a seventh. Raises `ValueError`."""
    way = math.dist(begin[:3], end[:3])
    peak_v, peak_a, peak_j = _PEAKS
    shortest_s = max(
        _SHORTEST_S,
        peak_v * way / limits.speed_m_s,
        math.sqrt(peak_a * way / limits.acceleration_m_s2),
        (peak_j * way / limits.jerk_m_s3) ** (1.0 / 3.0),
        1.9 * abs(_turn(begin, end)) / limits.yaw_rate_rad_s,
    )
    return _first_within(lambda duration_s: _between(begin, end, duration_s), shortest_s, limits)


def lead_in(end: Reference, limits: Limits) -> Piecewise:
    """From rest, wherever that has to be, to an instant in motion. Raises `ValueError`."""
    return _first_within(
        lambda duration_s: _between(_rest_near(end, -duration_s), end, duration_s), _SHORTEST_S, limits
    )


def brake(begin: Reference, limits: Limits) -> Piecewise:
    """From an instant in motion to rest, wherever that will be. Raises `ValueError`."""
    return _first_within(lambda duration_s: braked(begin, duration_s), _SHORTEST_S, limits)


def braked(begin: Reference, duration_s: float) -> Piecewise:
    """From an instant in motion to rest in so long."""
    return _between(begin, _rest_near(begin, duration_s), duration_s)


def _first_within(way: Callable[[float], Piecewise], shortest_s: float, limits: Limits) -> Piecewise:
    """Of ways of growing duration the first that keeps the limits."""
    for k in range(_ROUNDS):
        found = way(shortest_s * _SLOWER**k)
        too_much = excess(found, limits)
        if too_much is None:
            return found
    assert too_much is not None
    raise ValueError(f"there is no way on within the limits: {too_much._replace(slower=math.inf).describe()}")


def _rest_near(at: Reference, duration_s: float) -> Reference:
    """Where a vehicle would come to rest so much later, or, negative, would have been: the least jerk's place."""
    t, h = 0.5 * duration_s, duration_s * duration_s / 12.0
    x, y, z, vx, vy, vz, ax, ay, az = at[:9]
    return rest((x + t * vx + h * ax, y + t * vy + h * ay, z + t * vz + h * az, at.yaw_rad))


def _between(begin: Reference, end: Reference, duration_s: float) -> Piecewise:
    north, east, down = (nonic(begin[axis:15:3], end[axis:15:3], duration_s) for axis in range(3))
    turned = begin.yaw_rad + _turn(begin, end)
    return Piecewise((Piece(duration_s, north, east, down, (begin.yaw_rad, turned)),))


def _turn(begin: Reference, end: Reference) -> float:
    between = end.yaw_rad - begin.yaw_rad
    return math.atan2(math.sin(between), math.cos(between))


def _apart(one: Reference, other: Reference) -> bool:
    turn = math.sin(0.5 * (one.yaw_rad - other.yaw_rad))
    return any(abs(a - b) > _SAME for a, b in zip(one[:15], other[:15], strict=True)) or abs(turn) > _SAME


def _moves(at: Reference) -> bool:
    return any(abs(value) > _SAME for value in at[3:9])
