"""What a flight process asks of the interpreter and tells the one who started it."""

from __future__ import annotations

import gc
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import NamedTuple

from companion.flight.authority import Reason, State


class Status(NamedTuple):
    """What a person watching wants to know, ten times a second."""

    state: State
    mode: int
    armed: bool
    elapsed_s: float  # in control
    rate_hz: float
    error_m: float  # horizontal distance from the ideal reference


class Summary(NamedTuple):
    """How a flight ended."""

    reason: Reason
    detail: str
    engaged: bool  # whether control ever began
    engaged_s: float
    ticks: int
    failsafe: bool = False  # whether a failsafe of the vehicle's own took control


@contextmanager
def quiet_memory() -> Iterator[None]:
    """No garbage collection in flight: the tick leaves no cycles behind."""
    gc.collect()
    gc.freeze()
    gc.disable()
    try:
        yield
    finally:
        gc.enable()
        gc.unfreeze()


@contextmanager
def stop_signals(stop: Callable[[], None]) -> Iterator[None]:
    """SIGINT, SIGTERM and SIGHUP ask for a release instead of ending the process."""
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = [signal.signal(number, lambda *_: stop()) for number in numbers]
    try:
        yield
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)
