"""MAVLink FTP as a client that only reads: the tree of logs behind `@MAV_LOG`, and one file from wherever it was left.

Reads are asked for one by one, a window of them at a time, and not by BurstReadFile: PX4 answers that with 35 kB at
once, which a socket's buffer does not hold (`mavlink_ftp.cpp`). One session a link is all that PX4 has.

Source: https://mavlink.io/en/services/ftp.html; PX4 v1.18 knows `@MAV_LOG` and ListDirectoryWithTime, v1.17 neither.
"""

from __future__ import annotations

import math
import struct
import time
from enum import IntEnum
from typing import Any, Final, NamedTuple

from pymavlink.dialects.v20 import development as mavlink

from companion.mavlink.client import Client
from companion.mavlink.codec import Frame, Layout
from companion.mavlink.link import LinkError

LOG_FOLDER: Final = "@MAV_LOG"
PAYLOAD: Final = Layout("FILE_TRANSFER_PROTOCOL")
HEADER: Final = struct.Struct("<HBBBBBxI")  # sequence, session, opcode, size, opcode asked, burst complete, offset
DATA_BYTES: Final = 239

_MESSAGE_BYTES: Final = PAYLOAD.size - 3  # without network, system and component
_TARGET: Final = PAYLOAD.index("target_system"), PAYLOAD.index("target_component")
_DATA: Final = PAYLOAD.place("payload")
_MOST_ENTRIES: Final = 65_536  # of a folder: as many as the log protocol can number
_LONGEST_FOLDER: Final = 50  # in characters, which are up to four bytes each
_WINDOW: Final = 16  # reads under way: 4 kB a round trip, which a socket and a line hold
_READS_FROM: Final = 0x8000  # their numbers, far from what asks one by one: PX4 repeats its answer to the same number
_REORDERED: Final = 2  # answers that may overtake one
_SILENCE_S: Final = 0.5
_OFFERED_S: Final = 1.5  # without an answer by then there is no file transfer on this link
_PATIENCE_S: Final = 10.0  # of a card


class Opcode(IntEnum):
    """What is asked, and how it is answered."""

    TERMINATE_SESSION = 1
    RESET_SESSIONS = 2
    LIST_DIRECTORY = 3
    OPEN_FILE_RO = 4
    READ_FILE = 5
    LIST_DIRECTORY_WITH_TIME = 16
    ACK = 128
    NAK = 129


class Error(IntEnum):
    """Of a NAK, those that are told apart."""

    NO_SESSION_AVAILABLE = 5
    END_OF_FILE = 6
    UNKNOWN_COMMAND = 7


class FtpError(LinkError):
    """The vehicle refused; `code`, its reason."""

    def __init__(self, text: str, code: int) -> None:
        super().__init__(text)
        self.code = code


class Answer(NamedTuple):
    """An answer to a request of ours."""

    sequence: int  # one more than that of the request
    session: int
    good: bool  # ACK
    asked: int  # opcode
    offset: int
    data: bytes


class File(NamedTuple):
    """One file in the tree of logs."""

    path: str  # below `LOG_FOLDER`
    size_bytes: int
    time_utc_s: int  # of the last change; 0 where the vehicle does not tell it


def answer(frame: Frame, own: tuple[int, int]) -> Answer | None:
    """A FILE_TRANSFER_PROTOCOL that answers us; None for one to somebody else."""
    values = PAYLOAD.unpack(frame.payload)
    if any(values[place] not in (0, ours) for place, ours in zip(_TARGET, own, strict=True)):
        return None
    payload = bytes(values[_DATA])
    sequence, session, opcode, size, asked, _, offset = HEADER.unpack_from(payload)
    if opcode not in (Opcode.ACK, Opcode.NAK) or size > DATA_BYTES:
        return None
    data = payload[HEADER.size : HEADER.size + size]
    return Answer(sequence, session, opcode == Opcode.ACK, asked, offset, data)


def request(
    vehicle: tuple[int, int], sequence: int, opcode: Opcode, session: int, offset: int, data: bytes, size: int
) -> Any:
    """The message that asks; `size` of `data`, or how much is wanted."""
    payload = HEADER.pack(sequence & 0xFFFF, session, opcode, size, 0, 0, offset) + data
    return mavlink.MAVLink_file_transfer_protocol_message(0, *vehicle, list(payload.ljust(_MESSAGE_BYTES, b"\0")))


class Ftp:
    """Questions one after the other, each again while it stays unanswered."""

    def __init__(self, client: Client) -> None:
        self._client = client
        # PX4 answers a number that it has just answered by that answer, also to another run of ours.
        self._sequence = time.monotonic_ns() >> 20 & 0x7FFF
        self._with_time = True

    def logs(self) -> list[File] | None:
        """All logs of the vehicle; None where it offers no file transfer or does not know `@MAV_LOG`.

        Raises `LinkError` when a list has begun and does not come to its end.
        """
        try:
            folders = self._list(LOG_FOLDER, _OFFERED_S)
        except LinkError:
            return None
        return [
            File(f"{folder}/{name}", size, written)
            for folder, folder_size, _ in folders
            if folder_size < 0 and len(folder) <= _LONGEST_FOLDER
            for name, size, written in self._list(f"{LOG_FOLDER}/{folder}", _PATIENCE_S)
            if size >= 0 and len(f"{LOG_FOLDER}/{folder}/{name}".encode()) <= DATA_BYTES
        ]

    def open(self, path: str) -> int:
        """Open a log to read; its session. Raises `FtpError`, `LinkError`."""
        name = f"{LOG_FOLDER}/{path}".encode()
        try:
            return self.ask(Opcode.OPEN_FILE_RO, name).session
        except FtpError as error:
            if error.code != Error.NO_SESSION_AVAILABLE:
                raise
        self.ask(Opcode.RESET_SESSIONS)  # what a download that broke off has left open
        return self.ask(Opcode.OPEN_FILE_RO, name).session

    def close(self, session: int) -> None:
        """End a session, without waiting for the answer."""
        self._sequence += 1
        self._client.send(request(self._client.vehicle, self._sequence, Opcode.TERMINATE_SESSION, session, 0, b"", 0))

    def ask(self, opcode: Opcode, data: bytes = b"", offset: int = 0, patience_s: float = _PATIENCE_S) -> Answer:
        """One question and its answer. Raises `FtpError` for a NAK, `LinkError` for silence."""
        client = self._client
        self._sequence += 1
        message = request(client.vehicle, self._sequence, opcode, 0, offset, data, len(data))
        until_s, asked_s = time.monotonic() + patience_s, -math.inf
        while (now_s := time.monotonic()) < until_s:
            if now_s - asked_s >= _SILENCE_S:
                asked_s = now_s
                client.send(message)
            for frame in client.frames():
                found = answer(frame, client.ids) if frame.message_id == PAYLOAD.message_id else None
                if found is None or (found.asked, found.sequence) != (opcode, self._sequence + 1 & 0xFFFF):
                    continue
                if found.good:
                    return found
                code = found.data[0] if found.data else 0
                raise FtpError(f"{client.name}: the vehicle refuses {opcode.name.lower()}, error {code}", code)
        raise LinkError(f"{client.name}: no answer to {opcode.name.lower()} within {patience_s:g} s")

    def _list(self, path: str, patience_s: float) -> list[tuple[str, int, int]]:
        """Name, size (negative for a folder) and time of what lies in a folder."""
        found: list[tuple[str, int, int]] = []
        offset = 0  # counts what is skipped too
        while True:
            opcode = Opcode.LIST_DIRECTORY_WITH_TIME if self._with_time else Opcode.LIST_DIRECTORY
            try:
                told = self.ask(opcode, path.encode(), offset, patience_s)
            except FtpError as error:
                if error.code == Error.UNKNOWN_COMMAND and self._with_time:
                    self._with_time = False
                    continue
                if error.code == Error.END_OF_FILE:
                    return found
                raise
            lines = [line.decode("utf-8", "replace") for line in told.data.split(b"\0") if line]
            if not lines or offset > _MOST_ENTRIES:
                return found
            offset += len(lines)
            found += [entry(line[1:]) if line[0] == "F" else (line[1:], -1, 0) for line in lines if line[0] in "DF"]


def entry(text: str) -> tuple[str, int, int]:
    """A file of a listing: name, size and, where it is told, time; 0 for what is no number of 32 bits."""
    name, *numbers = text.split("\t")
    told = [int(word) if word.isascii() and word.isdigit() and len(word) <= 10 else 0 for word in (*numbers, "", "")]
    size, written = (number if number <= 0xFFFFFFFF else 0 for number in told[:2])
    return name, size, written


class FtpRead:
    """One file from `start` to `size_bytes`, in an open session.

    Attributes: `offset` up to which it is complete; `message_id` of what it takes.
    """

    message_id: Final = PAYLOAD.message_id

    def __init__(
        self, vehicle: tuple[int, int], own: tuple[int, int], session: int, size_bytes: int, start: int
    ) -> None:
        self._vehicle, self._own, self._session, self._size = vehicle, own, session, size_bytes
        self._next = start
        self._asked: dict[int, int] = {}  # by offset: which of all requests it was
        self._requests = self._answered = 0  # how many there were; the last of them that was answered
        self._spoke_s = -math.inf  # when something was asked or answered
        self._beyond: dict[int, bytes] = {}  # by offset: came before what belongs in front of it
        self._progress_s: float | None = None
        self.offset = start

    @property
    def done(self) -> bool:
        """Whether every byte has come."""
        return self.offset >= self._size

    def stalled(self, now_s: float) -> bool:
        """Whether the vehicle has stopped answering."""
        return self._progress_s is not None and now_s - self._progress_s > _PATIENCE_S

    def requests(self, now_s: float) -> list[Any]:
        """The ReadFile to send now: what was lost again, and as many more as the window has room for."""
        if self._progress_s is None:
            self._progress_s = now_s
        # The vehicle answers in order: what was asked before the one answered last is lost. On a slow line nothing is
        # late as long as anything comes.
        silent = now_s - self._spoke_s > _SILENCE_S
        due = [at for at, number in self._asked.items() if silent or number < self._answered - _REORDERED]
        while len(self._asked) + len(self._beyond) < _WINDOW and self._next < self._size:
            due.append(self._next)
            self._asked[self._next] = 0
            self._next += DATA_BYTES
        messages = []
        for at in due:
            self._requests += 1
            self._asked[at] = self._requests
            self._spoke_s = now_s
            number = _READS_FROM + self._requests & 0xFFFF
            messages.append(request(self._vehicle, number, Opcode.READ_FILE, self._session, at, b"", self._length(at)))
        return messages

    def take(self, frame: Frame, now_s: float) -> bytes:
        """An answer; returns what is new and follows without a gap on all that was returned before."""
        found = answer(frame, self._own)
        if found is None or not found.good or found.asked != Opcode.READ_FILE or found.session != self._session:
            return b""
        if found.offset not in self._asked or len(found.data) != self._length(found.offset):
            return b""
        self._answered = max(self._answered, self._asked.pop(found.offset))
        self._spoke_s = now_s
        self._beyond[found.offset] = found.data
        parts = []
        while (part := self._beyond.pop(self.offset, None)) is not None:
            parts.append(part)
            self.offset += len(part)
        if parts:
            self._progress_s = now_s
        return b"".join(parts)

    def _length(self, offset: int) -> int:
        return min(DATA_BYTES, self._size - offset)
