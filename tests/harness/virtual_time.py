"""Time that passes only when it is told to: the companion's modules see it in place of `time`."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

_PACKAGES: Final = ("companion.flight.", "companion.mavlink.")


class VirtualTime:
    """Stands for the module `time`, as far as flights use it.

    Attributes: `now_s`; `slept_s`, for how long of it the computer slept, which CLOCK_MONOTONIC does not count.
    """

    CLOCK_MONOTONIC: Final = time.CLOCK_MONOTONIC
    CLOCK_BOOTTIME: Final = time.CLOCK_BOOTTIME

    def __init__(self) -> None:
        self.now_s = 1000.0
        self.slept_s = 0.0

    def monotonic(self) -> float:
        return self.now_s - self.slept_s

    def clock_gettime(self, clock: int) -> float:
        return self.now_s if clock == self.CLOCK_BOOTTIME else self.monotonic()

    perf_counter = monotonic

    def monotonic_ns(self) -> int:
        return round(self.monotonic() * 1e9)

    def time_ns(self) -> int:
        return 1_700_000_000_000_000_000 + round(self.now_s * 1e9)

    def time(self) -> float:
        return self.time_ns() * 1e-9

    def sleep(self, seconds: float) -> None:
        self.now_s += seconds


@contextmanager
def virtual_time(virtual: VirtualTime) -> Iterator[VirtualTime]:
    """For the modules of the flight process, and for no other: the log is written in real time."""
    modules = [
        module
        for name, module in sys.modules.items()
        if name.startswith(_PACKAGES) and getattr(module, "time", None) is time
    ]
    for module in modules:
        module.time = virtual  # type: ignore[attr-defined]
    try:
        yield virtual
    finally:
        for module in modules:
            module.time = time  # type: ignore[attr-defined]
