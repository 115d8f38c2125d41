"""Does it leak? One long flight, then many short ones, in virtual time: memory and descriptors of the process.

    python benchmarks/endurance.py [--hours 1] [--rate-hz 250] [--flights 200] [--json]

The long flight goes by the companion's own clock, as on a vehicle: its mission is stairs that go on for ever. The short
ones begin with `--engage` and are released in turn by their end, by the operator and by a loop that hangs for a moment.
Plant and companion are one program, so what either keeps shows; each flight writes its log by a process of its own.

Flat is: no descriptor and no thread more at the end than after a tenth of the way, and no more than 2 MB of memory
and 2 % of allocated blocks. Exit code 1 where it is not.
"""

from __future__ import annotations

import argparse
import gc
import json
import os
import resource
import shutil
import sys
import tempfile
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from rich.console import Console
from rich.table import Table

from companion.config import Config, load_config
from companion.flight.authority.states import Reason
from companion.flight.host.runtime import Status
from companion.flight.process import FlightProcess
from companion.record.folder import open_folder
from sitl.build import build_world
from sitl.wire.memory import OwnClockLink

RIG = Path(__file__).resolve().parents[1] / "config" / "antx_rig.yaml"
MOST_MB, MOST_BLOCKS = 2.0, 0.02
_ROWS = 12
_PAGE_MB = resource.getpagesize() / 1e6
ENDINGS = (Reason.MISSION_COMPLETE, Reason.OPERATOR, Reason.TICK_OVERRUN)


class Row(NamedTuple):
    """What the process holds at one time."""

    at: str
    memory_mb: float
    blocks: int
    descriptors: int
    threads: int


def row(at: str) -> Row:
    """Now. What is merely waiting to be collected counts: in flight nobody collects."""
    resident = int(Path("/proc/self/statm").read_text().split()[1]) * _PAGE_MB
    descriptors = len(os.listdir("/proc/self/fd")) - 1
    return Row(at, resident, sys.getallocatedblocks(), descriptors, threading.active_count())


def fly(config: Config, folder: Path, ending: Reason, on_status: Callable[[Status], None]) -> Reason:
    """One flight, ended so after a second in control where it does not end by itself."""
    recorder = open_folder(folder, RIG, config, blocking=True)
    link = OwnClockLink(build_world(config).autopilot)

    def watch(status: Status) -> None:
        on_status(status)
        if status.elapsed_s > 1.0 and ending is Reason.OPERATOR:
            process.stop()
        if status.elapsed_s > 1.0 and ending is Reason.TICK_OVERRUN:
            link.sleep(0.4)

    process = FlightProcess(config, link, recorder, engage=True, on_status=watch, wall=link.wall)
    try:
        return process.run().reason
    finally:
        complaint = recorder.close()
        if complaint is not None:
            sys.exit(complaint)


def long_flight(hours: float, rate_hz: float, folder: Path) -> list[Row]:
    """Rows over one flight; the first when a tenth of it is over."""
    seconds = 3600.0 * hours
    stairs = ", ".join(
        f"{{at_s: {at}, offset_ned_m: [{0.35 * (n % 2)}, 0, 0]}}" for n, at in enumerate(range(1, int(seconds), 10), 1)
    )
    config = load_config(
        RIG,
        (
            f"tick.rate_hz={rate_hz:g}",
            f"tick.floor_hz={0.8 * rate_hz:g}",
            f"mission.duration_s={seconds:g}",
            f"mission.waypoints=[{stairs}]",
        ),
    )
    rows: list[Row] = []
    due_s = 0.1 * seconds

    def on_status(status: Status) -> None:
        nonlocal due_s
        if status.elapsed_s >= due_s:
            due_s += 0.9 * seconds / _ROWS
            rows.append(row(f"{status.elapsed_s / 60.0:.1f} min"))

    reason = fly(config, folder, Reason.MISSION_COMPLETE, on_status)
    if reason is not Reason.MISSION_COMPLETE:
        sys.exit(f"the long flight ended: {reason.value}")
    return [*rows, row("the end")]


def short_flights(count: int, folder: Path) -> list[Row]:
    """Rows over many flights; the first when a tenth of them is over."""
    config = load_config(RIG, ("tick.rate_hz=100", "tick.floor_hz=80", "mission.duration_s=2", "mission.waypoints=[]"))
    rows = []
    for number in range(count):
        ending = ENDINGS[number % len(ENDINGS)]
        reason = fly(config, folder / "flight", ending, lambda _: None)
        if reason is not ending:
            sys.exit(f"flight {number} ended: {reason.value} instead of {ending.value}")
        shutil.rmtree(folder / "flight")
        if number + 1 >= 0.1 * count and (number + 1) % max(1, count // _ROWS) == 0:
            gc.collect()  # between flights somebody does
            rows.append(row(f"{number + 1} flights"))
    return rows


def growth(rows: list[Row]) -> dict[str, float]:
    """From the first row to the last."""
    first, last = rows[0], rows[-1]
    return {
        "memory_mb": last.memory_mb - first.memory_mb,
        "blocks": last.blocks / first.blocks - 1.0,
        "descriptors": last.descriptors - first.descriptors,
        "threads": last.threads - first.threads,
    }


def flat(rows: list[Row]) -> bool:
    """Whether nothing has grown by more than its bound."""
    grown = growth(rows)
    return (
        grown["memory_mb"] <= MOST_MB
        and grown["blocks"] <= MOST_BLOCKS
        and grown["descriptors"] <= 0
        and grown["threads"] <= 0
    )


def show(title: str, rows: list[Row], console: Console) -> None:
    table = Table(title=title)
    for heading in ("after", "memory [MB]", "allocated blocks", "descriptors", "threads"):
        table.add_column(heading, justify="right")
    for at, memory_mb, *numbers in rows:
        table.add_row(at, f"{memory_mb:.1f}", *map(str, numbers))
    console.print(table)
    grown = growth(rows)
    console.print(
        f"{'flat' if flat(rows) else 'NOT FLAT'}: {grown['memory_mb']:+.2f} MB, {100 * grown['blocks']:+.2f} % blocks, "
        f"{grown['descriptors']:+.0f} descriptors, {grown['threads']:+.0f} threads"
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hours", type=float, default=1.0, help="of the long flight")
    parser.add_argument("--rate-hz", type=float, default=250.0, help="of its ticks")
    parser.add_argument("--flights", type=int, default=200, help="how many short ones")
    parser.add_argument("--json", action="store_true", help="one JSON object and nothing else")
    arguments = parser.parse_args()
    console = Console(stderr=arguments.json)
    tables: dict[str, list[Row]] = {}
    with tempfile.TemporaryDirectory() as name:
        if arguments.flights:
            tables[f"{arguments.flights} engagements and releases"] = short_flights(arguments.flights, Path(name))
        if arguments.hours:
            title = f"{arguments.hours:g} h in control at {arguments.rate_hz:g} Hz"
            tables[title] = long_flight(arguments.hours, arguments.rate_hz, Path(name) / "long")
    if arguments.json:
        report: dict[str, Any] = {
            title: {"flat": flat(rows), "rows": [r._asdict() for r in rows]} for title, rows in tables.items()
        }
        print(json.dumps(report))
    else:
        for title, rows in tables.items():
            show(title, rows, console)
    return 0 if all(map(flat, tables.values())) else 1


if __name__ == "__main__":
    sys.exit(main())
