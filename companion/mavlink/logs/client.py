"""A tool fetches the vehicle's logs: list them, go on with one where it broke off, be sure of every byte.

By MAVLink FTP where the vehicle offers its logs there (PX4 from v1.18 on), else by the log protocol; beside a flight
always by the second, which asks at the pace that the flight bears. A log on its way is NAME.part. It only ever grows by
what follows without a gap, so that it is right as far as it goes.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Final, NamedTuple

from companion.config import ConfigError
from companion.mavlink.client import Client
from companion.mavlink.link import LinkError
from companion.mavlink.logs.ftp import Ftp, FtpRead
from companion.mavlink.logs.protocol import LOG_ENTRY, LogEntry, LogFetch, LogList

_GROWS_S: Final = 2.5  # PX4 makes what it has logged visible once a second (`log_writer_file.cpp`)


class Listing(NamedTuple):
    """The logs of a vehicle, oldest first, those without a time before the others; `untold`, how many never came."""

    entries: list[LogEntry]
    untold: int = 0


def newest(entries: list[LogEntry]) -> list[LogEntry]:
    """The newest by time, and the last of those whose time the vehicle did not know: which of two is, nobody knows."""
    dated = [entry for entry in entries if entry.dated]
    undated = [entry for entry in entries if not entry.dated]
    return [max(some, key=lambda entry: entry.order) for some in (dated, undated) if some]


def list_logs(client: Client) -> Listing:
    """All logs of the vehicle. Raises `LinkError` when a list has begun and the vehicle stops answering."""
    files = None if client.shared else Ftp(client).logs()
    if files is not None:
        entries = [LogEntry(number, size, written, path) for number, (path, size, written) in enumerate(files)]
        return Listing(_in_order(entries))
    listing = LogList(*client.vehicle)
    while not listing.over(now_s := time.monotonic()):
        for request in listing.requests(now_s):
            client.send(request)
        for frame in client.frames():
            if frame.message_id == LOG_ENTRY.message_id:
                listing.take(frame, time.monotonic())
    return Listing(_in_order([*listing.entries.values()]), max((listing.total or 0) - len(listing.entries), 0))


def finished(client: Client, before: Listing) -> tuple[Listing, list[LogEntry]]:
    """The logs that are not being written, and those that are: they grow from `before` to the list asked for now."""
    until_s = time.monotonic() + _GROWS_S
    while time.monotonic() < until_s:
        client.frames()
    sizes = {(entry.id, entry.path): entry.size_bytes for entry in before.entries}
    now = list_logs(client)
    growing = [entry for entry in now.entries if sizes.get((entry.id, entry.path)) != entry.size_bytes]
    return Listing([entry for entry in now.entries if entry not in growing], now.untold), growing


def fetch(client: Client, entry: LogEntry, folder: Path, on_progress: Callable[[int], None] = lambda _: None) -> Path:
    """One log into `folder`, from where its partial file ends. Returns the file, complete by size.

    `on_progress` is told the bytes on disk. Raises `LinkError` when the vehicle stops answering; what has come stays.
    """
    path, part = folder / entry.file_name, folder / f"{entry.file_name}.part"
    if path.exists() and path.stat().st_size == entry.size_bytes:
        return path
    try:
        folder.mkdir(parents=True, exist_ok=True)
        start = min(part.stat().st_size, entry.size_bytes) if part.exists() else 0
        with part.open("ab") as stream:
            stream.truncate(start)
            _download(client, entry, start, stream.write, on_progress)
        part.replace(path)
    except OSError as error:
        raise ConfigError(f"{error.filename or folder}: {error.strerror}") from None
    return path


def _in_order(entries: list[LogEntry]) -> list[LogEntry]:
    return sorted(entries, key=lambda entry: entry.order)


def _download(
    client: Client,
    entry: LogEntry,
    start: int,
    write: Callable[[bytes], object],
    on_progress: Callable[[int], None],
) -> None:
    """One log from `start` on, by what listed it."""
    if not entry.path:
        fetch = LogFetch(*client.vehicle, entry, start)
        try:
            _carry(client, fetch, write, on_progress)
        finally:
            client.send(fetch.end())
        return
    ftp = Ftp(client)
    session = ftp.open(entry.path)
    try:
        _carry(client, FtpRead(client.vehicle, client.ids, session, entry.size_bytes, start), write, on_progress)
    finally:
        ftp.close(session)


def _carry(
    client: Client,
    download: LogFetch | FtpRead,
    write: Callable[[bytes], object],
    on_progress: Callable[[int], None],
) -> None:
    on_progress(download.offset)
    while not download.done:
        now_s = time.monotonic()
        if download.stalled(now_s):
            raise LinkError(
                f"{client.name}: the vehicle stopped sending its log at byte {download.offset}; "
                "the same command goes on from there"
            )
        for request in download.requests(now_s):
            client.send(request)
        for frame in client.frames():
            if frame.message_id == download.message_id and (new := download.take(frame, time.monotonic())):
                write(new)
                on_progress(download.offset)
