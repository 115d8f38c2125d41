"""The container of a tlog: every whole record of it, MAVLink 1 and 2, whatever stands between them.

A record is an 8-byte big-endian time in microseconds and one frame. Of the messages wanted only frames with a right
checksum count. After a damaged stretch reading goes on at the next frame whose checksum is right.

Source: pymavlink `mavutil.mavlogfile`; https://mavlink.io/en/guide/serialization.html
"""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt
from fastcrc.crc16 import mcrf4xx
from pymavlink.dialects.v20 import development as mavlink

from companion.identify.reading.ulog_file import Hole
from companion.mavlink.codec import INCOMPAT_SIGNED, SIGNATURE_BYTES, crc_extra

_TIME: Final = struct.Struct(">Q")
V1, V2 = 0xFE, 0xFD
_V1_BYTES, _V2_BYTES = 8, 12  # of a frame without payload
_NEWEST_US: Final = 1 << 55  # a time above this is none
_MOST_HOLES: Final = 10_000  # a file with more is not read on: each costs a search
_TWICE_US: Final = 100_000  # the same frame again within this was recorded twice: numbers recur after 256 frames


class Messages(NamedTuple):
    """All of one message, in the order recorded.

    Attributes
    ----------
    records
        Shape (n,): number of the record among those kept, by which `TlogFile.time_us` tells its time.
    system_id, component_id
        Shape (n,), of the sender.
    rows
        Shape (n,), structured by the message's fields.
    """

    records: npt.NDArray[np.int64]
    system_id: npt.NDArray[np.uint8]
    component_id: npt.NDArray[np.uint8]
    rows: npt.NDArray[Any]

    def only(self, keep: npt.NDArray[Any]) -> Messages:
        """A part of them."""
        return Messages(*(column[keep] for column in self))


class TlogFile(NamedTuple):
    """What is whole in a file.

    Attributes
    ----------
    messages
        By name, those asked for.
    time_us
        Shape (k,): when each record kept was recorded.
    versions
        How many frames there are of MAVLink 1 and of 2, by the byte they begin with.
    bad_checksums, twice
        Frames wanted that were left out: damaged, or recorded a second time.
    holes, end, size, tail
        As in `UlogFile`.
    """

    messages: dict[str, Messages]
    time_us: npt.NDArray[np.int64]
    versions: Counter[int]
    bad_checksums: int
    twice: int
    holes: list[Hole]
    end: int
    size: int
    tail: str


def looks_like(data: bytes) -> bool:
    """Whether a file begins as a tlog does."""
    return len(data) > _TIME.size and data[_TIME.size] in {V1, V2} and _TIME.unpack_from(data)[0] < _NEWEST_US


def read(data: bytes, wanted: Sequence[str]) -> TlogFile:
    """Read the messages wanted."""
    walk = _Walk(data, wanted)
    end, tail = walk.all()
    return TlogFile(
        walk.messages(), np.array(walk.time_us, np.int64), walk.versions, walk.bad_checksums, walk.twice, walk.holes,
        end, len(data), tail,
    )  # fmt: skip


class _Walk:
    def __init__(self, data: bytes, wanted: Sequence[str]) -> None:
        self._data = data
        self._types = {_BY_NAME[name].id: _dtype(_BY_NAME[name]) for name in wanted}
        self._found: dict[int, list[tuple[int, bytes]]] = {number: [] for number in self._types}
        self.time_us: list[int] = []
        self.versions: Counter[int] = Counter()
        self.bad_checksums = self.twice = 0
        self.holes: list[Hole] = []

    def all(self) -> tuple[int, str]:
        """Read the whole file; where what is whole ended, and what is behind."""
        at = before = 0
        total = len(self._data)
        while at < total:
            after = self._record(at)
            if after is None:
                again = self._resume(before + 1 if before else at + 1) if len(self.holes) < _MOST_HOLES else None
                if again is None:
                    return at, self._tail(at)
                self.holes.append(Hole(at, again))
                after = again
            before, at = at, after
        return at, ""

    def _record(self, at: int) -> int | None:
        """Take the record that begins here; where it ends, or None where none does."""
        frame = self._frame(at)
        if frame is None:
            return None
        self.versions[frame[0]] += 1
        number = _number(frame)
        if number in self._types:
            if _is_right(frame, number):
                self._found[number].append((len(self.time_us), frame))
                self.time_us.append(_TIME.unpack_from(self._data, at)[0])
            else:
                self.bad_checksums += 1
        return at + _TIME.size + len(frame)

    def _frame(self, at: int) -> bytes | None:
        data, head = self._data, at + _TIME.size
        if head + _V1_BYTES > len(data) or _TIME.unpack_from(data, at)[0] >= _NEWEST_US:
            return None
        if data[head] == V2:
            size = _V2_BYTES + data[head + 1] + (SIGNATURE_BYTES if data[head + 2] & INCOMPAT_SIGNED else 0)
        elif data[head] == V1:
            size = _V1_BYTES + data[head + 1]
        else:
            return None
        return data[head : head + size] if head + size <= len(data) else None

    def _resume(self, at: int) -> int | None:
        """Where the next record begins whose frame's checksum is right."""
        places = dict.fromkeys((bytes([V1]), bytes([V2])), -1)
        head = at + _TIME.size
        while True:
            for begin, place in places.items():
                if 0 <= place < head or place == -1:
                    places[begin] = self._data.find(begin, head)
                    if places[begin] < 0:
                        places[begin] = len(self._data)
            head = min(places.values())
            if head >= len(self._data):
                return None
            frame = self._frame(head - _TIME.size)
            if frame is not None and _is_right(frame, _number(frame)):
                return head - _TIME.size
            head += 1

    def _tail(self, at: int) -> str:
        if not any(self._data[at:]):
            return "zeros"
        head = at + _TIME.size
        return "cut" if head + _V1_BYTES > len(self._data) or self._data[head] in {V1, V2} else "damaged"

    def messages(self) -> dict[str, Messages]:
        """What was found by name, each frame once."""
        counting = self._counting()
        return {mavlink.mavlink_map[number].msgname: self._decoded(number, counting) for number in self._types}

    def _counting(self) -> set[bytes]:
        """Senders that number their frames: of them, the same frame again is the same one recorded twice."""
        numbers: dict[bytes, set[int]] = {}
        for found in self._found.values():
            for _, frame in found:
                numbers.setdefault(_sender(frame), set()).add(frame[2] if frame[0] == V1 else frame[4])
        return {sender for sender, seen in numbers.items() if len(seen) > 1}

    def _decoded(self, number: int, counting: set[bytes]) -> Messages:
        kept, last_us = [], dict[bytes, int]()
        for record, frame in self._found[number]:
            time_us = self.time_us[record]
            if _sender(frame) in counting and abs(time_us - last_us.get(frame, -_NEWEST_US)) < _TWICE_US:
                self.twice += 1
                continue
            last_us[frame] = time_us
            kept.append((record, frame))
        dtype = self._types[number]
        payloads = [_payload(frame).ljust(dtype.itemsize, b"\0")[: dtype.itemsize] for _, frame in kept]
        senders = np.frombuffer(b"".join(_sender(frame) for _, frame in kept), np.uint8).reshape(-1, 2)
        rows = np.frombuffer(b"".join(payloads), dtype)
        return Messages(np.array([record for record, _ in kept], np.int64), senders[:, 0], senders[:, 1], rows)


def _number(frame: bytes) -> int:
    return frame[5] if frame[0] == V1 else int.from_bytes(frame[7:10], "little")


def _sender(frame: bytes) -> bytes:
    """System and component id."""
    return frame[3:5] if frame[0] == V1 else frame[5:7]


def _payload(frame: bytes) -> bytes:
    return frame[6 : 6 + frame[1]] if frame[0] == V1 else frame[10 : 10 + frame[1]]


def _is_right(frame: bytes, number: int) -> bool:
    """Whether the checksum is right; a frame of an unknown message or format has none that could be."""
    if number not in mavlink.mavlink_map or (frame[0] == V2 and frame[2] & ~INCOMPAT_SIGNED):
        return False
    end = (6 if frame[0] == V1 else 10) + frame[1]
    return bool(mcrf4xx(frame[1:end] + crc_extra(number)) == frame[end] | frame[end + 1] << 8)


_BY_NAME: Final[dict[str, Any]] = {message.msgname: message for message in mavlink.mavlink_map.values()}


def _dtype(message: Any) -> np.dtype[Any]:
    """The layout of a message on the wire, from pymavlink's tables."""
    formats = bytes(message.native_format).decode()[1:]
    kinds: list[Any] = []
    for field, kind, count in zip(message.ordered_fieldnames, formats, message.array_lengths, strict=True):
        if kind == "c":
            kinds.append((field, f"S{max(count, 1)}"))
        else:
            kinds.append((field, f"<{kind}", (count,)) if count else (field, f"<{kind}"))
    return np.dtype(kinds)
