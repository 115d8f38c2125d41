"""A flight folder back into arrays, also one whose writer was killed: to the end of what is whole."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Message
from mcap.stream_reader import get_chunk_data_stream
from zstandard import ZstdError

from companion.record import schema

_MAGIC: Final = b"\x89MCAP0\r\n"
_RECORD: Final = struct.Struct("<BQ")  # opcode, length of what follows
_MESSAGE: Final = struct.Struct("<HIQQ")  # channel, sequence, time of the record, time of publishing
_COMPRESSION: Final = b"\x04\0\0\0zstd"
_BEFORE_COMPRESSION: Final = _RECORD.size + 28  # bytes of a chunk's record before the name of its compression
_LARGEST_CHUNK: Final = 1 << 26  # bytes, unpacked; ours have 2^18


class Event(NamedTuple):
    """A named event and when it happened."""

    time_s: float
    name: str
    detail: str


class Flight(NamedTuple):
    """What `flight.mcap` holds.

    `ticks` is a structured array, one row a tick, with the fields of `companion.record.schema`: shape (n,) for single
    values, (n, k) for vectors. `notes` says in one line each what could not be read.
    """

    ticks: npt.NDArray[Any]
    events: list[Event]
    notes: tuple[str, ...] = ()


def tick_dtype() -> np.dtype[Any]:
    """The tick record as a numpy type, CDR header left out."""
    floats: list[Any] = [(f.name, "<f8", (f.size,)) if f.size > 1 else (f.name, "<f8") for f in schema.FLOATS]
    return np.dtype(floats + [(f.name, "u1") for f in schema.FLAGS])


def read_flight(folder: Path) -> Flight:
    """Read `flight.mcap` of a flight folder, whole chunk after whole chunk.

    Raises `OSError` or `ValueError` with a one-line reason, the latter for what is no flight log of ours.
    """
    path = folder / "flight.mcap"
    data = path.read_bytes()
    if not data.startswith(_MAGIC):
        raise ValueError(f"{path}: not a readable flight log (it does not begin as one)")
    ticks: list[bytes] = []
    events: list[Event] = []
    notes: list[str] = []
    topics: dict[int, str] = {}
    size = tick_dtype().itemsize
    count = following = 0  # messages, and the number of the one that should come next
    for record in _records(data, notes):
        if isinstance(record, Channel):
            topics[record.id] = record.topic
        elif isinstance(record, Message):
            count, following = count + 1, record.sequence + 1
            topic = topics.get(record.channel_id)
            if topic == schema.TICK_TOPIC:
                ticks.append(record.data[len(schema.CDR_HEADER) :])
            elif topic == schema.EVENT_TOPIC:
                events.append(Event(record.log_time * 1e-9, *_event(path, record.data)))
    if any(len(tick) != size for tick in ticks):
        raise ValueError(f"{path}: not a readable flight log (its ticks are not those of this version)")
    if following > count:
        notes.append(f"{following - count} of {following} records are lost")
    return Flight(np.frombuffer(b"".join(ticks), dtype=tick_dtype()), events, tuple(notes))


def _event(path: Path, data: bytes) -> tuple[str, str]:
    try:
        return schema.unpack_event(data)
    except (struct.error, UnicodeDecodeError) as error:
        raise ValueError(f"{path}: not a readable flight log (an event: {error})") from None


def _records(data: bytes, notes: list[str]) -> Iterator[Any]:
    """What is in the chunks that are whole; a note for those that are not, and for an end that is missing."""
    at, damaged, complete = len(_MAGIC), list[int](), False
    while at + _RECORD.size <= len(data):
        opcode, length = _RECORD.unpack_from(data, at)
        after = at + _RECORD.size + length
        if after > len(data) or not 0 < opcode <= Opcode.DATA_END:
            found = data.find(_COMPRESSION, at + _BEFORE_COMPRESSION + 1)
            if found < 0:
                break
            damaged.append(at)
            at = found - _BEFORE_COMPRESSION
            continue
        if opcode == Opcode.DATA_END:
            complete = data.endswith(_MAGIC)
            break
        if opcode in {Opcode.CHUNK, Opcode.CHANNEL}:
            try:
                yield from _parsed(opcode, data[at + _RECORD.size : after])
            except (McapError, ZstdError, ValueError, KeyError, struct.error):  # a wrong CRC is a ValueError
                damaged.append(at)
        at = after
    if damaged:
        notes.append(f"damaged at byte {damaged[0]} of {len(data)}: {len(damaged)} chunks passed over")
    if not complete:
        notes.append(f"the end is cut at byte {at} of {len(data)} (its writer was killed?): read up to there")


def _parsed(opcode: int, body: bytes) -> list[Any]:
    stream = ReadDataStream(BytesIO(body))
    if opcode == Opcode.CHANNEL:
        return [Channel.read(stream)]
    chunk = Chunk.read(stream)
    if chunk.uncompressed_size > _LARGEST_CHUNK:
        raise ValueError("a chunk too large to be one")
    stream, size = get_chunk_data_stream(chunk, validate_crc=True)
    return _in_chunk(stream.read(size))


def _in_chunk(data: bytes) -> list[Any]:
    """Channels and messages of a chunk; a flight has half a million, which mcap's own reader takes ten seconds for."""
    found, at = list[Any](), 0
    while at + _RECORD.size <= len(data):
        opcode, length = _RECORD.unpack_from(data, at)
        at += _RECORD.size
        if at + length > len(data):
            raise ValueError("a record is longer than its chunk")
        if opcode == Opcode.MESSAGE:
            channel, sequence, log_time, publish_time = _MESSAGE.unpack_from(data, at)
            body = data[at + _MESSAGE.size : at + length]
            found.append(Message(channel, log_time, body, publish_time, sequence))
        elif opcode == Opcode.CHANNEL:
            found.append(Channel.read(ReadDataStream(BytesIO(data[at : at + length]))))
        at += length
    return found
