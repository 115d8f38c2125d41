"""Whether a vehicle can fly a trajectory: what it asks for against what there is, where, and by how much too much."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Final, NamedTuple

from companion.control.types import GRAVITY_M_S2, Reference
from companion.trajectory.trajectory import Stretched, Trajectory

_STEP_S: Final = 0.02
_MOST_SAMPLES: Final = 5000
_SLACK: Final = 1.0 + 1e-6  # of rounding
_ROUNDS: Final = 12


class Limits(NamedTuple):
    """The most that a trajectory may ask for; infinite: anything. What is left for feedback is taken off already."""

    speed_m_s: float = math.inf
    acceleration_m_s2: float = math.inf  # horizontal
    jerk_m_s3: float = math.inf
    tilt_rad: float = math.radians(60.0)
    lift_lowest: float = 0.0  # specific force over g
    lift_highest: float = math.inf
    yaw_rate_rad_s: float = math.inf


class Excess(NamedTuple):
    """The worst of what is too much."""

    what: str
    value: float
    limit: float
    unit: str
    time_s: float
    place_ned_m: tuple[float, float, float]
    slower: float  # so much more time, and it would fit; infinite where no time helps

    def describe(self) -> str:
        """Where and by how much, and what would help."""
        north, east, down = self.place_ned_m
        where = f"at {self.time_s:.3g} s, {north:.3g} m north, {east:.3g} m east, {down:.3g} m down"
        over = f"{self.what} of {self.value:.3g} {self.unit}, {100.0 * (self.value / self.limit - 1.0):.2g} % above"
        help_ = f"; --stretch makes it {self.slower:.3g} times as long" if math.isfinite(self.slower) else ""
        return f"it asks for {over} the {self.limit:.3g} there are, {where}{help_}"


def samples(trajectory: Trajectory) -> Iterator[tuple[float, Reference]]:
    """Instants all along, so close that nothing of a trajectory that can be flown hides between them."""
    duration = trajectory.duration_s
    count = max(1, min(math.ceil(duration / _STEP_S), _MOST_SAMPLES))
    for k in range(count + 1):
        time_s = duration * k / count
        yield time_s, trajectory.at(time_s)


def excess(trajectory: Trajectory, limits: Limits) -> Excess | None:
    """What is most beyond the limits, by the time that it would take to be within them; None where nothing is."""
    worst: Excess | None = None
    before: tuple[float, float] | None = None
    for time_s, at in samples(trajectory):
        for what, value, limit, unit, slower in _asked(at, limits, before, time_s):
            if value > limit * _SLACK and (worst is None or slower > worst.slower):
                worst = Excess(what, value, limit, unit, time_s, (at.x_m, at.y_m, at.z_m), slower)
        before = time_s, at.yaw_rad
    return worst


def too_much(at: Reference, limits: Limits) -> str | None:
    """What one instant asks for beyond the limits; None where nothing is."""
    for what, value, limit, unit, _ in _asked(at, limits, None, 0.0):
        if not value <= limit * _SLACK:
            return f"{what} {value:.3g} {unit}, limit {limit:.3g}"
    return None


def _asked(
    at: Reference, limits: Limits, before: tuple[float, float] | None, time_s: float
) -> Iterator[tuple[str, float, float, str, float]]:
    """(what, value, limit, unit, how much slower it would have to be)."""
    speed, jerk = math.hypot(*at[3:6]), math.hypot(*at[9:12])
    across, up = math.hypot(at.ax_m_s2, at.ay_m_s2), GRAVITY_M_S2 - at.az_m_s2
    yield "speed", speed, limits.speed_m_s, "m/s", speed / limits.speed_m_s
    yield "acceleration", across, limits.acceleration_m_s2, "m/s2", math.sqrt(across / limits.acceleration_m_s2)
    yield "jerk", jerk, limits.jerk_m_s3, "m/s3", (jerk / limits.jerk_m_s3) ** (1.0 / 3.0)
    slope = math.tan(limits.tilt_rad)
    tilt = math.degrees(math.atan2(across, up))
    slower = math.sqrt(max((across / slope + at.az_m_s2) / GRAVITY_M_S2, 1.0))
    yield "tilt", tilt, math.degrees(limits.tilt_rad), "deg", slower
    lift = math.hypot(across, up) / GRAVITY_M_S2
    room = limits.lift_highest - 1.0
    yield "thrust over hover thrust", lift, limits.lift_highest, "1", math.sqrt(max((lift - 1.0) / room, 1.0))
    sinking, room = at.az_m_s2, GRAVITY_M_S2 * (1.0 - limits.lift_lowest)
    yield "acceleration downwards", sinking, room, "m/s2", math.sqrt(max(sinking / room, 0.0))
    if before is not None and time_s > before[0]:
        turned = math.atan2(math.sin(at.yaw_rad - before[1]), math.cos(at.yaw_rad - before[1]))
        rate = abs(turned) / (time_s - before[0])
        most = limits.yaw_rate_rad_s
        yield "yaw rate", math.degrees(rate), math.degrees(most), "deg/s", rate / most


def stretched(trajectory: Trajectory, limits: Limits) -> Trajectory:
    """The same, as much slower as it takes; itself where it fits. Raises `ValueError` where no time helps."""
    factor, flown = 1.0, trajectory
    for _ in range(_ROUNDS):
        found = excess(flown, limits)
        if found is None:
            return flown
        if not math.isfinite(found.slower):
            break
        factor *= max(found.slower, 1.001)
        flown = Stretched(trajectory, factor)
    raise ValueError("no slower flight fits: its heading turns on the spot, or a limit leaves nothing")


def farthest(
    trajectory: Trajectory, outside: Callable[[tuple[float, float, float]], str | None]
) -> tuple[float, str] | None:
    """(when, why) it first leaves a fence; None where it stays inside."""
    for time_s, at in samples(trajectory):
        why = outside((at.x_m, at.y_m, at.z_m))
        if why is not None:
            return time_s, why
    return None
