"""What a ULog says of itself: the layout of its topics, parameters and information.

Source: https://docs.px4.io/main/en/dev_log/ulog_file_format
"""

from __future__ import annotations

import math
import struct
from typing import Final, NamedTuple

FORMAT, SUBSCRIBE, PARAMETER, INFORMATION = b"FAPI"
_LARGEST: Final = 65535  # bytes of a message
_DEEPEST: Final = 16  # definitions inside definitions
_TYPES: Final = {
    "int8_t": "<i1", "uint8_t": "<u1", "int16_t": "<i2", "uint16_t": "<u2", "int32_t": "<i4", "uint32_t": "<u4",
    "int64_t": "<i8", "uint64_t": "<u8", "float": "<f4", "double": "<f8", "bool": "<u1", "char": "<u1",
}  # fmt: skip


class Parameter(NamedTuple):
    """A parameter as written at a place of the file."""

    place: int
    name: str
    value: float


class Layout(NamedTuple):
    """Where the fields of a topic stand."""

    fields: dict[str, tuple[int, str, int]]  # offset, numpy type, length of an array or 0; nested ones left out
    smallest: int  # bytes, padding at the end left out, as it is written
    size: int


class Definitions:
    """Taken in message by message; one that says nothing readable is passed over.

    Attributes
    ----------
    sizes, largest
        Bytes of a topic's data by its number, without and with the padding at its end.
    places
        Of the topics wanted, by number: where their data stands. The reader of the file fills them.
    instances
        The same lists by name and instance.
    """

    def __init__(self, wanted: frozenset[str]) -> None:
        self._wanted = wanted
        self._texts: dict[str, str] = {}
        self.layouts: dict[str, Layout] = {}
        self.sizes: dict[int, int] = {}
        self.largest: dict[int, int] = {}
        self.places: dict[int, list[int]] = {}
        self.instances: dict[str, dict[int, list[int]]] = {}
        self.parameters: list[Parameter] = []
        self.information: dict[str, bytes] = {}

    def take(self, kind: int, at: int, body: bytes) -> None:
        """Take in a message that is no data, which stands at a place."""
        if kind == FORMAT:
            name, colon, fields = body.decode("ascii", "replace").partition(":")
            if colon and name not in self.layouts:
                self._texts[name] = fields
        elif kind == SUBSCRIBE and len(body) > 3:
            self._subscribe(body[0], body[1] | body[2] << 8, body[3:].decode("ascii", "replace"))
        elif kind in {PARAMETER, INFORMATION} and len(body) > body[0]:
            type_name, _, name = body[1 : 1 + body[0]].decode("ascii", "replace").partition(" ")
            value = body[1 + body[0] :]
            if kind == INFORMATION:
                self.information[name] = value
            elif len(value) == 4 and type_name in {"float", "int32_t"}:
                number = float(struct.unpack("<f" if type_name == "float" else "<i", value)[0])
                if math.isfinite(number):
                    self.parameters.append(Parameter(at, name, number))

    def _subscribe(self, instance: int, number: int, name: str) -> None:
        layout = self._layout(name, frozenset())
        if layout is None:
            return
        self.sizes[number], self.largest[number] = 2 + layout.smallest, 2 + layout.size
        self.places.pop(number, None)
        if name in self._wanted:
            self.places[number] = self.instances.setdefault(name, {}).setdefault(instance, [])

    def _layout(self, name: str, inside: frozenset[str]) -> Layout | None:
        """None for one that is not defined, that contains itself or that fits in no message."""
        if name in self.layouts:
            return self.layouts[name]
        if name not in self._texts or name in inside or len(inside) > _DEEPEST:
            return None
        fields: dict[str, tuple[int, str, int]] = {}
        at = smallest = 0
        for text in filter(None, self._texts[name].split(";")):
            type_name, _, field = text.strip().partition(" ")
            type_name, _, length = type_name.partition("[")
            count = int(length[:-1]) if length[:-1].isdecimal() and len(length) < 7 else 0
            if bool(length) is not bool(count) or not field.isidentifier():
                return None
            if type_name in _TYPES:
                size = int(_TYPES[type_name][2])
                fields[field] = (at, _TYPES[type_name], count)
            else:
                nested = self._layout(type_name, inside | {name})
                if nested is None:
                    return None
                size = nested.size
            at += size * max(count, 1)
            if at > _LARGEST:
                return None
            if not field.startswith("_padding"):
                smallest = at
        self.layouts[name] = Layout(fields, smallest, at)
        return self.layouts[name]
