"""Whether the estimator's position and velocity agree, and what its resets have done.

PX4 counts most of its resets (ODOMETRY.reset_counter), but not a position that slides while it converges on a new
source: 5 m in 0.6 s in a recording. Only position against integrated velocity shows that.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Final, NamedTuple

from companion.control import attitude
from companion.control.types import Jump, Odometry

_TURNED_RAD: Final = math.radians(3.0)  # a smaller step of the heading may be the vehicle turning
_LEAK_S: Final = 0.5
_STILL: Final = (0.0, 0.0, 0.0)

RESETS_S: Final = 60.0  # for which counted resets are remembered


def jump(before: Odometry, after: Odometry) -> Jump:
    """What a counted reset between two samples has done: the new estimate minus what the old one foretold."""
    t0, x0, y0, z0, vx0, vy0, vz0, *q0 = before
    t1, x1, y1, z1, vx1, vy1, vz1, *q1 = after
    dt = t1 - t0
    turned = math.remainder(attitude.yaw(*q1) - attitude.yaw(*q0), math.tau)
    return Jump(
        x1 - x0 - vx0 * dt,
        y1 - y0 - vy0 * dt,
        z1 - z0 - vz0 * dt,
        vx1 - vx0,
        vy1 - vy0,
        vz1 - vz0,
        turned if abs(turned) > _TURNED_RAD else 0.0,
    )


def length_m(step: Jump) -> float:
    """How far the position jumped."""
    return math.hypot(step.x_m, step.y_m, step.z_m)


class Resets:
    """Counted resets of the last minute: small ones that come again and again move fence and origin with them."""

    def __init__(self) -> None:
        self._jumps: deque[tuple[float, float]] = deque()

    def add(self, time_s: float, step_m: float) -> float:
        """One more reset, so long; how far those of the last minute went in all, m."""
        jumps = self._jumps
        jumps.append((time_s, step_m))
        while jumps[0][0] < time_s - RESETS_S:
            jumps.popleft()
        return sum(length for _, length in jumps)


class Consistency(NamedTuple):
    """Leaky integral of position's increments minus velocity's, m."""

    last: Odometry
    drift_ned_m: tuple[float, float, float] = _STILL


def consistency(state: Consistency, sample: Odometry, counted: Jump | None = None) -> tuple[Consistency, float]:
    """(next state, how far position has slid against velocity, m).

    The leak of half a second makes of a steady disagreement of v metres a second a drift of v/2 metres: 0.1 m of the
    0.2 m/s that estimators differ by in steady flight, 0.45 m in the worst descent recorded, 4 m in a slide of 8 m/s.
    `counted`: the jump that a reset between the two samples was found to have made.
    """
    (t0, x0, y0, z0, vx0, vy0, vz0, *_), (drift_x, drift_y, drift_z) = state
    t1, x1, y1, z1, vx1, vy1, vz1, *_ = sample
    dt = t1 - t0
    if counted is not None:
        x0, y0, z0, vx0, vy0, vz0 = (  # as if the old sample had been in the new coordinates
            x0 + counted.x_m, y0 + counted.y_m, z0 + counted.z_m,
            vx0 + counted.vx_m_s, vy0 + counted.vy_m_s, vz0 + counted.vz_m_s,
        )  # fmt: skip
        # The jump was measured against the old velocity; the mean with the new one is used below.
    keep = 1.0 / (1.0 + dt / _LEAK_S)
    drift_x = keep * (drift_x + x1 - x0 - 0.5 * (vx0 + vx1) * dt)
    drift_y = keep * (drift_y + y1 - y0 - 0.5 * (vy0 + vy1) * dt)
    drift_z = keep * (drift_z + z1 - z0 - 0.5 * (vz0 + vz1) * dt)
    return (
        Consistency(sample, (drift_x, drift_y, drift_z)),
        math.sqrt(drift_x * drift_x + drift_y * drift_y + drift_z * drift_z),
    )
