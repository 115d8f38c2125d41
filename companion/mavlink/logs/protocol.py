"""The log protocol as a client: list what the vehicle has, fetch one log without holes, from wherever it was left.

Ours and not mavsdk's `log_files`, because that one (v4, `log_files_impl.cpp`) refuses a file that exists and so cannot
continue one, always begins at zero, writes chunks where they belong and so leaves holes behind a broken download, never
looks at the count of a LOG_DATA, and asks for 46 kB at a time, which PX4 answers with one burst of 512 frames that the
odometry has to queue behind. Here the size of a burst is a parameter, and what is handed out is contiguous, so that a
partial file has no holes and its length is all there is to know about it.

PX4 (`mavlink_log_handler.cpp`) serves one request at a time, forgets it when another comes, answers none before the
logs have been listed, and answers a vehicle without logs with silence. https://mavlink.io/en/services/log_download.html
"""

from __future__ import annotations

import math
import re
from datetime import UTC, datetime
from typing import Any, Final, NamedTuple

from pymavlink.dialects.v20 import development as mavlink

from companion.mavlink.codec import Frame, Layout

DATA_BYTES: Final = 90  # LOG_DATA.data
LOG_ENTRY: Final = Layout("LOG_ENTRY")
LOG_DATA: Final = Layout("LOG_DATA")

_ALL: Final = 0xFFFF
_PARTS: Final = re.compile(r"([0-9]+)|([^0-9]+)")
_CLOCK_SET_S: Final = 1_234_567_890  # PX4's own bound (`logger/util.cpp`): before it, its clock was not set
_LIST_SILENCE_S: Final = 1.0
_LONGEST_SILENCE_S: Final = 8.0
_LIST_PATIENCE_S: Final = 20.0  # a slow card with many logs takes longer than 6 s to begin
_REST_PATIENCE_S: Final = 10.0  # without an entry that is new, once a list has begun
_DATA_SILENCE_S: Final = 0.25
_DATA_PATIENCE_S: Final = 10.0


class LogEntry(NamedTuple):
    """One log on the vehicle. Its id holds only until the next list: what names it is when it was written, and size."""

    id: int  # in the order of the list
    size_bytes: int
    time_utc_s: int  # of the last write, by the vehicle's clock, which may not have been set: see `dated`
    path: str = ""  # below `@MAV_LOG`, where the vehicle has told it

    @property
    def dated(self) -> bool:
        """Whether its time is one. Without GPS, PX4's clock begins in 1970, or in 1980 or 2000 on a card or a board."""
        return self.time_utc_s >= _CLOCK_SET_S

    @property
    def order(self) -> tuple[bool, int, tuple[tuple[int, str], ...], int]:
        """Sorts logs from the oldest on, those without a time first: by PX4's count of sessions, or as listed."""
        if self.dated:
            return True, self.time_utc_s, (), self.id
        numbers = tuple((int(digits), "") if digits else (0, other) for digits, other in _PARTS.findall(self.path))
        return False, 0, numbers, self.id

    @property
    def file_name(self) -> str:
        """A name that another log does not have: the same one grown longer has another."""
        if self.dated:
            written = datetime.fromtimestamp(self.time_utc_s, UTC)
            return f"{written:%Y-%m-%d_%H-%M-%S}_{self.size_bytes}.ulg"
        name = re.sub(r"[^A-Za-z0-9_-]", "_", self.path.removesuffix(".ulg")) or f"log_{self.id:03d}"
        return f"{name}_{self.size_bytes}.ulg"


class Pace(NamedTuple):
    """How fast a log is asked for: the vehicle answers each request with one burst."""

    burst_frames: int
    interval_s: float  # between two requests, at least


ALONE: Final = Pace(128, 0.0)  # 11.5 kB: as many small datagrams as a socket's default buffer holds twice over
# Beside a flight: of a line of 921600 baud a fifth, and what queues in front of an odometry takes 5 ms; of a network
# with room for both as much as a loop at 250 Hz does not notice (benchmarks/services.py).
ON_A_LINE: Final = Pace(4, 0.02)  # 18 kB/s
ON_A_NETWORK: Final = Pace(16, 0.02)  # 72 kB/s


class LogList:
    """The list of logs, whatever the link loses and however slow the card is.

    A vehicle may begin its list anew at each request, so it is asked the more seldom the less comes of it. Entries may
    never come, or only those that are known already: the patience is for what is new.

    Attributes: `entries` by id; `total` as the vehicle tells it, None until it has told.
    """

    def __init__(self, system_id: int, component_id: int) -> None:
        self._ids = (system_id, component_id)
        self._began_s: float | None = None
        self._asked_s = self._heard_s = self._new_s = -math.inf
        self._silence_s = _LIST_SILENCE_S
        self._most = 0  # entries ever known at a time
        self.entries: dict[int, LogEntry] = {}
        self.total: int | None = None

    @property
    def done(self) -> bool:
        """Whether all are known."""
        return self.total is not None and len(self.entries) >= self.total

    def over(self, now_s: float) -> bool:
        """Whether there is nothing left to wait for. Silence means no logs, or a vehicle that serves none."""
        patience_s = _LIST_PATIENCE_S if self.total is None else _REST_PATIENCE_S
        return self.done or (self._began_s is not None and now_s - max(self._new_s, self._began_s) > patience_s)

    def requests(self, now_s: float) -> list[Any]:
        """LOG_REQUEST_LIST from the first that is missing on, after a silence."""
        if self.over(now_s) or now_s - max(self._asked_s, self._heard_s) < self._silence_s:
            return []
        if self._began_s is None:
            self._began_s = now_s
        elif self._new_s > self._asked_s:
            self._silence_s = _LIST_SILENCE_S
        else:
            self._silence_s = min(2.0 * self._silence_s, _LONGEST_SILENCE_S)
        self._asked_s = now_s
        first = next((number for number in range(self.total or 0) if number not in self.entries), 0)
        return [mavlink.MAVLink_log_request_list_message(*self._ids, first, _ALL)]

    def take(self, frame: Frame, now_s: float) -> None:
        """A LOG_ENTRY."""
        time_utc, size, number, total, _ = LOG_ENTRY.unpack(frame.payload)
        self._heard_s = now_s
        if total != self.total:  # another list: what a number stands for is another log
            self.entries.clear()
        self.total = total
        if total:
            self.entries[number] = LogEntry(number, size, time_utc)
        if len(self.entries) > self._most:
            self._most, self._new_s = len(self.entries), now_s


class LogFetch:
    """One log, from `start` (what is on disk already) to its end.

    Attributes: `offset` up to which it is complete; `repeated` requests for what was lost; `message_id` of what it
    takes.
    """

    message_id: Final = LOG_DATA.message_id

    def __init__(self, system_id: int, component_id: int, entry: LogEntry, start: int = 0, pace: Pace = ALONE) -> None:
        self._ids = (system_id, component_id)
        self._entry = entry
        self._pace = pace
        self._start = start
        self._window_end = start
        self._beyond: dict[int, bytes] = {}  # by offset: came before what belongs in front of it
        self._asked_s = self._heard_s = -math.inf
        self._last_asked = 0  # where the last piece of the current request begins
        self._progress_s: float | None = None
        self._finished = True  # the answer to the last request has come to its end
        self.offset = start
        self.repeated = 0

    @property
    def done(self) -> bool:
        """Whether every byte has come."""
        return self.offset >= self._entry.size_bytes

    def stalled(self, now_s: float) -> bool:
        """Whether the vehicle has stopped answering."""
        return self._progress_s is not None and now_s - self._progress_s > _DATA_PATIENCE_S

    def requests(self, now_s: float) -> list[Any]:
        """The LOG_REQUEST_DATA to send now: the next window, or the first hole in this one; never two at once."""
        if self._progress_s is None:
            self._progress_s = now_s
        if self.done or now_s - self._asked_s < self._pace.interval_s:
            return []
        if not self._finished and now_s - max(self._asked_s, self._heard_s) < _DATA_SILENCE_S:
            return []
        if self.offset >= self._window_end:
            length = self._pace.burst_frames * DATA_BYTES
            self._window_end = min(self.offset + length, self._entry.size_bytes)
        else:
            self.repeated += 1
        end = next((at for at in sorted(self._beyond) if at > self.offset), self._window_end)
        self._asked_s, self._finished = now_s, False
        self._last_asked = self.offset + (end - self.offset - 1) // DATA_BYTES * DATA_BYTES
        return [mavlink.MAVLink_log_request_data_message(*self._ids, self._entry.id, self.offset, end - self.offset)]

    def take(self, frame: Frame, now_s: float) -> bytes:
        """A LOG_DATA; returns what is new and follows without a gap on all that was returned before."""
        offset, number, count, *data = LOG_DATA.unpack(frame.payload)
        ours = number == self._entry.id and 0 < count <= DATA_BYTES and not (offset - self._start) % DATA_BYTES
        whole = count == DATA_BYTES or offset + count == self._entry.size_bytes
        if not ours or not whole or not self.offset <= offset < self._window_end:
            return b""  # of another log, of an earlier request, or had already
        self._heard_s = now_s
        self._finished = self._finished or offset == self._last_asked
        # A log that has grown since it was listed ends in a whole packet.
        self._beyond[offset] = bytes(data[: min(count, self._entry.size_bytes - offset)])
        begin = self.offset
        parts = []
        while (part := self._beyond.pop(self.offset, None)) is not None:
            parts.append(part)
            self.offset += len(part)
        if self.offset > begin:
            self._progress_s = now_s
        return b"".join(parts)

    def end(self) -> Any:
        """LOG_REQUEST_END: the vehicle may close its file."""
        return mavlink.MAVLink_log_request_end_message(*self._ids)
