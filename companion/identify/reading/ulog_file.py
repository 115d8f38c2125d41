"""The container of a ULog: every whole message of it, whatever stands between them.

A log that was cut, that ends in zeros, that has data appended or a damaged stretch is read to the end of what is whole.
After a damaged stretch reading goes on where messages of known topics, of the size their definition says, follow one
another again. Nothing here can run for longer than the file is long.

Source: https://docs.px4.io/main/en/dev_log/ulog_file_format
"""

from __future__ import annotations

import struct
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from companion.identify.reading.ulog_definitions import Definitions, Parameter
from companion.mavlink.logs.ulog import HEADER_BYTES, KINDS, MAGIC

_MESSAGE: Final = struct.Struct("<HB")
_DATA: Final = struct.Struct("<HBH")
_D, _B = b"DB"
_LARGEST_TEXT: Final = 4096  # of one that is no data, where reading goes on after damage
_CHAIN: Final = 4  # messages in a row that show that reading is in step again
_MOST_HOLES: Final = 10_000  # a file with more is not read on: each costs a search
Array = npt.NDArray[Any]


class UlogError(ValueError):
    """A file of which nothing can be read; the message is the reason in a few words."""


class Hole(NamedTuple):
    """Bytes that are no messages, from `start` to `stop`."""

    start: int
    stop: int


class Topic:
    """The samples of one topic, first instance: `places` are their bytes in the file, in the order written."""

    def __init__(self, rows: Array, places: Array) -> None:
        self._rows = rows
        self.places = places

    def __len__(self) -> int:
        return len(self._rows)

    def __contains__(self, field: str) -> bool:
        return field in (self._rows.dtype.names or ())

    def __getitem__(self, field: str) -> Array:
        """Shape (n,), or (n, k) for an array."""
        return np.asarray(self._rows[field])


class UlogFile(NamedTuple):
    """What is whole in a file.

    Attributes
    ----------
    topics
        Those asked for that have samples.
    parameters
        In the order written: those at the start, then every change.
    information
        Raw values by key, the key's type left out.
    holes
        Damaged stretches.
    end, size
        Where what is whole ends, and the file.
    tail
        What is behind `end`: "cut" for a message that is not finished, "zeros", "damaged", or nothing.
    """

    topics: dict[str, Topic]
    parameters: list[Parameter]
    information: dict[str, bytes]
    holes: list[Hole]
    end: int
    size: int
    tail: str


def read(data: bytes, wanted: frozenset[str]) -> UlogFile:
    """Read the topics wanted. Raises `UlogError`."""
    if len(data) < HEADER_BYTES or not data.startswith(MAGIC):
        raise UlogError("it does not begin as a ULog does")
    walk = _Walk(data, wanted)
    appended = _appended(data)
    at, tail = HEADER_BYTES, ""
    for stop in [*appended, len(data)]:
        at, tail = walk.part(at, stop)
        if stop in appended:  # what stands before appended data may end anywhere
            at = stop
    return UlogFile(walk.topics(), walk.known.parameters, walk.known.information, walk.holes, at, len(data), tail)


def _appended(data: bytes) -> list[int]:
    """Where data was appended. Raises `UlogError` for a format that this reader does not know."""
    size, kind = _MESSAGE.unpack_from(data.ljust(HEADER_BYTES + 3, b"\0"), HEADER_BYTES)
    body = data[HEADER_BYTES + 3 : HEADER_BYTES + 3 + size]
    if kind != _B or len(body) < 40:
        return []
    if body[8] & ~1 or any(body[9:16]):
        raise UlogError("its flags say that it is of a newer format than is known here")
    offsets = sorted(set(struct.unpack_from("<3Q", body, 16))) if body[8] & 1 else []
    return [offset for offset in offsets if HEADER_BYTES < offset < len(data)]


class _Walk:
    def __init__(self, data: bytes, wanted: frozenset[str]) -> None:
        self._data, self._bytes = data, np.frombuffer(data, np.uint8)
        self.known = Definitions(wanted)
        self.holes: list[Hole] = []

    def part(self, at: int, stop: int) -> tuple[int, str]:
        """Read from one byte to another; where it ended and what is behind."""
        data, sizes, places = self._data, self.known.sizes, self.known.places
        unpack, last = _DATA.unpack_from, min(stop, len(data) - 2) - 3
        before = -1
        while at <= last:
            size, kind, number = unpack(data, at)
            after = at + 3 + size
            if kind == _D and after <= stop and (size == sizes.get(number) or self._is_padded(number, size)):
                if number in places:
                    places[number].append(at)
            elif kind == _D and after <= stop and self._in_step(after, stop):
                if number in sizes:  # not of the size that its definition says; the next message is where it says
                    self.holes.append(Hole(at, after))
            elif kind != _D and kind in KINDS and size and after <= stop:
                self.known.take(kind, at, data[at + 3 : after])
            else:
                again = self._resume(at + 1, stop) if len(self.holes) < _MOST_HOLES else None
                if again is None:
                    return at, self._tail(at, stop, before)
                self._distrust(before)
                self.holes.append(Hole(at, again))
                after = again
            before, at = at, after
        return at, "" if at == stop else self._tail(at, stop, before)

    def _is_padded(self, number: int, size: int) -> bool:
        return number in self.known.sizes and self.known.sizes[number] < size <= self.known.largest[number]

    def _tail(self, at: int, stop: int, before: int) -> str:
        if not any(self._data[at:stop]):
            self._distrust(before)
            return "zeros"
        if stop - at < 3 or (self._data[at + 2] in KINDS and at + 3 + self._size_at(at) > stop):
            return "cut"
        self._distrust(before)
        return "damaged"

    def _size_at(self, at: int) -> int:
        return self._data[at] | self._data[at + 1] << 8

    def _distrust(self, place: int) -> None:
        """Forget the sample in front of damage: its last bytes may be damaged too."""
        for places in self.known.places.values():
            if places and places[-1] == place:
                places.pop()

    def _resume(self, at: int, stop: int) -> int | None:
        """The next place from which messages follow one another."""
        known = np.zeros(65536, np.int64)
        for topic, whole in self.known.sizes.items():
            known[topic] = whole
        kinds = np.zeros(256, bool)
        kinds[list(KINDS)] = True
        width = 1024
        while at + 5 <= stop:
            end = min(at + width, stop - 4)
            piece = self._bytes[at : end + 4].astype(np.int64)
            size, kind, number = piece[:-4] + 256 * piece[1:-3], piece[2:-2], piece[3:-1] + 256 * piece[4:]
            data = (kind == _D) & (known[number] == size) & (size > 0)
            other = (kind != _D) & kinds[kind] & (size > 0) & (size <= _LARGEST_TEXT)
            for found in np.flatnonzero(data | other).tolist():
                if self._in_step(at + found, stop):
                    return at + found
            at, width = end, min(2 * width, 1 << 20)
        return None

    def _in_step(self, at: int, stop: int) -> bool:
        for _ in range(_CHAIN):
            if at == stop:
                return True
            if at + 5 > stop:
                return False
            size, kind, number = _DATA.unpack_from(self._data, at)
            whole = size == self.known.sizes.get(number, size) if kind == _D else kind in KINDS
            if not whole or not 0 < size <= _LARGEST_TEXT:
                return False
            at += 3 + size
        return at <= stop

    def topics(self) -> dict[str, Topic]:
        """The first instance of each topic that has samples, where its samples can be told in time."""
        found: dict[str, Topic] = {}
        for name, instances in self.known.instances.items():
            layout = self.known.layouts[name]
            places = next((instances[i] for i in sorted(instances) if instances[i]), None)
            if layout is None or places is None or layout.fields.get("timestamp", (0, "", 0))[1:] != ("<u8", 0):
                continue
            fields = {f: v for f, v in layout.fields.items() if not f.startswith("_padding")}
            kinds = [(kind, (count,)) if count else kind for _, kind, count in fields.values()]
            offsets, size = [at for at, _, _ in fields.values()], layout.smallest
            dtype = np.dtype({"names": list(fields), "formats": kinds, "offsets": offsets, "itemsize": size})
            rows = b"".join([self._data[at + 5 : at + 5 + size] for at in places])
            found[name] = Topic(np.frombuffer(rows, dtype), np.array(places, np.int64))
        return found
