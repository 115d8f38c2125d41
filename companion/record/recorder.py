"""The control thread's end of the record: bytes into a pipe, never a wait for a disk.

A process of its own (`companion.record.writer`) holds the other end. What the pipe cannot take stays in memory up to a
bound; past it records are dropped and counted, and the flight goes on.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import select
import struct
import subprocess
import time
from pathlib import Path
from typing import Final

from companion.safe_path import child_environment, python_command

TICK: Final = 1
RECEIVED: Final = 2
SENT: Final = 3
EVENT: Final = 4
RECORD_HEADER: Final = struct.Struct("<BIQ")  # kind, length, time in microseconds

_MOST_RECORDS = 512  # before they are handed on unasked
_KEEP_BYTES = 8_000_000
_PIPE_BYTES = 1 << 20


class Recorder:
    """Collects the records of a flight and hands them to the writer process in chunks.

    `blocking` waits for the writer instead of dropping: for lockstep, where time stands still meanwhile. `limits`, in
    bytes: what all flights beside this one may take with it, and what must be left free (`companion.record.quota`).
    Attributes: `dropped` records lost because the writer could not keep up or has gone.
    """

    def __init__(self, folder: Path, *, blocking: bool = False, limits: tuple[int, int] | None = None) -> None:
        self._dropped = 0
        self._kept = 0  # records collected since the pipe last took them all
        self.folder = folder
        self._records: list[tuple[int, int, bytes]] = []  # as they came: kind, time, data
        self._pending = bytearray()  # as they go into the pipe
        read_end, self._fd = os.pipe()
        try:
            with contextlib.suppress(OSError):
                fcntl.fcntl(self._fd, fcntl.F_SETPIPE_SZ, _PIPE_BYTES)
            arguments = map(str, (folder, *(limits or ())))
            self._process = subprocess.Popen(
                python_command("companion.record.writer", *arguments),
                stdin=read_end,
                start_new_session=True,
                env=child_environment(),
            )  # a session of its own: Ctrl-C stops the flight, and the writer when the pipe ends
        finally:
            os.close(read_end)
        os.set_blocking(self._fd, blocking)

    @property
    def dropped(self) -> int:
        """Counted up to now."""
        self._collect()
        return self._dropped

    def add(self, kind: int, time_us: int, data: bytes) -> None:
        """One record. Costs a reference; a copy and a system call only when a chunk is full."""
        records = self._records
        records.append((kind, time_us, data))
        if len(records) >= _MOST_RECORDS or self._fd < 0:
            self.flush()

    def flush(self) -> None:
        """Give the pipe what it takes now."""
        self._collect()
        if self._fd < 0 or not self._pending:
            return
        try:
            written = os.write(self._fd, self._pending)
        except BlockingIOError:
            return
        except OSError:  # the writer has gone: the flight goes on without a log
            self._give_up()
            return
        del self._pending[:written]
        if not self._pending:
            self._kept = 0

    def _collect(self) -> None:
        """Records to bytes, all at once: one by one, between ticks that cool the caches, each would cost threefold."""
        pending, header = self._pending, RECORD_HEADER.pack
        for kind, time_us, data in self._records:
            if self._fd < 0 or len(pending) > _KEEP_BYTES:
                self._dropped += 1
                continue
            pending += header(kind, len(data), time_us)
            pending += data
            self._kept += 1
        self._records.clear()

    def _give_up(self) -> None:
        self._dropped += self._kept
        self._kept = 0
        self._pending.clear()
        os.close(self._fd)
        self._fd = -1

    def close(self, timeout_s: float = 20.0) -> str | None:
        """End the log and wait for the writer; its complaint as one line, or None. Closing twice does no harm."""
        self._collect()
        if self._fd >= 0:
            deadline = time.monotonic() + timeout_s
            os.set_blocking(self._fd, False)
            while self._pending and self._fd >= 0 and (left := deadline - time.monotonic()) > 0.0:
                select.select([], [self._fd], [], left)
                self.flush()
        if self._fd >= 0:
            os.close(self._fd)
            self._fd = -1
        try:
            code = self._process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
            return f"{self.folder}: the log writer did not finish"
        if code == 0 and not self.dropped:
            return None
        what = f"{self.dropped} records dropped" if self.dropped else "the disk did not take it"
        return f"{self.folder}: the log is incomplete: {what}"
