"""A tool fetches the vehicle's logs: list them, go on with one where it broke off, be sure of every byte.

A log on its way is NAME.part. It only ever grows by what follows without a gap, so that it is right as far as it goes.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

from companion.config import ConfigError
from companion.mavlink.client import Client
from companion.mavlink.link import LinkError
from companion.mavlink.log_protocol import LOG_DATA, LOG_ENTRY, LogEntry, LogFetch, LogList


def newest(entries: list[LogEntry]) -> LogEntry:
    """By time of writing; where the vehicle did not know the time, the last in its list."""
    return max(entries, key=lambda entry: (entry.time_utc_s, entry.id))


def list_logs(client: Client) -> list[LogEntry]:
    """All logs of the vehicle, oldest first. Raises `LinkError` when a list has begun and does not come to its end."""
    listing = LogList(*client.vehicle)
    while not listing.over(now_s := time.monotonic()):
        for request in listing.requests(now_s):
            client.send(request)
        for frame in client.frames():
            if frame.message_id == LOG_ENTRY.message_id:
                listing.take(frame, time.monotonic())
    if not listing.done and listing.total:
        raise LinkError(f"{client.name}: {len(listing.entries)} of {listing.total} logs told, then silence")
    return sorted(listing.entries.values(), key=lambda entry: (entry.time_utc_s, entry.id))


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
        download = LogFetch(*client.vehicle, entry, start)
        with part.open("ab") as stream:
            stream.truncate(start)
            try:
                _carry(client, download, stream.write, on_progress)
            finally:
                client.send(download.end())
        part.replace(path)
    except OSError as error:
        raise ConfigError(f"{error.filename or folder}: {error.strerror}") from None
    return path


def _carry(
    client: Client, download: LogFetch, write: Callable[[bytes], object], on_progress: Callable[[int], None]
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
            if frame.message_id == LOG_DATA.message_id and (new := download.take(frame, time.monotonic())):
                write(new)
                on_progress(download.offset)
