"""Before stand-by: ask the vehicle for its odometry at the wanted rate, measure what comes, and judge it.

What the vehicle is, its firmware and gains, is read meanwhile.
"""

from __future__ import annotations

from typing import Final

from companion.config.schema import Config
from companion.flight.readiness.pinned import Pinned
from companion.flight.vehicle_link.odometry import PoseSource
from companion.flight.vehicle_link.requests import Request, Stream

_ASK_AGAIN_S: Final = 1.0
_FALL_BACK_S: Final = 1.5  # without any ODOMETRY
_PATIENCE_S: Final = 5.0


class Preflight:
    """The check of one connection.

    Attributes: `rate_hz` of the odometry as last measured; `pinned`, firmware and parameters of the vehicle. `compare`:
    whether those are set beside the config's; `uncertified`: whether to go on where they differ.
    """

    def __init__(self, config: Config, pose: PoseSource, *, compare: bool = True, uncertified: bool = False) -> None:
        self._tick = config.tick
        self._flying = config.vehicle_kind.can_fly
        self._pose = pose
        self._meter = RateMeter()
        self._began_s = 0.0
        self._ask_s = 0.0
        self._uncertified = uncertified
        self.pinned = Pinned(config, compare=compare)

    @property
    def rate_hz(self) -> float:
        """Rate of the odometry as last measured, Hz."""
        return self._meter.rate_hz

    @property
    def passed(self) -> bool:
        """Whether the odometry comes at `tick.floor_hz` or above, and nothing more is waited for."""
        return self._fast and self.pinned.over and (self.pinned.stale is None or self._uncertified)

    @property
    def _fast(self) -> bool:
        return self._meter.done and self._meter.rate_hz >= self._tick.floor_hz

    def begin(self, now_s: float) -> None:
        """The vehicle has been heard."""
        self._began_s = self._ask_s = now_s

    def restart(self) -> None:
        """The vehicle's clock began anew: what was measured means nothing."""
        self._meter = RateMeter()

    def on_sample(self, time_s: float) -> None:
        """The time stamp of an odometry sample."""
        self._meter.on_sample(time_s)

    def requests(self, now_s: float, *, heard: bool) -> list[Request]:
        """What to ask now. `heard`: whether any odometry has come."""
        if not heard and now_s - self._began_s > _FALL_BACK_S:
            self._pose.fall_back()
        asked = self.pinned.requests(now_s)
        if now_s < self._ask_s:
            return asked
        self._ask_s = now_s + _ASK_AGAIN_S
        return [*asked, Stream(self._tick.rate_hz, self._flying)]

    def refused(self) -> str | None:
        """Why the vehicle must not be flown with this certificate, as one line."""
        stale = self.pinned.stale
        if stale is None or self._uncertified:
            return None
        return f"{stale}: set them back, or identify and check again, or fly --uncertified"

    def failed(self, now_s: float) -> str | None:
        """Why the vehicle is refused, as one line, once patience has ended."""
        if self._fast or now_s - self._began_s <= _PATIENCE_S:
            return None
        return (
            f"{self._pose.message} arrives at {self.rate_hz:.1f} Hz, tick.floor_hz is {self._tick.floor_hz:g}: "
            "raise the link's rate or lower tick.rate_hz and check again"
        )


class RateMeter:
    """Rate of the samples heard, by their own time stamps, once the vehicle has had time to obey the request."""

    SETTLE_S = 0.3
    MEASURE_S = 0.5

    def __init__(self) -> None:
        self._first_s: float | None = None
        self._from_s = 0.0
        self._count = 0
        self.rate_hz = 0.0
        self.done = False

    def on_sample(self, time_s: float) -> None:
        """A sample's time. `rate_hz` and `done` follow; a window that ends too slow is followed by a new one."""
        if self._first_s is None:
            self._first_s = time_s
        if time_s - self._first_s < self.SETTLE_S:
            return
        if self._count == 0:
            self._from_s = time_s
        self._count += 1
        span = time_s - self._from_s
        if span >= self.MEASURE_S:
            self.rate_hz = (self._count - 1) / span
            self.done = True
            self._count = 0
