"""Whether the estimate has settled, before control begins: position and velocity agree, and no solution is missing."""

from __future__ import annotations

import math
from typing import Final

from companion.config.schema import Config
from companion.control.types import Odometry
from companion.flight.guards import propagation

PATIENCE_S: Final = 60.0
_UNKNOWN: Final = (0.0, 0.0, 0.0)  # what PX4 flies, its thrust at least, is not told


class Settling:
    """From the first sample on, out of control. An estimate that was never seen unsettled is believed at once."""

    def __init__(self, config: Config) -> None:
        guard = config.guards.estimate_settled_m
        self._limit_m = guard.limit if guard.enabled else math.inf
        self._timeout_s = guard.timeout_s
        self._state: propagation.Propagation | None = None
        self._unsettled_s = -math.inf  # when it was last seen so
        self._now_s = 0.0

    def restart(self) -> None:
        """The samples' clock, or the estimate itself, began anew: what was before says nothing."""
        self._state, self._unsettled_s = None, -math.inf

    def on_sample(self, sample: Odometry, missing_flags: float) -> None:
        """One sample; solutions missing of those that are needed, NaN where it is not told."""
        state = self._state or propagation.start(sample, _UNKNOWN)
        self._state, seen = propagation.step(state, sample, _UNKNOWN)
        self._now_s = sample.time_s
        if math.isfinite(self._limit_m) and (seen.drift_m > self._limit_m or missing_flags > 0.0):
            self._unsettled_s = sample.time_s

    @property
    def settled(self) -> bool:
        """Whether it has not been seen unsettled for the guard's timeout."""
        return self._now_s - self._unsettled_s >= self._timeout_s
