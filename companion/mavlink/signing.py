"""MAVLink 2 message signing: who holds the key is heard, and nothing is heard twice.

A signed frame ends with a link id, a 48-bit time stamp and 48 bits of SHA-256 over key and frame. Stamps only ever grow
within a stream (system, component, link id), so a recorded frame is refused when it is played back.

Source: https://mavlink.io/en/guide/message_signing.html; the same decisions as pymavlink and the C library.
"""

from __future__ import annotations

import hashlib
import os
import re
import stat
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

from fastcrc.crc16 import mcrf4xx

from companion.config import ConfigError
from companion.mavlink.codec import CRC_BYTES, INCOMPAT_SIGNED, Frame, crc_extra

KEY_BYTES: Final = 32
UNSIGNED: Final = frozenset({109})  # RADIO_STATUS: the radio that reports on itself has no key
MINUTE: Final = 6_000_000  # time stamps count ten microseconds
Stream = tuple[int, int, int]  # system, component, link id

_LAST_STAMP: Final = 2**48 - 1
_EPOCH_S: Final = 1_420_070_400  # 2015-01-01, when they began
_SIGNED = bytes([INCOMPAT_SIGNED])
_HEX = re.compile(rb"\s*([0-9A-Fa-f]{64})\s*")


def read_key(path: Path) -> bytes:
    """A key file: 32 bytes, or 64 hexadecimal digits. Raises `ConfigError` with one line.

    A key that every user of the machine may read is refused, as ssh does; one that a group may read is not, since that
    is how a service is given a key.
    """
    try:
        with path.open("rb") as stream:
            mode = stat.S_IMODE(os.fstat(stream.fileno()).st_mode)
            data = stream.read(256)
    except OSError as error:
        raise ConfigError(f"link.signing_key_file {path}: {error.strerror}") from None
    if mode & (stat.S_IROTH | stat.S_IWOTH):
        raise ConfigError(f"link.signing_key_file {path}: anybody may read or write it: chmod 600 {path}")
    digits = _HEX.fullmatch(data)
    key = bytes.fromhex(digits[1].decode()) if digits else data
    if len(key) != KEY_BYTES:
        raise ConfigError(f"link.signing_key_file {path}: not a key (32 bytes, or 64 hexadecimal digits)")
    if not any(key):
        raise ConfigError(f"link.signing_key_file {path}: a key of zeros turns signing off: make a random one")
    return key


def system_clock() -> Callable[[], int]:
    """Time stamps that begin at the wall clock's time of now and then run on evenly, whatever is done to that clock."""
    began_ns = time.time_ns() - _EPOCH_S * 1_000_000_000 - time.monotonic_ns()
    return lambda: (began_ns + time.monotonic_ns()) // 10_000


class Signing:
    """Signs and verifies with one key.

    `clock` gives the time in time stamps of the protocol; a constant will do where bytes must not depend on the day.
    Attributes: `unsigned` frames without a signature, `bad_signature` with a wrong one, `replayed` not newer than what
    their stream has already said, or a new stream more than a minute old: all refused.
    """

    def __init__(self, key: bytes, *, link_id: int = 0, clock: Callable[[], int] | None = None) -> None:
        self.unsigned = 0
        self.bad_signature = 0
        self.replayed = 0
        self._keyed = hashlib.sha256(key)
        self._link = bytes([link_id])
        self._clock = system_clock() if clock is None else clock
        self._stamp = 0
        self._streams: dict[Stream, int] = {}

    def sign(self, frame: bytes) -> bytes:
        """An unsigned MAVLink 2 frame, signed. Raises `KeyError` for a message that the dialect does not know."""
        body = frame[1:2] + _SIGNED + frame[3:-CRC_BYTES]
        crc = mcrf4xx(body + crc_extra(int.from_bytes(frame[7:10], "little")))
        return self.seal(frame[:1] + body + crc.to_bytes(2, "little"))

    def seal(self, frame: bytes) -> bytes:
        """A frame whose header says that it is signed, with its signature."""
        self._stamp = stamp = min(max(self._stamp + 1, self._clock()), _LAST_STAMP)
        frame += self._link + stamp.to_bytes(6, "little")
        digest = self._keyed.copy()
        digest.update(frame)
        return frame + digest.digest()[:6]

    def verify(self, frame: Frame) -> bool:
        """Whether to believe a frame; one that is not believed is counted."""
        raw = frame.raw
        if not raw[2] & INCOMPAT_SIGNED:
            if frame.message_id in UNSIGNED:
                return True
            self.unsigned += 1
            return False
        stamp = int.from_bytes(raw[-12:-6], "little")
        stream = (frame.system_id, frame.component_id, raw[-13])
        last = self._streams.get(stream)
        if stamp <= last if last is not None else self._stale(stream, stamp):
            self.replayed += 1
            return False
        digest = self._keyed.copy()
        digest.update(raw[:-6])
        if digest.digest()[:6] != raw[-6:]:
            self.bad_signature += 1
            return False
        if last is None:
            if not self._begins(stream, stamp, frame):
                return False
            self._remember(stream, stamp)
        else:
            self._streams[stream] = stamp
        self._stamp = max(self._stamp, stamp)  # a vehicle that knows the time better than we do
        return True

    @property
    def refused(self) -> int:
        """Frames that were not believed."""
        return self.unsigned + self.bad_signature + self.replayed

    def _stale(self, stream: Stream, stamp: int) -> bool:  # noqa: ARG002
        """Whether a stream that has not been heard yet may not begin with so old a stamp."""
        return stamp + MINUTE < max(self._stamp, self._clock())

    def _begins(self, stream: Stream, stamp: int, frame: Frame) -> bool:  # noqa: ARG002
        """Whether a stream may begin with a frame whose signature is right."""
        return True

    def _remember(self, stream: Stream, stamp: int) -> None:
        """A stream has begun."""
        self._streams[stream] = stamp
