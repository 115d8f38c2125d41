"""The time of a flight: our own clock, or in lockstep the samples' own."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Final, Protocol

# It goes on while the computer sleeps, as the vehicle does; Linux's CLOCK_MONOTONIC stands still.
_RUNNING: Final = getattr(time, "CLOCK_BOOTTIME", time.CLOCK_MONOTONIC)
LARGEST_STEP_S: Final = 1.0  # between two samples of one clock, where no guard says otherwise


class Wall(Protocol):
    """The clock on the wall, as the module `time` has it."""

    def monotonic(self) -> float: ...

    def time_ns(self) -> int: ...


class Clock:
    """Tells the time and is told what came. In lockstep nothing here depends on the wall's clock.

    Attributes: `now_s`, when the bytes in hand came, or in lockstep the time stamp of the newest sample; `stamp_us`,
    the same for records; `passed_s`, in lockstep, how much of the samples' time has passed, wherever their clock jumps;
    `wall_s()`, seconds on the wall; `began_wall_s`, when the flight began.
    """

    def __init__(self, *, lockstep: bool = False, wall: Wall | None = None) -> None:
        self.lockstep = lockstep
        self.wall_s: Callable[[], float] = wall.monotonic if wall else partial(time.clock_gettime, _RUNNING)
        self._epoch_ns = wall.time_ns if wall else time.time_ns
        self.began_wall_s = self.wall_s()
        self.now_s = 0.0 if lockstep else self.began_wall_s
        self.stamp_us = 0
        self.passed_s = 0.0
        self._last_s = 0.0  # time stamp of the last sample, of whatever kind

    def waited(self, wall_s: float) -> None:
        """The wait for bytes has ended, with some or without."""
        if not self.lockstep:
            self.now_s = wall_s

    def stamp(self) -> None:
        """Bytes have come: what follows from them is stamped with this moment."""
        self.stamp_us = self.time_us()

    def pass_time(self, sample_s: float, *, running: bool) -> None:
        """In lockstep, a sample has come. Time passes up to it, once it is `running`: since the first was answered."""
        if running:
            self.passed_s += min(max(sample_s - self._last_s, 0.0), LARGEST_STEP_S)
        self._last_s = sample_s

    def move_to(self, sample_s: float) -> None:
        """In lockstep, now is the time of this sample."""
        self.now_s = sample_s
        self.stamp()

    def elapsed_s(self) -> float:
        """Now, for waiting: it never jumps."""
        return self.passed_s if self.lockstep else self.wall_s()

    def time_us(self) -> int:
        """Time stamp for a record made now: the system's clock, or in lockstep the samples' own."""
        return round(self.now_s * 1e6) if self.lockstep else self._epoch_ns() // 1000
