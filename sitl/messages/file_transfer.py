"""MAVLink FTP, as little of it as a client asks first: directories are listed, and no file is served.

Source: https://mavlink.io/en/services/ftp.html. PX4 v1.17 lists "/" and "/log"; it does not know @MAV_LOG.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Final

from sitl.messages.log_card import Log

PAYLOAD_BYTES: Final = 251
_HEADER: Final = struct.Struct("<HBBBBBxI")  # sequence, session, opcode, size, asked opcode, burst, offset
_TERMINATE, _LIST, _RESET = 1, 3, 2
_ACK, _NAK = 128, 129
END_OF_FILE: Final = 6
UNKNOWN_COMMAND: Final = 7
FILE_NOT_FOUND: Final = 10


def answer(request: bytes, logs: Sequence[Log]) -> bytes:
    """The payload that answers one of FILE_TRANSFER_PROTOCOL."""
    sequence, session, opcode, size, _, _, offset = _HEADER.unpack_from(request)
    asked = request[_HEADER.size : _HEADER.size + size].rstrip(b"\0").decode("ascii", "replace")
    if opcode in (_TERMINATE, _RESET):
        reply, data = _ACK, b""
    elif opcode == _LIST:
        reply, data = _listed(asked, offset, logs)
    else:
        reply, data = _NAK, bytes([UNKNOWN_COMMAND])
    head = _HEADER.pack(sequence + 1 & 0xFFFF, session, reply, len(data), opcode, 0, offset)
    return (head + data).ljust(PAYLOAD_BYTES, b"\0")


def _listed(path: str, offset: int, logs: Sequence[Log]) -> tuple[int, bytes]:
    entries = {"": ["Dlog"], "/log": [f"Flog_{at:03d}.ulg\t{len(log.data)}" for at, log in enumerate(logs)]}.get(
        path.rstrip("/")
    )
    if entries is None:
        return _NAK, bytes([FILE_NOT_FOUND])
    data = b""
    for entry in entries[offset:]:
        line = entry.encode() + b"\0"
        if _HEADER.size + len(data) + len(line) > PAYLOAD_BYTES:
            break
        data += line
    return (_ACK, data) if data else (_NAK, bytes([END_OF_FILE]))
