"""The vehicle's logs on its card, the one that is being written among them."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Final, NamedTuple, Protocol

_MESSAGE_BYTES: Final = 259
_GROWS_BYTES_S: Final = 20_000
_HEADER_BYTES: Final = 16


class Log(Protocol):
    """One log on the card."""

    @property
    def data(self) -> bytes:
        """What it holds now."""

    @property
    def time_utc_s(self) -> int:
        """When it was changed last; 0 where the vehicle never knew the time."""

    @property
    def seek_s(self) -> float:
        """How long the card takes to find it, each time that its logs are listed."""

    @property
    def told(self) -> bool:
        """Whether its entry comes, where the logs are listed; it is counted all the same."""


class LogFile(NamedTuple):
    """A log that is whole."""

    data: bytes
    time_utc_s: int  # of its last change; 0 where the vehicle never knew the time
    seek_s: float = 0.0
    told: bool = True


class GrowingLog:
    """The log that is being written. `now_us` is the vehicle's time, `epoch_us` the wall's where that is zero."""

    seek_s = 0.0
    told = True

    def __init__(self, now_us: Callable[[], int], epoch_us: int) -> None:
        self._now_us, self._epoch_us, self._began_us = now_us, epoch_us, now_us()
        self._data = bytearray(_header(self._began_us))

    @property
    def data(self) -> bytes:
        """As far as it has come."""
        size = _HEADER_BYTES + _GROWS_BYTES_S * (self._now_us() - self._began_us) // 1_000_000
        while len(self._data) < size:
            self._data += _message(len(self._data) // _MESSAGE_BYTES, 0, _MESSAGE_BYTES)
        return bytes(self._data[:size])

    @property
    def time_utc_s(self) -> int:
        """Now."""
        return (self._epoch_us + self._now_us()) // 1_000_000


def read_log(path: Path) -> LogFile:
    """A file of this machine as a log of the vehicle. Raises `OSError`."""
    return LogFile(path.read_bytes(), int(path.stat().st_mtime))


def synthetic_log(size_bytes: int, seed: int = 0, time_utc_s: int | None = None) -> LogFile:
    """A log of a given size with a ULog's header and framing; its bytes tell where they stand, so that a hole shows.

    Raises `ValueError` for a size that holds no header and message: below 19 bytes.
    """
    if size_bytes < 19:
        raise ValueError(f"a ULog has at least 19 bytes, not {size_bytes}")
    parts = [_header(seed * 1_000_000)]
    left = size_bytes - _HEADER_BYTES
    number = 0
    while left > 0:
        size = min(left, 259 if left >= 262 or left <= 259 else 256)  # never less than a message's head is left over
        parts.append(_message(number, seed, size))
        left -= size
        number += 1
    return LogFile(b"".join(parts), int(time.time()) if time_utc_s is None else time_utc_s)


def _header(time_us: int) -> bytes:
    return b"ULog\x01\x125\x01" + time_us.to_bytes(8, "little")


def _message(number: int, seed: int, size: int) -> bytes:
    body = (number * 2654435761 + seed & 0xFFFFFFFF).to_bytes(4, "little") * 64
    return (size - 3).to_bytes(2, "little") + b"S" + body[: size - 3]
