"""Time that passes only when it is told to: the companion's modules see it in place of `time`."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

_PACKAGES: Final = ("companion.flight.", "companion.mavlink.")


class VirtualTime:
    """Stands for the module `time`, as far as flights use it. Attribute: `now_s`."""

    def __init__(self) -> None:
        self.now_s = 1000.0

    def monotonic(self) -> float:
        return self.now_s

    perf_counter = monotonic

    def monotonic_ns(self) -> int:
        return round(self.now_s * 1e9)

    def time_ns(self) -> int:
        return 1_700_000_000_000_000_000 + self.monotonic_ns()

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
