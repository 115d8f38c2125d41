"""When PX4 v1.17 sends ODOMETRY and CURRENT_MODE, as seen on one with SIH: not as often and not as evenly as asked.

ODOMETRY is a sample of EKF2, which there are every 8 ms, sent up to 5 ms later: asked for 50 Hz its stamps are 16 and
24 ms apart, and there are no more than 125 a second. CURRENT_MODE comes twice a second, and at once when it changes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from random import Random
from typing import Any, Final

SAMPLE_US: Final = 8_000
LONGEST_DELAY_US: Final = 5_100  # uniform from zero: 2.5 ms median, 4.9 ms at 95 %
MODE_INTERVAL_US: Final = 500_000
MODE_LOOK_US: Final = 20_000  # how often a link looks for a change


class SampledOdometry:
    """ODOMETRY of one link. Attribute: `due_us`, when `step` is to be called next.

    Args: `sample` reads the estimate now; `build` makes a frame of a sequence number and what was read; one
    was asked for every `interval_us`, from `now_us` on.
    """

    def __init__(
        self, sample: Callable[[], Any], build: Callable[[int, Any], bytes], interval_us: int, now_us: int
    ) -> None:
        self._sample, self._build = sample, build
        self._random = Random("ODOMETRY's delay")  # the same on every link and in every flight
        self.interval_us = interval_us
        self._wanted_us = self.sent_us = now_us
        self._stamp_us = now_us - 1
        self._read: Any = None
        self.due_us = 0
        self._want_next()

    def step(self, now_us: int, next_sequence: Callable[[], int]) -> bytes | None:
        """Read the estimate, or send what was read; the frame, if one is sent."""
        if self._read is None:
            self._read, self._stamp_us = self._sample(), now_us
            self.due_us = now_us + self._random.randrange(LONGEST_DELAY_US)
            return None
        frame, self._read = self._build(next_sequence(), self._read), None
        self.sent_us = now_us
        self._want_next()
        return frame

    def upcoming(self, until_us: int) -> Iterator[tuple[int, bool, bool]]:
        """When it is due from now on, whether it is read then, and whether it is sent; nothing is any more."""
        self._sample, self._build = tuple, lambda *_: b""
        while self.due_us < until_us:
            due_us = self.due_us
            sent = self.step(due_us, int) is not None
            yield due_us, not sent, sent

    def _want_next(self) -> None:
        """The newest sample at the time that was asked for, or else the next one."""
        self._wanted_us += self.interval_us
        newest_us = self._wanted_us // SAMPLE_US * SAMPLE_US
        if newest_us <= self._stamp_us:
            newest_us = self._wanted_us = (self._stamp_us // SAMPLE_US + 1) * SAMPLE_US
        self.due_us = newest_us


class ModeReports:
    """Whether CURRENT_MODE is due on one link: it has changed, or was told half a second ago."""

    def __init__(self, mode: Callable[[], object], now_us: int) -> None:
        self._mode = mode
        self._told = mode()
        self._told_us = now_us

    def due(self, now_us: int) -> bool:
        """Look; once it is due it counts as told."""
        mode = self._mode()
        if mode == self._told and now_us - self._told_us < MODE_INTERVAL_US:
            return False
        self._told, self._told_us = mode, now_us
        return True
