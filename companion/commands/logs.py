"""`companion logs`: list the vehicle's logs, fetch those not here yet, go on where it broke off, check them."""

from __future__ import annotations

import argparse
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

from rich.console import Console
from rich.progress import BarColumn, DownloadColumn, Progress, TextColumn, TimeRemainingColumn, TransferSpeedColumn
from rich.table import Table

from companion.commands.options import ConfigFile, add_config, add_tool_link, config_file
from companion.config import ConfigError
from companion.errors import printable
from companion.mavlink.client import Client
from companion.mavlink.logs import ulog
from companion.mavlink.logs.client import Listing, fetch, finished, list_logs, newest
from companion.mavlink.logs.protocol import LogEntry


class Arguments(NamedTuple):
    """Of `companion logs`."""

    config: ConfigFile
    link: str | None
    list: bool
    latest: bool
    out: Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `companion logs`."""
    add_config(parser)
    add_tool_link(parser)
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--list", action="store_true", help="only list them")
    which.add_argument(
        "--latest", action="store_true", help="only the newest that is finished; default: all that are not here yet"
    )
    parser.add_argument("--out", type=Path, default=Path("logs"), help="folder for the logs (default: logs)")


def parse(namespace: argparse.Namespace) -> Arguments:
    """The arguments as a typed record."""
    return Arguments(config_file(namespace), namespace.link, namespace.list, namespace.latest, namespace.out)


def run(arguments: Arguments) -> int:
    """List, or fetch what is not being written. 0 when everything asked for is here and whole, else 1.

    Raises `LinkError` without a vehicle.
    """
    console = Console()
    client = Client(arguments.config.load(), arguments.link)
    try:
        with console.status("waiting for the vehicle"):
            client.connect()
            client.give_way()
        with console.status("asking for the list: a slow card takes its time"):
            listing, growing = list_logs(client), list[LogEntry]()
            if client.armed and listing.entries and not arguments.list:
                listing, growing = finished(client, listing)
        if not listing.entries and not growing:
            console.print(
                "the vehicle told of no logs: its card is empty or missing, or it is still starting", soft_wrap=True
            )
            return 1
        if listing.untold:
            _warn(
                console, f"the vehicle counts {listing.untold} logs more than it lists: ask again, or look at its card"
            )
        if arguments.list:
            console.print(_table(listing.entries, arguments.out))
            return 1 if listing.untold else 0
        for entry in growing:
            _warn(
                console, f"log {entry.id} is being written, {entry.size_bytes} bytes so far: not fetched before it ends"
            )
        results = [
            _fetch_shown(client, entry, arguments.out, console) for entry in _wanted(listing, arguments, console)
        ]
        return 0 if results and all(results) and not listing.untold else 1
    finally:
        client.close()


def _wanted(listing: Listing, arguments: Arguments, console: Console) -> list[LogEntry]:
    """What was asked for, of the logs that have anything in them."""
    entries = [entry for entry in listing.entries if entry.size_bytes]
    if not arguments.latest:
        return entries
    latest = newest(entries)
    if len(latest) > 1:
        _warn(console, "some logs have no time, as flights without GPS: which one is the newest, the vehicle cannot "
                       "tell; the last of these is fetched, and the newest of the others")  # fmt: skip
    return latest


def _warn(console: Console, line: str) -> None:
    console.print(f"[yellow]{line}[/yellow]", soft_wrap=True, highlight=False)


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
    path_shown = printable(str(path))
    if extent.problem is None:
        console.print(f"{path_shown}: whole, {extent.size_bytes} bytes, {extent.messages} messages", soft_wrap=True)
        return True
    console.print(
        f"[yellow]{path_shown}: {extent.size_bytes} bytes as listed, but {extent.problem}[/yellow]", soft_wrap=True
    )
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
        written = f"{datetime.fromtimestamp(entry.time_utc_s, UTC):%Y-%m-%d %H:%M:%S}" if entry.dated else "unknown"
        table.add_row(str(entry.id), written, str(entry.size_bytes), here)
    return table
