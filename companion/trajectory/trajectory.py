"""What every trajectory is: a length in time and, at every instant of it, a `Reference`. Local NED, SI units.

A trajectory counts its places from its own origin; a mission moves them to where control began, or leaves them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

from companion.control.types import PositionSetpoint, Reference
from companion.trajectory.series import Series

Place = tuple[float, float, float, float]
"""North, east, down in m, and the heading in rad."""


class Trajectory(Protocol):
    """Anything that can be flown along."""

    @property
    def duration_s(self) -> float:
        """How long it takes."""

    def at(self, time_s: float) -> Reference:
        """The instant so long after its beginning; before that and after its end, it stays where it is then."""


def instant(north: Series, east: Series, down: Series, yaw_rad: float) -> Reference:
    """The instant whose series in time are these."""
    x, vx, ax, jx, sx = north
    y, vy, ay, jy, sy = east
    z, vz, az, jz, sz = down
    return Reference(
        x, y, z, vx, vy, vz, 2.0 * ax, 2.0 * ay, 2.0 * az, 6.0 * jx, 6.0 * jy, 6.0 * jz,
        24.0 * sx, 24.0 * sy, 24.0 * sz, yaw_rad,
    )  # fmt: skip


def level(north: Series, east: Series, yaw_rad: float) -> Reference:
    """The same in a horizontal plane."""
    x, vx, ax, jx, sx = north
    y, vy, ay, jy, sy = east
    return Reference(
        x, y, 0.0, vx, vy, 0.0, 2.0 * ax, 2.0 * ay, 0.0, 6.0 * jx, 6.0 * jy, 0.0, 24.0 * sx, 24.0 * sy, 0.0, yaw_rad
    )


def rest(place: Place) -> Reference:
    """At rest in a place."""
    x, y, z, yaw = place
    return Reference(x, y, z, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, yaw)


def moved(instant: Reference, by: PositionSetpoint | Place) -> Reference:
    """The same instant with its origin elsewhere, its heading turned; the path is not turned with it."""
    north, east, down, turn = by
    x, y, z, vx, vy, vz, ax, ay, az, jx, jy, jz, sx, sy, sz, yaw = instant
    return Reference(
        x + north, y + east, z + down, vx, vy, vz, ax, ay, az, jx, jy, jz, sx, sy, sz, yaw + turn
    )  # fmt: skip


@dataclass(frozen=True)
class Hold:
    """Stays in a place."""

    duration_s: float
    place: Place = (0.0, 0.0, 0.0, 0.0)

    def at(self, time_s: float) -> Reference:  # noqa: ARG002 - the same at any time
        """At rest."""
        return rest(self.place)


@dataclass(frozen=True)
class Shifted:
    """Another trajectory from another origin, its heading turned."""

    trajectory: Trajectory
    by: Place

    @property
    def duration_s(self) -> float:
        """As long."""
        return self.trajectory.duration_s

    def at(self, time_s: float) -> Reference:
        """The instant in its place."""
        return moved(self.trajectory.at(time_s), self.by)


@dataclass(frozen=True)
class Stretched:
    """Another trajectory, slower by a factor: the same path, derivative k less by its k-th power."""

    trajectory: Trajectory
    factor: float

    @property
    def duration_s(self) -> float:
        """So much longer."""
        return self.factor * self.trajectory.duration_s

    def at(self, time_s: float) -> Reference:
        """The instant of the other at the time it has there."""
        f = 1.0 / self.factor
        f2, f3, f4 = f * f, f * f * f, f * f * f * f
        x, y, z, vx, vy, vz, ax, ay, az, jx, jy, jz, sx, sy, sz, yaw = self.trajectory.at(f * time_s)
        return Reference(
            x, y, z, f * vx, f * vy, f * vz, f2 * ax, f2 * ay, f2 * az, f3 * jx, f3 * jy, f3 * jz,
            f4 * sx, f4 * sy, f4 * sz, yaw,
        )  # fmt: skip


def heading(instant: Reference) -> float:
    """Of the velocity, rad."""
    return math.atan2(instant.vy_m_s, instant.vx_m_s)
