"""What the estimator's resets have done, and how much of that is borne within a minute."""

from __future__ import annotations

import math
from collections import deque
from typing import Final

from companion.control import attitude
from companion.control.types import Jump, Odometry

_TURNED_RAD: Final = math.radians(3.0)  # a smaller step of the heading may be the vehicle turning
_LEAST_M: Final = 0.1  # what a counted reset takes of the budget at least: a counter that runs blinds the reference

BUDGET_S: Final = 60.0  # for which steps are remembered


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


class Steps:
    """Steps of the position within the last minute, counted by the estimator or not: one budget for both.

    Small ones that come again and again move fence and origin with them where they are counted, and the vehicle where
    they are not.
    """

    def __init__(self) -> None:
        self._steps: deque[tuple[float, float]] = deque()
        self._total_m = 0.0

    def count(self, time_s: float, length_m: float) -> None:
        """A reset that the estimator counted; it takes 0.1 m at least."""
        self.add(time_s, max(length_m, _LEAST_M))

    def add(self, time_s: float, length_m: float) -> None:
        """A step that nobody counted."""
        self._steps.append((time_s, length_m))
        self._total_m += length_m

    def total_m(self, now_s: float) -> float:
        """How far those of the last minute went in all."""
        steps = self._steps
        while steps and steps[0][0] < now_s - BUDGET_S:
            self._total_m -= steps.popleft()[1]
        if not steps:
            self._total_m = 0.0
        return self._total_m
