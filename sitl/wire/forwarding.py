"""Whom a frame is for, as PX4 decides what one link passes on to the others (`Mavlink::forward_message`)."""

from __future__ import annotations

import struct
from typing import Any, Final

from pymavlink.dialects.v20 import development as mavlink

from companion.mavlink.codec import Frame

Address = tuple[int, int]  # system and component; 0 means all of them


def _offsets(message: Any) -> tuple[int, int]:
    """Where target_system and target_component stand in the payload; -1 for one that is not there."""
    formats = bytes(message.native_format).decode()[1:]
    places, at = {}, 0
    for name, kind, count in zip(message.ordered_fieldnames, formats, message.array_lengths, strict=True):
        places[name] = at
        at += struct.calcsize(f"<{count or 1}{kind}")
    return places.get("target_system", -1), places.get("target_component", -1)


_TARGETS: Final = {number: _offsets(message) for number, message in mavlink.mavlink_map.items()}


def target(frame: Frame) -> Address:
    """(system, component) that a frame is for; (0, 0) for one to everybody. Zeros cut off the payload are zeros."""
    payload = frame.payload
    system, component = _TARGETS.get(frame.message_id, (-1, -1))
    return (
        payload[system] if 0 <= system < len(payload) else 0,
        payload[component] if 0 <= component < len(payload) else 0,
    )


def concerns(address: Address, heard: set[Address]) -> bool:
    """Whether a link on which these have been heard leads to an address."""
    system, component = address
    return system == 0 or any(system == s and component in (0, c) for s, c in heard)
