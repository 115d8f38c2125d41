"""A trajectory that a planner streams, a sample at a time: followed between its samples, braked where they end.

Ahead of the newest sample nothing is known, and to wait for the next would be to fly late by its period and its jitter:
0.16 m at 2 m/s and 20 Hz. So the newest is continued by its own velocity and acceleration, and by the jerk that the
last two or three tell. Where a new sample says something else than was flown, the difference in position, velocity and
acceleration is worked off by the polynomial of degree 5 that takes all three to zero: they stay continuous.

When a sample was meant to be is told by its time stamp. The planner's clock is set by the samples that come soonest,
so that jitter of the link does not move the trajectory (`Streamed.take`).
"""

from __future__ import annotations

import math
from enum import Enum
from typing import Final

from companion.control.types import PositionSetpoint, Reference
from companion.trajectory.course import braked
from companion.trajectory.feasibility import Limits
from companion.trajectory.polynomial import Piecewise, quintic
from companion.trajectory.sample import LEAST_S, Sample, asks_for_too_much, begins_elsewhere, jumps, turns_too_fast
from companion.trajectory.trajectory import moved

_BLEND_S: Final = 0.15  # over which a difference is worked off, at least
_SHARE: Final = 0.25  # of the limits, for working it off: the fifth that a trajectory leaves
_DRIFT: Final = 1e-3  # of the planner's clock against the vehicle's
_SNAP_S: Final = 0.5  # over which the jerk may go from zero to its limit: the snap is a second difference of samples
_SHORTEST_S: Final = 0.5  # of braking
_ROUNDS: Final = 10
_SLOWER: Final = 1.2
_PROBES: Final = 12
# Peaks of acceleration and jerk where degree 9 brakes from a velocity of one within a second, at constant heading.
_BRAKE: Final = (2.19, 7.6)
_NONE: Final = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)

Motion = tuple[float, float, float, float, float]
"""Of one axis: position, velocity, acceleration, jerk, snap."""


class Phase(Enum):
    """Where a stream is."""

    NONE = "no stream"
    FOLLOWED = "followed"
    ENDED = "ended"  # braking, and then at rest


class Streamed:
    """What is flown of a stream. Times are the vehicle's, s.

    Attributes: `phase`; `why` it ended, as one line.
    """

    def __init__(self, limits: Limits, *, timeout_s: float, late_s: float) -> None:
        self.phase = Phase.NONE
        self.why = ""
        self._limits = limits
        self._timeout_s, self._late_s = timeout_s, late_s
        self._newest: Sample | None = None
        self._resent = False  # it says what the one before it did
        self._heard_s = self._valid_s = self._blend_s = 0.0
        self._slopes: tuple[float, tuple[float, float, float]] | None = None  # over how long, and what
        self._motion: tuple[Motion, Motion, Motion] = ((0.0,) * 5,) * 3
        self._left: tuple[tuple[float, ...], ...] = (_NONE,) * 3
        self._left_s = 0.0
        self._yaw = (0.0, 0.0, 0.0, 0.0)  # heading, its rate, what is left to turn, over how long
        self._brake: Piecewise | None = None
        self._brake_s = 0.0

    def forget(self) -> None:
        """There is no stream any more."""
        self.phase, self._brake = Phase.NONE, None

    def take(self, sample: Sample, heard_s: float, flown: Reference, now_s: float) -> str | None:
        """Fly on by this sample, heard at `heard_s`; or why not. `flown` is what is flown at `now_s`, the last tick.

        A link delays a sample, and never brings it early: the planner's clock is the vehicle's less the smallest of
        what there was between a sample's time stamp and its arrival, give or take the drift of clocks.
        """
        before = self._newest
        repeats = before is not None and sample.repeats(before)
        if repeats and sample.speed_m_s > 0.0:  # which is not where it would be by now
            return None
        follows = self.phase is Phase.FOLLOWED and before is not None
        valid_s, passed_s = heard_s, 0.0
        if follows and before is not None:
            passed_s = sample.since_s(before)
            if passed_s < LEAST_S and (repeats or (self._resent and passed_s >= 0.0)):
                return None  # MAVSDK says the first one twice, and by its own timer what has just been replaced
            if passed_s <= 0.0:
                return "time_boot_ms is not later"
            if passed_s < LEAST_S:
                return f"{1e3 * passed_s:.0f} ms after the last, least {1e3 * LEAST_S:.0f}"
            if passed_s > self._timeout_s + self._late_s:
                return f"time_boot_ms jumps {passed_s:.3g} s"
            valid_s = min(heard_s, self._valid_s + (1.0 + _DRIFT) * passed_s)
        late_s = heard_s - valid_s
        if late_s > self._late_s:
            return f"{late_s:.3g} s late, limit {self._late_s:g}"
        refused = asks_for_too_much(sample, self._limits)
        if refused is None:
            refused = (
                jumps(sample, before, self._limits) or turns_too_fast(sample, before, self._limits)
                if follows and before is not None
                else begins_elsewhere(sample, flown)
            )
        if refused is not None:
            return refused
        self._motion = self._moves(sample, before if follows else None, passed_s)
        self._turn_to(sample, before if follows else None, passed_s, flown.yaw_rad)
        self.phase, self._brake = Phase.FOLLOWED, None
        self._resent = repeats
        self._newest, self._heard_s, self._valid_s = sample, heard_s, valid_s
        self._work_off(flown, now_s)
        return None

    def stop_ned_m(self, sample: Sample) -> tuple[float, float, float]:
        """Where the vehicle would come to rest, were this sample the last."""
        wait = self._timeout_s + 0.5 * self._shortest_brake_s(sample.speed_m_s)
        return sample.x_m + wait * sample.vx_m_s, sample.y_m + wait * sample.vy_m_s, sample.z_m + wait * sample.vz_m_s

    def at(self, time_s: float) -> Reference:
        """What to fly now. Ends the stream where nothing new has come for too long."""
        brake = self._brake
        if brake is not None:
            return brake.at(time_s - self._brake_s)
        if time_s - self._heard_s > self._timeout_s:
            return self.end(time_s, f"nothing new for {self._timeout_s:g} s")
        return self._followed(time_s)

    def end(self, now_s: float, why: str, by: PositionSetpoint | None = None) -> Reference:
        """Brake along the path, from now on; what is flown now. `by`: the estimate has moved by so much."""
        brake = self._brake
        begin = self._followed(now_s) if brake is None else brake.at(now_s - self._brake_s)
        if by is not None:
            begin = moved(begin, by)
        if self.phase is Phase.FOLLOWED:
            self.why = why
        self.phase, self._brake_s = Phase.ENDED, now_s
        self._brake = self._way_to_rest(begin)
        return self._brake.at(0.0)

    def _followed(self, time_s: float) -> Reference:
        """Arithmetic alone: this is every tick's."""
        t, w = time_s - self._valid_s, time_s - self._left_s
        (px, vx, ax, jx, sx), (py, vy, ay, jy, sy), (pz, vz, az, jz, sz) = self._motion
        h, third, quarter = 0.5 * t, t / 3.0, 0.25 * t
        x, y, z = (
            px + t * (vx + h * (ax + third * (jx + quarter * sx))),
            py + t * (vy + h * (ay + third * (jy + quarter * sy))),
            pz + t * (vz + h * (az + third * (jz + quarter * sz))),
        )
        vx += t * (ax + h * (jx + third * sx))
        vy += t * (ay + h * (jy + third * sy))
        vz += t * (az + h * (jz + third * sz))
        ax, ay, az = ax + t * (jx + h * sx), ay + t * (jy + h * sy), az + t * (jz + h * sz)
        jx, jy, jz = jx + t * sx, jy + t * sy, jz + t * sz
        if w < self._blend_s:
            (x0, x1, x2, x3, x4, x5), (y0, y1, y2, y3, y4, y5), (z0, z1, z2, z3, z4, z5) = self._left
            x += x0 + w * (x1 + w * (x2 + w * (x3 + w * (x4 + w * x5))))
            y += y0 + w * (y1 + w * (y2 + w * (y3 + w * (y4 + w * y5))))
            z += z0 + w * (z1 + w * (z2 + w * (z3 + w * (z4 + w * z5))))
            vx += x1 + w * (2.0 * x2 + w * (3.0 * x3 + w * (4.0 * x4 + w * 5.0 * x5)))
            vy += y1 + w * (2.0 * y2 + w * (3.0 * y3 + w * (4.0 * y4 + w * 5.0 * y5)))
            vz += z1 + w * (2.0 * z2 + w * (3.0 * z3 + w * (4.0 * z4 + w * 5.0 * z5)))
            ax += 2.0 * x2 + w * (6.0 * x3 + w * (12.0 * x4 + w * 20.0 * x5))
            ay += 2.0 * y2 + w * (6.0 * y3 + w * (12.0 * y4 + w * 20.0 * y5))
            az += 2.0 * z2 + w * (6.0 * z3 + w * (12.0 * z4 + w * 20.0 * z5))
        yaw, rate, left, over = self._yaw
        yaw += rate * t
        if w < over:
            yaw += left * (1.0 - w / over)
        return Reference(x, y, z, vx, vy, vz, ax, ay, az, jx, jy, jz, sx, sy, sz, yaw)

    def _moves(self, sample: Sample, before: Sample | None, passed_s: float) -> tuple[Motion, Motion, Motion]:
        """Of each axis, at the sample's time. What is not given is found from what the samples before have said."""
        given = sample.accelerates
        slope = slope_before = (0.0, 0.0, 0.0)
        between_s = 0.0
        if before is not None and given is before.accelerates:
            first = 7 if given else 4
            slope = tuple(
                (b - a) / passed_s for a, b in zip(before[first : first + 3], sample[first : first + 3], strict=True)
            )  # type: ignore[assignment]
            if self._slopes is not None:
                passed_before_s, slope_before = self._slopes
                between_s = 0.5 * (passed_s + passed_before_s)
            self._slopes = passed_s, slope
        else:
            self._slopes = None
        most = self._limits.jerk_m_s3
        axes = []
        for axis in range(3):
            position, velocity, acceleration = sample[1 + axis], sample[4 + axis], sample[7 + axis]
            change = (slope[axis] - slope_before[axis]) / between_s if between_s > 0.0 else 0.0
            now = slope[axis] + 0.5 * passed_s * change
            jerk, snap = (now, change) if given else (change, 0.0)
            if not given:
                acceleration = now
            most_snap = most / _SNAP_S
            axes.append((
                position, velocity, acceleration, min(max(jerk, -most), most), min(max(snap, -most_snap), most_snap)
            ))  # fmt: skip
        return axes[0], axes[1], axes[2]

    def _turn_to(self, sample: Sample, before: Sample | None, passed_s: float, flown_rad: float) -> None:
        """The heading: where none is given it stays."""
        if math.isnan(sample.yaw_rad):
            self._yaw = (flown_rad, 0.0, 0.0, 0.0)
            return
        rate = 0.0
        if before is not None and not math.isnan(before.yaw_rad):
            rate = math.remainder(sample.yaw_rad - before.yaw_rad, math.tau) / passed_s
        self._yaw = (sample.yaw_rad, rate, 0.0, 0.0)

    def _work_off(self, flown: Reference, now_s: float) -> None:
        """What is flown less what the sample wants, over as long as it takes within a share of the limits."""
        self._blend_s = 0.0
        wanted = self._followed(now_s)
        limits = self._limits
        away_m, faster = math.dist(flown[:3], wanted[:3]), math.dist(flown[3:6], wanted[3:6])
        acceleration, jerk = _SHARE * min(limits.acceleration_m_s2, 100.0), _SHARE * min(limits.jerk_m_s3, 1000.0)
        blend_s = max(  # peaks of acceleration and jerk of degree 5: 5.8 and 60 for a way of one in a second
            _BLEND_S,
            math.sqrt(6.0 * away_m / acceleration),
            (60.0 * away_m / jerk) ** (1.0 / 3.0),
            3.0 * faster / acceleration,
            math.sqrt(36.0 * faster / jerk),
        )
        self._left_s, self._blend_s = now_s, blend_s
        self._left = tuple(
            quintic(
                (flown[k] - wanted[k], flown[k + 3] - wanted[k + 3], flown[k + 6] - wanted[k + 6]), _NONE[:3], blend_s
            )
            for k in range(3)
        )
        yaw, rate, _, _ = self._yaw
        left = math.remainder(flown.yaw_rad - wanted.yaw_rad, math.tau)
        self._yaw = yaw, rate, left, max(blend_s, abs(left) / (_SHARE * limits.yaw_rate_rad_s))

    def _shortest_brake_s(self, speed_m_s: float) -> float:
        acceleration, jerk = _BRAKE
        return max(
            _SHORTEST_S,
            acceleration * speed_m_s / self._limits.acceleration_m_s2,
            math.sqrt(jerk * speed_m_s / self._limits.jerk_m_s3),
        )

    def _way_to_rest(self, begin: Reference) -> Piecewise:
        """The shortest of a few that keeps the limits; where none does, the one that breaks them least."""
        limits, duration_s = self._limits, self._shortest_brake_s(math.hypot(*begin[3:6]))
        best, least = None, math.inf
        for _ in range(_ROUNDS):
            way = braked(begin, duration_s)
            probes = [way.at(duration_s * k / _PROBES) for k in range(_PROBES + 1)]
            excess = max(
                max(math.hypot(*at[6:9]) for at in probes) / limits.acceleration_m_s2,
                max(math.hypot(*at[9:12]) for at in probes) / limits.jerk_m_s3,
            )
            if excess < least:
                best, least = way, excess
            if excess <= 1.0:
                break
            duration_s *= _SLOWER
        assert best is not None
        return best
