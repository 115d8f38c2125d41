"""`companion logs`: list the vehicle's logs, fetch those that are not here yet, go on where it broke off, check them.

A log on its way is NAME.part. It only ever grows by what follows without a gap, so that it is right as far as it goes.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, DownloadColumn, Progress, TextColumn, TimeRemainingColumn, TransferSpeedColumn
from rich.table import Table

from companion.config import Config, ConfigError
from companion.mavlink import ulog
from companion.mavlink.client import Client
from companion.mavlink.link import LinkError
from companion.mavlink.log_protocol import LOG_DATA, LOG_ENTRY, LogEntry, LogFetch, LogList


def logs(config: Config, arguments: argparse.Namespace) -> int:
    """List, or fetch. 0 when everything asked for is here and whole, else 1. Raises `LinkError` without a vehicle."""
    console = Console()
    client = Client(config, arguments.link)
    try:
        with console.status("waiting for the vehicle"):
            client.connect()
            client.give_way()
            entries = list_logs(client)
        if not entries:
            console.print("the vehicle told of no logs: its card is empty or missing, or it is still starting")
            return 1
        if arguments.list:
            console.print(_table(entries, arguments.out))
            return 0
        wanted = [newest(entries)] if arguments.latest else entries
        if client.armed:
            console.print("[yellow]armed: the newest log is being written, and ends where it was when listed[/yellow]")
        results = [_fetch_shown(client, entry, arguments.out, console) for entry in wanted if entry.size_bytes]
        return 0 if all(results) else 1
    finally:
        client.close()


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


def _fetch_shown(client: Client, entry: LogEntry, folder: Path, console: Console) -> bool:
    """Fetch with a bar, check, and say so; whether the log is whole."""
    columns = (TextColumn("{task.description}"), BarColumn(), DownloadColumn(), TransferSpeedColumn())
    with Progress(*columns, TimeRemainingColumn(), console=console, transient=True) as progress:
        task = progress.add_task(entry.file_name, total=entry.size_bytes)
        path = fetch(client, entry, folder, lambda done: progress.update(task, completed=done))
    try:
        extent = ulog.extent(path)
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror}") from None
    if extent.problem is None:
        console.print(f"{path}: whole, {extent.size_bytes} bytes, {extent.messages} messages", soft_wrap=True)
        return True
    console.print(f"[yellow]{path}: {extent.size_bytes} bytes as listed, but {extent.problem}[/yellow]", soft_wrap=True)
    return False


def _table(entries: list[LogEntry], folder: Path) -> Table:
    table = Table(title="logs on the vehicle", title_justify="left")
    for column in ("id", "written (UTC)", "bytes", "here"):
        table.add_column(column, justify="right" if column in ("id", "bytes") else "left")
    for entry in entries:
        part = folder / f"{entry.file_name}.part"
        if (folder / entry.file_name).exists():
            here = "yes"
        else:
            here = f"{part.stat().st_size / max(entry.size_bytes, 1):.0%}" if part.exists() else "no"
        written = (
            f"{datetime.fromtimestamp(entry.time_utc_s, UTC):%Y-%m-%d %H:%M:%S}" if entry.time_utc_s else "unknown"
        )
        table.add_row(str(entry.id), written, str(entry.size_bytes), here)
    return table
