"""One sample of a planner that streams, and why it is not flown. Local NED, SI units.

What a sample may differ from the one before is what the limits let a vehicle do in between: velocity explains the way
(trapezoidal rule, wrong by ``a''' dt^3/12`` at most, so by jerk), acceleration the change of velocity, jerk that of
acceleration. The slack is for single precision and for time stamps in whole milliseconds.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from companion.control.types import GRAVITY_M_S2, Reference
from companion.trajectory.feasibility import Limits, too_much

LEAST_S: Final = 0.01  # between two samples: 50 Hz, with jitter
BEGINS_M: Final = 0.5  # the first sample of a stream may be so far from what is flown
BEGINS_M_S: Final = 0.5
_SLACK_M: Final = 0.02
_SLACK_M_S: Final = 0.05
_SLACK_M_S2: Final = 0.2
_STAMP_S: Final = 0.002


class Sample(NamedTuple):
    """What a planner wants at one instant of its own clock; NaN: not given."""

    stamp_ms: int  # 32 bits, as time_boot_ms
    x_m: float
    y_m: float
    z_m: float
    vx_m_s: float
    vy_m_s: float
    vz_m_s: float
    ax_m_s2: float  # all three, or none
    ay_m_s2: float
    az_m_s2: float
    yaw_rad: float

    @property
    def accelerates(self) -> bool:
        """Whether it says how."""
        return not math.isnan(self.ax_m_s2)

    @property
    def speed_m_s(self) -> float:
        """How fast it moves."""
        return math.sqrt(self.vx_m_s * self.vx_m_s + self.vy_m_s * self.vy_m_s + self.vz_m_s * self.vz_m_s)

    def since_s(self, before: Sample) -> float:
        """How much later it is than another, by the planner's clock, which wraps around after 49 days."""
        return 1e-3 * (((self.stamp_ms - before.stamp_ms + (1 << 31)) & 0xFFFFFFFF) - (1 << 31))

    def repeats(self, before: Sample) -> bool:
        """Whether it says what was said before: a client that sends again what it has."""
        same = self[1:7] == before[1:7]
        return same and (self[7:10] == before[7:10] or not (self.accelerates or before.accelerates))


def asks_for_too_much(sample: Sample, limits: Limits) -> str | None:
    """What is beyond the limits; None where nothing is."""
    ax, ay, az = sample[7:10] if sample.accelerates else (0.0, 0.0, 0.0)
    return too_much(Reference(*sample[1:7], ax, ay, az, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), limits)


def begins_elsewhere(sample: Sample, flown: Reference) -> str | None:
    """Why a first sample is no way on from what is flown; None where it is."""
    away_m, faster_m_s = math.dist(sample[1:4], flown[:3]), math.dist(sample[4:7], flown[3:6])
    if not away_m <= BEGINS_M:
        return f"begins {away_m:.3g} m away, most {BEGINS_M:g}"
    if not faster_m_s <= BEGINS_M_S:
        return f"begins {faster_m_s:.3g} m/s off, most {BEGINS_M_S:g}"
    return None


def jumps(sample: Sample, before: Sample, limits: Limits) -> str | None:
    """Why a sample is no way on from the one before, which is `LEAST_S` older or more; None where it is."""
    dt, jerk = sample.since_s(before), limits.jerk_m_s3
    speed = max(sample.speed_m_s, before.speed_m_s)
    half = 0.5 * dt
    left_m = math.dist(
        sample[1:4],
        [p + half * (v + w) for p, v, w in zip(before[1:4], before[4:7], sample[4:7], strict=True)],
    )
    if not left_m <= _SLACK_M + _STAMP_S * speed + jerk * dt**3 / 6.0:
        return f"position jumps {left_m:.3g} m"
    if sample.accelerates and before.accelerates:
        mean = [0.5 * (a + b) for a, b in zip(sample[7:10], before[7:10], strict=True)]
        left_m_s = math.dist(sample[4:7], [v + dt * a for v, a in zip(before[4:7], mean, strict=True)])
        if not left_m_s <= _SLACK_M_S + _STAMP_S * math.hypot(*mean) + 0.5 * jerk * dt * dt:
            return f"velocity jumps {left_m_s:.3g} m/s"
        left_m_s2 = math.dist(sample[7:10], before[7:10])
        if not left_m_s2 <= _SLACK_M_S2 + 1.5 * jerk * dt:
            return f"acceleration jumps {left_m_s2:.3g} m/s2"
        return None
    left_m_s, up = math.dist(sample[4:6], before[4:6]), abs(sample.vz_m_s - before.vz_m_s)
    lift_m_s2 = GRAVITY_M_S2 * max(1.0 - limits.lift_lowest, limits.lift_highest - 1.0)
    if not up <= _SLACK_M_S + lift_m_s2 * (dt + _STAMP_S):
        return f"velocity jumps {up:.3g} m/s"
    if not left_m_s <= _SLACK_M_S + limits.acceleration_m_s2 * (dt + _STAMP_S):
        return f"velocity jumps {left_m_s:.3g} m/s"
    return None


def turns_too_fast(sample: Sample, before: Sample, limits: Limits) -> str | None:
    """Whether the heading moves faster than it may, why; None where it does not, or none is given."""
    turned = abs(math.remainder(sample.yaw_rad - before.yaw_rad, math.tau))
    if turned > limits.yaw_rate_rad_s * (sample.since_s(before) + _STAMP_S):
        return f"yaw jumps {math.degrees(turned):.3g} deg"
    return None
