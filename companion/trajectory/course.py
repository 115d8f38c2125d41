"""Trajectories one after the other, from where control began: what is between them is joined without a jump.

Each leg counts its places from where control began, or, absolute, from the local origin. Where one does not begin as
the one before has ended, in place, heading and all derivatives up to the snap, a transfer goes between them: the
polynomial of degree 9 that continues both. What ends in motion is brought to rest.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

from companion.control.types import Reference
from companion.trajectory.feasibility import Limits, excess
from companion.trajectory.polynomial import Piece, Piecewise, nonic
from companion.trajectory.trajectory import Hold, Place, Trajectory, moved, rest

_SAME: Final = 1e-6
_ROUNDS: Final = 60
_SLOWER: Final = 1.15
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
            if leg.stays:
                if _moves(here):
                    here = self._stop(here, limits)
                hold = Hold(leg.trajectory.duration_s, (*here[:3], here.yaw_rad))
                self._append(Placed(self.duration_s, hold, _NOWHERE, False))
                continue
            by = leg.origin(engaged)
            first = moved(leg.trajectory.at(0.0), by)
            if not leg.steps and _apart(here, first):
                self._append(Placed(self.duration_s, transfer(here, first, limits), _NOWHERE, False))
            self._append(Placed(self.duration_s, leg.trajectory, by, leg.steps))
            here = moved(leg.trajectory.at(leg.trajectory.duration_s), by)
        if _moves(here):
            self._stop(here, limits)
        self._begins = [placed.begin_s for placed in self._placed]

    def at(self, time_s: float) -> tuple[Reference, bool]:
        """(the instant, whether it is a set-point to travel to)."""
        begin_s, trajectory, by, steps = self._placed[max(bisect_right(self._begins, time_s) - 1, 0)]
        return moved(trajectory.at(time_s - begin_s), by), steps

    def _stop(self, here: Reference, limits: Limits) -> Reference:
        way = brake(here, limits)
        self._append(Placed(self.duration_s, way, _NOWHERE, False))
        return way.at(way.duration_s)

    def _append(self, placed: Placed) -> None:
        self._placed.append(placed)
        self.duration_s += placed.trajectory.duration_s


_NOWHERE: Final = (0.0, 0.0, 0.0, 0.0)


def transfer(begin: Reference, end: Reference, limits: Limits) -> Piecewise:
    """From one instant to another, as fast as the limits allow within a seventh. Raises `ValueError`."""
    way = math.dist(begin[:3], end[:3])
    turn = math.atan2(math.sin(end.yaw_rad - begin.yaw_rad), math.cos(end.yaw_rad - begin.yaw_rad))
    peak_v, peak_a, peak_j = _PEAKS
    duration = max(
        0.5,
        peak_v * way / limits.speed_m_s,
        math.sqrt(peak_a * way / limits.acceleration_m_s2),
        (peak_j * way / limits.jerk_m_s3) ** (1.0 / 3.0),
        1.9 * abs(turn) / limits.yaw_rate_rad_s,
    )
    found = None
    for _ in range(_ROUNDS):
        north, east, down = (nonic(begin[axis:15:3], end[axis:15:3], duration) for axis in range(3))
        joined = Piecewise((Piece(duration, north, east, down, (begin.yaw_rad, begin.yaw_rad + turn)),))
        found = excess(joined, limits)
        if found is None:
            return joined
        duration *= _SLOWER
    assert found is not None
    raise ValueError(f"no way there within the limits: {found._replace(slower=math.inf).describe()}")


def brake(begin: Reference, limits: Limits) -> Piecewise:
    """From an instant in motion to rest, straight on. Raises `ValueError`."""
    speed = math.hypot(*begin[3:6])
    duration = max(0.5, 4.0 * speed / limits.acceleration_m_s2)
    x, y, z, vx, vy, vz = begin[:6]
    half = 0.5 * duration
    return transfer(begin, rest((x + half * vx, y + half * vy, z + half * vz, begin.yaw_rad)), limits)


def _apart(one: Reference, other: Reference) -> bool:
    turn = math.sin(0.5 * (one.yaw_rad - other.yaw_rad))
    return any(abs(a - b) > _SAME for a, b in zip(one[:15], other[:15], strict=True)) or abs(turn) > _SAME


def _moves(at: Reference) -> bool:
    return any(abs(value) > _SAME for value in at[3:9])
