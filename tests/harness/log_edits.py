"""Take a log apart and put it together again with something changed: messages of a ULog, records of a tlog."""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import development as mavlink

_SIZES = {
    "uint64_t": 8,
    "int64_t": 8,
    "double": 8,
    "float": 4,
    "uint32_t": 4,
    "int32_t": 4,
    "uint16_t": 2,
    "int16_t": 2,
}
_DATA, _FORMAT, _SUBSCRIBE, _PARAMETER, _FLAGS = b"DFAPB"


class UlogEdit:
    """A ULog as a list of messages (kind, body)."""

    def __init__(self, data: bytes) -> None:
        self.head, self.messages, at = data[:16], list[tuple[int, bytearray]](), 16
        while at + 3 <= len(data):
            size, kind = struct.unpack_from("<HB", data, at)
            self.messages.append((kind, bytearray(data[at + 3 : at + 3 + size])))
            at += 3 + size
        self._numbers = {
            m[3:].decode(): struct.unpack_from("<H", m, 1)[0] for kind, m in self.messages if kind == _SUBSCRIBE
        }
        self._formats = {
            name: fields.rstrip(";").split(";")
            for name, fields in (m.decode().split(":", 1) for kind, m in self.messages if kind == _FORMAT)
        }

    def pack(self) -> bytes:
        return self.head + b"".join(struct.pack("<HB", len(m), kind) + m for kind, m in self.messages)

    def at(self, topic: str) -> list[int]:
        """Where the samples of a topic stand among the messages."""
        number = struct.pack("<H", self._numbers[topic])
        return [i for i, (kind, m) in enumerate(self.messages) if kind == _DATA and m[:2] == number]

    def place(self, topic: str, field: str) -> int:
        """Where a field stands in the body of a sample."""
        at = 2
        for text in self._formats[topic]:
            kind, name = text.split(" ")
            if name == field:
                return at
            kind, _, count = kind.rstrip("]").partition("[")
            at += _SIZES.get(kind, 1) * int(count or 1)
        raise KeyError(f"{topic}.{field}")

    def set(self, topic: str, field: str, kind: str, *values: float, which: slice = slice(None)) -> UlogEdit:
        """Set a field of some samples."""
        place = self.place(topic, field)
        for i in self.at(topic)[which]:
            struct.pack_into(f"<{kind}", self.messages[i][1], place, *values)
        return self

    def change(
        self, topic: str, field: str, kind: str, to: Callable[[Any], Any], which: slice = slice(None)
    ) -> UlogEdit:
        """Set a field of some samples to a function of what it was."""
        place = self.place(topic, field)
        for i in self.at(topic)[which]:
            body = self.messages[i][1]
            struct.pack_into(
                f"<{kind}", body, place, *np.atleast_1d(to(np.array(struct.unpack_from(f"<{kind}", body, place))))
            )
        return self

    def rename(self, topic: str, renamed: dict[str, str]) -> UlogEdit:
        """Give fields other names, as other firmware does."""
        for kind, body in self.messages:
            if kind == _FORMAT and body.startswith(f"{topic}:".encode()):
                text = body.decode()
                for old, new in renamed.items():
                    assert f" {old};" in text
                    text = text.replace(f" {old};", f" {new};")
                body[:] = text.encode()
        return self

    def without(self, *topics: str) -> UlogEdit:
        """Leave topics out."""
        gone = {i for topic in topics for i in self.at(topic)}
        self.messages = [m for i, m in enumerate(self.messages) if i not in gone]
        return self

    def swap(self, topic: str, first: int, second: int) -> UlogEdit:
        places = self.at(topic)
        a, b = places[first], places[second]
        self.messages[a], self.messages[b] = self.messages[b], self.messages[a]
        return self

    def parameter(self, name: str, value: float, share: float) -> UlogEdit:
        """Write a change of a parameter after a share of the attitudes."""
        key = f"float {name}".encode()
        places = self.at("vehicle_attitude")
        body = bytearray([len(key), *key, *struct.pack("<f", value)])
        self.messages.insert(places[int(share * (len(places) - 1))], (_PARAMETER, body))
        return self

    def define(self, topic: str, fields: str, number: int) -> UlogEdit:
        """Add a topic that the log does not have; its samples are for the caller to write."""
        first = next(i for i, (kind, _) in enumerate(self.messages) if kind == _SUBSCRIBE)
        self.messages.insert(first, (_FORMAT, bytearray(f"{topic}:{fields}".encode())))
        self.messages.insert(first + 1, (_SUBSCRIBE, bytearray(struct.pack("<BH", 0, number) + topic.encode())))
        self._numbers[topic], self._formats[topic] = number, fields.rstrip(";").split(";")
        return self

    def appended(self, share: float) -> bytes:
        """The log with its last part as data that was appended after a power cut in the middle of a message."""
        data = self.pack()
        number = int(share * len(self.messages))
        place = 16 + sum(3 + len(m) for _, m in self.messages[:number])
        lost = data[place : place + 3 + len(self.messages[number][1]) // 2]
        offset = place + len(lost)
        for kind, body in self.messages:
            if kind == _FLAGS:
                body[8] |= 1
                struct.pack_into("<Q", body, 16, offset)
        return self.pack()[:place] + lost + data[place:]


Records = list[tuple[int, bytes]]


def records(data: bytes) -> Records:
    """(time in microseconds, frame) of every record of a tlog of MAVLink 2."""
    found, at = [], 0
    while at < len(data):
        end = at + 8 + 12 + data[at + 9] + (13 if data[at + 10] & 1 else 0)
        found.append((int.from_bytes(data[at : at + 8]), data[at + 8 : end]))
        at = end
    return found


def packed(of: Records) -> bytes:
    """The tlog of some records."""
    return b"".join(struct.pack(">Q", time_us) + frame for time_us, frame in of)


def stepped(of: Records, share: float, seconds: float) -> Records:
    """The records as a clock gives them that is set by so many seconds after a share of them."""
    middle = int(share * len(of))
    return [(t + (round(1e6 * seconds) if i >= middle else 0), frame) for i, (t, frame) in enumerate(of)]


def first_version(of: Records) -> Records:
    """The records as MAVLink 1, those left out that it has no number for."""
    decoder, found = mavlink.MAVLink(None), []
    for time_us, frame in of:
        if int.from_bytes(frame[7:10], "little") < 256:
            sender = mavlink.MAVLink(None, srcSystem=frame[5], srcComponent=frame[6])
            message = decoder.decode(bytearray(frame))
            found.append((time_us, bytes(message.pack(sender, force_mavlink1=True))))
    return found


def number(frame: bytes) -> int:
    """The message id of a frame of MAVLink 2."""
    return int.from_bytes(frame[7:10], "little")


def repacked(frame: bytes, **fields: Any) -> bytes:
    """The frame with other values, its checksum right."""
    message = mavlink.MAVLink(None).decode(bytearray(frame))
    for name, value in fields.items():
        setattr(message, name, value)
    sender = mavlink.MAVLink(None, srcSystem=frame[5], srcComponent=frame[6])
    sender.seq = frame[4]
    return bytes(message.pack(sender))
