"""MAVLink FTP on one link, as far as a client reads logs: directories are listed, and logs opened and read.

PX4 v1.17 lists "/" and "/log"; from v1.18 on `@MAV_LOG` stands for the folder of the logs, in a folder for each day or,
where the vehicle did not know the time, for each session. One file is open at a time, and is closed after 10 s without
a request. BurstReadFile is not served. Source: https://mavlink.io/en/services/ftp.html; PX4 `mavlink_ftp.cpp`.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Final

from sitl.messages.log_card import Log

PAYLOAD_BYTES: Final = 251
_HEADER: Final = struct.Struct("<HBBBBBxI")  # sequence, session, opcode, size, asked opcode, burst, offset
_DATA_BYTES: Final = PAYLOAD_BYTES - _HEADER.size
_TERMINATE, _RESET, _LIST, _OPEN, _READ, _LIST_WITH_TIME = 1, 2, 3, 4, 5, 16
_ACK, _NAK = 128, 129
NO_SESSION: Final = 4
NO_SESSION_AVAILABLE: Final = 5
END_OF_FILE: Final = 6
UNKNOWN_COMMAND: Final = 7
FILE_NOT_FOUND: Final = 10

_MAV_LOG: Final = "@MAV_LOG"
_CLOCK_SET_S: Final = 1_234_567_890  # before that the logger names a session and no day
_SMALL_BYTES: Final = 4  # an answer that is sent again where its request comes again
_IDLE_US: Final = 10_000_000


class _RefusedError(Exception):
    """Answered by a NAK with this error."""


class FileTransfer:
    """What one link answers. `logs` of the vehicle, shared; `mav_log`, whether it knows `@MAV_LOG`, and times."""

    def __init__(self, logs: Sequence[Log], *, mav_log: bool) -> None:
        self._logs, self._mav_log = logs, mav_log
        self._open: Log | None = None
        self._size = 0  # as it was when it was opened
        self._asked_us = 0
        self._last: tuple[int, bytes] | None = None  # number of a request, and its small answer

    def answer(self, request: bytes, now_us: int = 0) -> bytes:
        """The payload that answers one of FILE_TRANSFER_PROTOCOL."""
        sequence, session, opcode, size, _, _, offset = _HEADER.unpack_from(request)
        if self._last is not None and self._last[0] == sequence:
            return self._last[1]
        if now_us - self._asked_us > _IDLE_US:
            self._open = None
        self._asked_us = now_us
        asked = request[_HEADER.size : _HEADER.size + size].rstrip(b"\0").decode("ascii", "replace")
        try:
            reply, data = _ACK, self._done(opcode, asked, offset, size, session)
        except _RefusedError as error:
            reply, data = _NAK, bytes([error.args[0]])
        head = _HEADER.pack(sequence + 1 & 0xFFFF, session, reply, len(data), opcode, 0, offset)
        payload = (head + data).ljust(PAYLOAD_BYTES, b"\0")
        self._last = (sequence, payload) if len(data) <= _SMALL_BYTES else None
        return payload

    def _done(self, opcode: int, asked: str, offset: int, size: int, session: int) -> bytes:
        if opcode in (_TERMINATE, _RESET):
            self._open = None
            return b""
        if opcode == _LIST or (opcode == _LIST_WITH_TIME and self._mav_log):
            return self._listed(asked, offset, with_time=opcode == _LIST_WITH_TIME)
        if opcode == _OPEN:
            return self._opened(asked)
        if opcode == _READ:
            if session != 0 or self._open is None:
                raise _RefusedError(NO_SESSION)
            if offset >= self._size:
                raise _RefusedError(END_OF_FILE)
            return self._open.data[offset : min(offset + size, self._size)]
        raise _RefusedError(UNKNOWN_COMMAND)

    def _opened(self, asked: str) -> bytes:
        if self._open is not None:
            raise _RefusedError(NO_SESSION_AVAILABLE)
        found = next((log for log, place in self._tree() if f"{_MAV_LOG}/{place}" == asked), None)
        if found is None:
            raise _RefusedError(FILE_NOT_FOUND)
        self._open, self._size = found, len(found.data)
        return self._size.to_bytes(4, "little")

    def _tree(self) -> list[tuple[Log, str]]:
        """Each log, and where it lies below `@MAV_LOG`; nothing in a version that does not know that."""
        return [(log, _place(at, log)) for at, log in enumerate(self._logs)] if self._mav_log else []

    def _listed(self, path: str, offset: int, *, with_time: bool) -> bytes:
        path = path.rstrip("/")
        flat = {"": ["Dlog"], "/log": [f"Flog_{at:03d}.ulg\t{len(log.data)}" for at, log in enumerate(self._logs)]}
        entries = flat.get(path)
        if path == _MAV_LOG and self._mav_log:
            entries = ["S", "S", *dict.fromkeys(f"D{place.partition('/')[0]}" for _, place in self._tree())]
        elif path.startswith(f"{_MAV_LOG}/"):
            folder = path.removeprefix(f"{_MAV_LOG}/")
            inside = [
                f"F{name}\t{len(log.data)}" + (f"\t{log.time_utc_s}" if with_time else "")
                for log, place in self._tree()
                for day, _, name in [place.partition("/")]
                if day == folder
            ]
            entries = ["S", "S", *inside] if inside else None
        if entries is None:
            raise _RefusedError(FILE_NOT_FOUND)
        data = b""
        for entry in entries[offset:]:
            line = entry.encode() + b"\0"
            if len(data) + len(line) > _DATA_BYTES:
                break
            data += line
        if not data:
            raise _RefusedError(END_OF_FILE)
        return data


def _place(number: int, log: Log) -> str:
    """As the logger names it; a log that is served by its time of writing has no other."""
    if log.time_utc_s < _CLOCK_SET_S:
        return f"sess{number + 1:03d}/log001.ulg"
    return f"{datetime.fromtimestamp(log.time_utc_s, UTC):%Y-%m-%d/%H_%M_%S}.ulg"
