"""MAVLink 2 framing and the fast path for the few messages that fly the vehicle.

Layouts and CRC extras are read from pymavlink's own message tables, never typed by hand; `struct` and a compiled CRC do
the work, which halves the latency of pymavlink's general parser. Everything that is not hot goes through pymavlink.

Source: https://mavlink.io/en/guide/serialization.html
"""

from __future__ import annotations

import re
import struct
from typing import Any, Final, NamedTuple

from fastcrc.crc16 import mcrf4xx
from pymavlink.dialects.v20 import development as mavlink

MAGIC_V2: Final = 0xFD
HEADER_BYTES: Final = 10
CRC_BYTES: Final = 2
SIGNATURE_BYTES: Final = 13
INCOMPAT_SIGNED: Final = 0x01
MAX_FRAME_BYTES: Final = HEADER_BYTES + 255 + CRC_BYTES + SIGNATURE_BYTES
MOST_REJECTED: Final = 128  # false beginnings looked at in a datagram: rubbish may cost no more than frames do

_new = tuple.__new__  # what a NamedTuple's own constructor calls, without the call in between
_MAGIC = b"\xfd"
_PLAUSIBLE = re.compile(rb"\xfd[\x00-\xff][\x00\x01]").search  # a beginning with no incompatibility but a signature
_HEADER = struct.Struct("<BBBBBBHB")  # length, incompat, compat, sequence, system, component, id low 16, id high 8
_BEGINNING = struct.Struct("<BBBBBBBHB").unpack_from  # the same with the magic before it
_MESSAGES: dict[int, Any] = mavlink.mavlink_map
_CRC_EXTRA: dict[int, bytes] = {number: bytes([message.crc_extra]) for number, message in _MESSAGES.items()}


class Frame(NamedTuple):
    """One MAVLink 2 frame whose CRC is right."""

    message_id: int
    system_id: int
    component_id: int
    sequence: int
    payload: bytes  # as sent: trailing zeros cut off
    raw: bytes  # the whole frame


class FrameParser:
    """Split bytes into frames; count and drop what is not one.

    A datagram carries whole frames (`stream=False`: an unfinished tail is dropped); a serial line does not
    (`stream=True`: the tail waits for the next bytes, and a frame behind rubbish is found whatever the rubbish is: what
    comes over a line is bounded by the line).

    Attributes: `frames` accepted; `bad_crc` frames with a wrong checksum; `unknown` frames of a message id
    that the dialect does not know; `dropped_bytes` that belong to no accepted frame.
    """

    def __init__(self, *, stream: bool = False) -> None:
        self.stream = stream
        self.frames = 0
        self.bad_crc = 0
        self.unknown = 0
        self.dropped_bytes = 0
        self._rest = b""

    def feed(self, data: bytes) -> list[Frame]:
        """Take the next bytes of the link; return the frames they complete, in order."""
        if self._rest:
            data = self._rest + data
            self._rest = b""
        elif (frame := _whole(data)) is not None:
            self.frames += 1
            return [frame]
        frames: list[Frame] = []
        position, total = 0, len(data)
        left = MOST_REJECTED
        while position < total:
            if data[position] != MAGIC_V2:
                found = self._next(data, position)
                self.dropped_bytes += found - position
                position = found
                continue
            if total - position < HEADER_BYTES + CRC_BYTES:
                if self.stream:
                    break
                self.dropped_bytes += total - position
                return self._counted(frames)
            length, incompat, _, sequence, system, component, low, high = _HEADER.unpack_from(data, position + 1)
            message_id = low | high << 16
            extra = _CRC_EXTRA.get(message_id)
            if incompat & ~INCOMPAT_SIGNED:
                pass  # no beginning of a frame that could be read
            elif extra is None:
                self.unknown += 1
            else:
                crc_at = position + HEADER_BYTES + length
                end = crc_at + CRC_BYTES + (SIGNATURE_BYTES if incompat else 0)
                if end > total:
                    if self.stream:
                        break
                    # a datagram ends here: not a frame, so look behind its first byte
                elif mcrf4xx(data[position + 1 : crc_at] + extra) != data[crc_at] | data[crc_at + 1] << 8:
                    self.bad_crc += 1
                else:
                    payload = data[position + HEADER_BYTES : crc_at]
                    frames.append(_new(Frame, (message_id, system, component, sequence, payload, data[position:end])))
                    position = end
                    continue
            found = self._next(data, position + 1)
            self.dropped_bytes += found - position
            position = found
            left -= 1
            if not left and not self.stream:
                self.dropped_bytes += total - position
                return self._counted(frames)
        self._rest = data[position:]
        return self._counted(frames)

    def _next(self, data: bytes, position: int) -> int:
        """Where the next frame may begin; in a stream, a beginning that is cut may be one too."""
        match = _PLAUSIBLE(data, position)
        if match is not None:
            return match.start()
        if not self.stream:
            return len(data)
        found = data.find(_MAGIC, max(position, len(data) - 2))
        return len(data) if found < 0 else found

    def _counted(self, frames: list[Frame]) -> list[Frame]:
        self.frames += len(frames)
        return frames


def _whole(data: bytes) -> Frame | None:
    """Bytes that are one intact frame without a signature, as most datagrams are; None for all else."""
    size = len(data) - HEADER_BYTES - CRC_BYTES
    if size < 0:
        return None
    magic, length, incompat, _, sequence, system, component, low, high = _BEGINNING(data)
    message_id = low | high << 16
    extra = _CRC_EXTRA.get(message_id)
    if magic != MAGIC_V2 or length != size or incompat or extra is None:
        return None
    if mcrf4xx(data[1:-CRC_BYTES] + extra) != data[-2] | data[-1] << 8:
        return None
    return _new(Frame, (message_id, system, component, sequence, data[HEADER_BYTES:-CRC_BYTES], data))


class Layout:
    """Wire layout of one message, from pymavlink's tables.

    Attributes: `message_id`, `name`, `crc_extra`, `fields` (names in wire order, arrays as one name), `size` in bytes.
    Raises `KeyError` for a name that the dialect does not have, `ValueError` for a message that carries text.
    """

    def __init__(self, name: str) -> None:
        message = _BY_NAME[name]
        formats: str = bytes(message.native_format).decode()[1:]
        if "c" in formats:
            raise ValueError(f"{name} carries text: decode it with pymavlink")
        counts: list[int] = [message.array_lengths[i] for i in range(len(formats))]
        self.message_id: int = message.id
        self.name = name
        self.crc_extra: int = message.crc_extra
        self.fields: tuple[str, ...] = tuple(message.ordered_fieldnames)
        self._parts = [f"{n}{f}" if n else f for n, f in zip(counts, formats, strict=True)]
        self._struct = struct.Struct("<" + "".join(self._parts))
        self._slices: dict[str, int | slice] = {}
        at = 0
        for field, count in zip(self.fields, counts, strict=True):
            self._slices[field] = slice(at, at + count) if count else at
            at += count or 1
        self.size = self._struct.size
        self.pack = self._struct.pack

    def unpack(self, payload: bytes) -> tuple[Any, ...]:
        """Values in wire order, arrays flattened. A payload cut short is padded with zeros, as MAVLink 2 demands."""
        size = self.size
        if len(payload) != size:
            payload = payload.ljust(size, b"\0") if len(payload) < size else payload[:size]
        return self._struct.unpack(payload)

    def only(self, *fields: str) -> struct.Struct:
        """A decoder of these fields alone, in wire order; what lies between is skipped without making a number of it.

        An array's element is named as ``pose_covariance[6]``. Use it as ``only(...).unpack_from(payload)`` on a
        payload of full length (see `full`).
        """
        text = "<"
        for field, part in zip(self.fields, self._parts, strict=True):
            if field in fields:
                text += part
            elif not any(name.startswith(f"{field}[") for name in fields):
                text += f"{struct.calcsize('<' + part)}x"
            else:
                one = part[-1]
                skip = f"{struct.calcsize('<' + one)}x"
                text += "".join(one if f"{field}[{i}]" in fields else skip for i in range(int(part[:-1])))
        return struct.Struct(text)

    def full(self, payload: bytes) -> bytes:
        """The payload at its full length, zeros that were cut off put back."""
        return payload if len(payload) >= self.size else payload.ljust(self.size, b"\0")

    def place(self, field: str) -> int | slice:
        """Where a field stands in the tuple of `unpack`: an index, or a slice for an array."""
        return self._slices[field]

    def index(self, field: str) -> int:
        """Where a single value stands in the tuple of `unpack`. Raises `KeyError` for an array or an unknown field."""
        place = self._slices[field]
        if isinstance(place, slice):
            raise KeyError(f"{self.name}.{field} is an array")
        return place

    def named(self, payload: bytes) -> dict[str, Any]:
        """Values by field name; arrays as tuples. For tools and tests: the loop uses `unpack`."""
        values = self.unpack(payload)
        return {field: values[place] for field, place in self._slices.items()}


_BY_NAME: dict[str, Any] = {message.msgname: message for message in _MESSAGES.values()}


class Encoder:
    """Writes one message from one sender; byte for byte what pymavlink packs, at a fifth of the time.

    `signed`: the header says that a signature follows; putting it there is `companion.mavlink.signing`'s.
    """

    def __init__(self, layout: Layout, system_id: int, component_id: int, *, signed: bool = False) -> None:
        self._pack = layout.pack
        self._flags = INCOMPAT_SIGNED if signed else 0
        self._extra = bytes([layout.crc_extra])
        self._system = system_id
        self._component = component_id
        self._low = layout.message_id & 0xFFFF
        self._high = layout.message_id >> 16

    def encode(self, sequence: int, *wire_values: float) -> bytes:
        """One frame from values in wire order, arrays flattened. `sequence` counts modulo 256."""
        payload = self._pack(*wire_values).rstrip(b"\0") or b"\0"
        body = _HEADER.pack(
            len(payload), self._flags, 0, sequence & 255, self._system, self._component, self._low, self._high
        )
        body += payload
        return _MAGIC + body + mcrf4xx(body + self._extra).to_bytes(2, "little")


def crc_extra(message_id: int) -> bytes:
    """The byte that stands for a message's layout in its CRC. Raises `KeyError` for a message the dialect has not."""
    return _CRC_EXTRA[message_id]


def decode_cold(frame: Frame) -> Any:
    """The frame as pymavlink's message object, for everything off the hot path."""
    return _PYMAVLINK.decode(bytearray(frame.raw))


_PYMAVLINK = mavlink.MAVLink(None)
