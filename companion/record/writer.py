"""The writer process: records from a pipe into `traffic.tlog` and `flight.mcap`.

It ends when the pipe does, so a killed flight still leaves readable files. A full disk ends the file, not the flight:
the pipe is drained to its end all the same.

    python -m companion.record.writer FOLDER [QUOTA FREE]  < records

QUOTA and FREE in bytes, see `companion.record.quota`.
"""

from __future__ import annotations

import contextlib
import io
import math
import signal
import struct
import sys
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import IO

from mcap.writer import CompressionType, Writer

from companion import __version__
from companion.errors import printable
from companion.record import schema
from companion.record.quota import LOGS, Quota, lock
from companion.record.recorder import EVENT, RECEIVED, RECORD_HEADER, SENT, TICK

_CHUNK = 1 << 16
_LOOK_BYTES = 8 << 20  # between two looks at quota and free space: some minutes of flight
_TRAFFIC = (RECEIVED, SENT)
_TIME = struct.Struct(">Q")  # of a tlog record, before the frame: microseconds, big endian


def records(stream: IO[bytes]) -> Iterator[tuple[int, int, bytes]]:
    """(kind, time in microseconds, data) of every whole record."""
    buffer = b""
    while chunk := stream.read1(_CHUNK):  # type: ignore[attr-defined]
        buffer += chunk
        at = 0
        while len(buffer) - at >= RECORD_HEADER.size:
            kind, length, time_us = RECORD_HEADER.unpack_from(buffer, at)
            end = at + RECORD_HEADER.size + length
            if end > len(buffer):
                break
            yield kind, time_us, buffer[at + RECORD_HEADER.size : end]
            at = end
        buffer = buffer[at:]


class _File:
    """A file whose first failed write ends it, with one line on stderr, and nothing else."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.failed = False

    def open(self, files: contextlib.ExitStack) -> IO[bytes]:
        """The file; nowhere, when it cannot be opened."""
        stream: IO[bytes] = io.BytesIO()

        def opened() -> None:
            nonlocal stream
            stream = files.enter_context(Path(self.name).open("wb", buffering=1 << 16))  # noqa: SIM115

        self.attempt(opened)
        return stream

    def attempt(self, action: Callable[[], None]) -> None:
        if self.failed:
            return
        try:
            action()
        except OSError as error:
            self.fail(error)

    def fail(self, error: OSError) -> None:
        self.failed = True
        print(f"{printable(self.name)}: {error.strerror}: the log ends here, the flight goes on", file=sys.stderr)


def _open_mcap(stream: IO[bytes]) -> tuple[Writer, int, int]:
    writer = Writer(stream, chunk_size=1 << 18, compression=CompressionType.ZSTD)
    writer.start(profile="ros2", library=f"companion {__version__}")
    tick = writer.register_schema(schema.TICK_SCHEMA_NAME, "ros2msg", schema.tick_schema().encode())
    event = writer.register_schema(schema.EVENT_SCHEMA_NAME, "ros2msg", schema.event_schema().encode())
    return (
        writer,
        writer.register_channel(schema.TICK_TOPIC, "cdr", tick),
        writer.register_channel(schema.EVENT_TOPIC, "cdr", event),
    )


def write(folder: Path, stream: IO[bytes], quota: Quota | None = None) -> bool:
    """Write a flight's files until the stream ends. True when all of it is on disk."""
    return write_records(folder, records(stream), quota)


def write_records(folder: Path, all_records: Iterable[tuple[int, int, bytes]], quota: Quota | None = None) -> bool:
    """Write a flight's files from records of (kind, time in microseconds, data). True when all of it is on disk.

    Where `quota` finds no room any more, only events are written from then on.
    """
    tlog, mcap = _File(str(folder / "traffic.tlog")), _File(str(folder / "flight.mcap"))
    with contextlib.ExitStack() as files:
        traffic = tlog.open(files)
        flight = mcap.open(files)
        for file in (traffic, flight):
            lock(file)
        writer, tick_channel, event_channel = _open_mcap(flight)
        sequence = written = 0
        look_at = 0 if quota else math.inf
        full = False
        for kind, time_us, data in all_records:
            written += len(data)
            if written >= look_at and quota and not full:
                look_at = written + _LOOK_BYTES
                full = _is_full(folder, quota)
            log = tlog if kind in _TRAFFIC else mcap
            if log.failed or (full and kind != EVENT):
                continue
            try:
                if log is tlog:
                    traffic.write(_TIME.pack(time_us) + data)
                elif kind in (TICK, EVENT):
                    channel, time_ns = tick_channel if kind == TICK else event_channel, time_us * 1000
                    writer.add_message(channel, time_ns, data, time_ns, sequence)
                    sequence += 1
            except OSError as error:
                log.fail(error)
        mcap.attempt(writer.finish)
        mcap.attempt(flight.flush)
        tlog.attempt(traffic.flush)
        for file in (traffic, flight):  # a failed file cannot flush what it still holds
            with contextlib.suppress(OSError):
                file.close()
    return not (tlog.failed or mcap.failed or full)


def _is_full(folder: Path, quota: Quota) -> bool:
    passed = quota.make_room()
    if passed is not None:
        print(f"{folder / LOGS[0]}: {passed}: the log ends here, the flight goes on", file=sys.stderr)
    return passed is not None


if __name__ == "__main__":
    # A supervisor ends the flight's whole group, a watchdog by SIGABRT; this process ends when the pipe does.
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGABRT):
        signal.signal(number, signal.SIG_IGN)
    _folder = Path(sys.argv[1])
    _limits = [int(text) for text in sys.argv[2:4]]
    sys.exit(0 if write(_folder, sys.stdin.buffer, Quota(_folder, *_limits) if _limits else None) else 1)
