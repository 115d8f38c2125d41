"""Lines for a person, from a loop that must never wait for one.

A terminal that is stopped, a pipe that is full or a shell that has gone blocks or kills whoever prints to it. The loop
only queues; a thread that sleeps in between does the writing, straight to the descriptor.
"""

from __future__ import annotations

import os
import queue
import threading

from companion.errors import printable


class Terminal:
    """Writes lines to a file descriptor, some time soon, or never."""

    def __init__(self, fd: int = 1) -> None:
        self._fd = fd
        self._lines: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._write, name="terminal", daemon=True)
        self._thread.start()

    def print_line(self, line: str) -> None:
        """Queue a line. Never blocks, never raises."""
        self._lines.put(line)

    def close(self, timeout_s: float = 1.0) -> None:
        """Wait for what is queued, but not for ever."""
        self._lines.put(None)
        self._thread.join(timeout_s)

    def _write(self) -> None:
        while (line := self._lines.get()) is not None:
            try:
                os.write(self._fd, f"{printable(line)}\n".encode())
            except OSError:
                return  # nobody listens any more
