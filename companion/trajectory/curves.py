"""Closed curves that begin and end at rest: circle and lemniscate, at a speed that is reached and left smoothly.

The phase of a curve runs at a constant rate but for a ramp at both ends, over which the rate follows
``35 u^4 - 84 u^5 + 70 u^6 - 20 u^7``: its first three derivatives vanish at both ends, so that the snap of the path is
continuous. Every derivative follows from the series of the phase.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

from companion.control.types import Reference
from companion.trajectory.series import Series, polynomial, scaled, sine_cosine
from companion.trajectory.trajectory import level

_RAMP = (0.0, 0.0, 0.0, 0.0, 0.0, 7.0, -14.0, 10.0, -2.5)  # integral of the rate over a ramp of one second: 1/2 at 1


@dataclass(frozen=True)
class Phase:
    """From rest at 0 to rest at `total_rad`, in between at `rate_rad_s`. A ramp is never longer than half of it."""

    total_rad: float
    rate_rad_s: float
    wanted_ramp_s: float

    @cached_property
    def ramp_s(self) -> float:
        """How long it takes to reach the rate."""
        return min(self.wanted_ramp_s, self.total_rad / self.rate_rad_s)

    @cached_property
    def duration_s(self) -> float:
        """From rest to rest."""
        return self.total_rad / self.rate_rad_s + self.ramp_s

    def at(self, time_s: float) -> Series:
        """The series about an instant."""
        ramp, rate, end = self.ramp_s, self.rate_rad_s, self.duration_s
        if time_s <= 0.0:
            return 0.0, 0.0, 0.0, 0.0, 0.0
        if time_s >= end:
            return self.total_rad, 0.0, 0.0, 0.0, 0.0
        if time_s < ramp:
            p0, p1, p2, p3, p4 = self._ramp(time_s / ramp)
            return p0, p1, p2, p3, p4
        if time_s > end - ramp:
            p0, p1, p2, p3, p4 = self._ramp((end - time_s) / ramp)
            return self.total_rad - p0, p1, -p2, p3, -p4
        return rate * (time_s - 0.5 * ramp), rate, 0.0, 0.0, 0.0

    def _ramp(self, share: float) -> Series:
        ramp, size = self.ramp_s, self.rate_rad_s * self.ramp_s
        c0, c1, c2, c3, c4 = polynomial(_RAMP, share)
        return size * c0, size * c1 / ramp, size * c2 / ramp**2, size * c3 / ramp**3, size * c4 / ramp**4


@dataclass(frozen=True)
class Circle:
    """Begins at its origin, northwards; its centre lies to the right (or left, `clockwise` false) of it."""

    radius_m: float
    speed_m_s: float
    laps: float
    ramp_s: float
    clockwise: bool = True
    along_path: bool = False
    yaw_rad: float = 0.0

    @cached_property
    def phase(self) -> Phase:
        """Angle travelled."""
        return Phase(2.0 * math.pi * self.laps, self.speed_m_s / self.radius_m, self.ramp_s)

    @cached_property
    def duration_s(self) -> float:
        """From rest to rest."""
        return self.phase.duration_s

    def at(self, time_s: float) -> Reference:
        """The instant; the heading along the path, or as given."""
        phase = self.phase.at(time_s)
        sine, (c0, c1, c2, c3, c4) = sine_cosine(phase)
        side = 1.0 if self.clockwise else -1.0
        east = scaled((1.0 - c0, -c1, -c2, -c3, -c4), side * self.radius_m)
        yaw = side * phase[0] if self.along_path else self.yaw_rad
        return level(scaled(sine, self.radius_m), east, yaw)


@dataclass(frozen=True)
class Lemniscate:
    """A figure of eight (Gerono): north `length/2 sin p`, east `width/2 sin 2p`; begins at its middle.

    `speed_m_s` is that in the middle, the largest.
    """

    length_m: float
    width_m: float
    speed_m_s: float
    laps: float
    ramp_s: float
    along_path: bool = False
    yaw_rad: float = 0.0

    @cached_property
    def phase(self) -> Phase:
        """The p of above."""
        rate = self.speed_m_s / math.hypot(0.5 * self.length_m, self.width_m)
        return Phase(2.0 * math.pi * self.laps, rate, self.ramp_s)

    @cached_property
    def duration_s(self) -> float:
        """From rest to rest."""
        return self.phase.duration_s

    def at(self, time_s: float) -> Reference:
        """The instant; the heading along the path, or as given."""
        phase = self.phase.at(time_s)
        half_length, half_width = 0.5 * self.length_m, 0.5 * self.width_m
        sine, _ = sine_cosine(phase)
        sine2, _ = sine_cosine(scaled(phase, 2.0))
        yaw = self.yaw_rad
        if self.along_path:
            yaw = math.atan2(2.0 * half_width * math.cos(2.0 * phase[0]), half_length * math.cos(phase[0]))
        return level(scaled(sine, half_length), scaled(sine2, half_width), yaw)
