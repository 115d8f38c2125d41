"""A record that this process writes itself, once the flight is over: for flights in lockstep that nobody cuts short."""

from __future__ import annotations

from pathlib import Path

from companion.record.recorder import Recorder
from companion.record.writer import write_records


class DirectRecorder(Recorder):
    """Keeps the records of a flight in memory until it is closed. Nothing of it survives the process."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._records: list[tuple[int, int, bytes]] = []
        self._complaint: str | None = None
        self._closed = False

    @property
    def dropped(self) -> int:
        return 0

    def add(self, kind: int, time_us: int, data: bytes) -> None:
        self._records.append((kind, time_us, data))

    def flush(self) -> None:
        """There is nobody to hand it to yet."""

    def close(self, timeout_s: float = 0.0) -> str | None:  # noqa: ARG002 - as Recorder has it
        """Write the files; the complaint as one line, or None. Closing twice does no harm."""
        if not self._closed:
            self._closed = True
            if not write_records(self.folder, self._records):
                self._complaint = f"{self.folder}: the log is incomplete: the disk did not take it"
            self._records = []
        return self._complaint
