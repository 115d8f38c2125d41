"""What a flight process asks of the interpreter and tells the one who started it."""

from __future__ import annotations

import contextlib
import ctypes
import gc
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final, NamedTuple

from companion.flight.authority.states import Reason, State

_LARGE_PAGE: Final = Path("/sys/kernel/mm/transparent_hugepage/hpage_pmd_size")
_MADV_COLLAPSE: Final = 25


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


def _large_pages() -> None:
    """Put the heap on large pages, where the kernel can (Linux 6.1); a tenth of a tick's time.

    A tick that comes after milliseconds of sleep finds no address translation cached, and what it touches lies on
    hundreds of small pages.
    """
    madvise = ctypes.CDLL(None).madvise
    madvise.argtypes = (ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int)
    with contextlib.suppress(OSError, ValueError):
        size = int(_LARGE_PAGE.read_text())
        for line in Path("/proc/self/maps").read_text().splitlines():
            addresses, permissions, _, _, _, *name = line.split(maxsplit=5)
            if permissions == "rw-p" and name in ([], ["[heap]"]):
                begin, end = (int(address, 16) for address in addresses.split("-"))
                for page in range(-(-begin // size) * size, end - size + 1, size):
                    madvise(page, size, _MADV_COLLAPSE)  # untouched memory stays so; a refusal does no harm


@contextmanager
def quiet_memory() -> Iterator[None]:
    """No garbage collection in flight: the tick leaves no cycles behind. And few pages.

    A program that has frozen its memory itself, because it flies one flight after another, keeps it so.
    """
    frozen = gc.get_freeze_count() > 0
    if not frozen:
        gc.collect()
        gc.freeze()
        _large_pages()
    gc.disable()
    try:
        yield
    finally:
        gc.enable()
        if not frozen:
            gc.unfreeze()


@contextmanager
def stop_signals(stop: Callable[[], None]) -> Iterator[None]:
    """SIGINT, SIGTERM and SIGHUP ask for a release instead of ending the process.

    Signals are the main thread's: a flight in another one is stopped by whoever runs it.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = [signal.signal(number, lambda *_: stop()) for number in numbers]
    try:
        yield
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)
