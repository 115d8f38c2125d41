"""Telemetry datagram in to set-point datagram out, of the whole process as a user runs it, beside four echoes.

    python benchmarks/loop_latency.py [--config FILE] [--seconds N] [--json]

`companion run` decodes, controls, checks, records to disk and encodes; the echoes only decode and encode (the C one not
even that). Each candidate runs alone; all are run in turn, in several rounds, so that the machine's noise hits all
alike. The time is from before the driver's send to after its receive, which adds the same wake-up to every candidate.
CPU, too, is worth its ratio only: the `struct` echo is the least that Python takes on the machine at hand.
"""

from __future__ import annotations

import argparse
import gc
import json
import re
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from autopilot import BY_ECHO, BY_THRUST, BY_TIME, Answer, Autopilot
from baseline import checkout
from harness.ports import free_port
from processes import Candidate, OtherWork
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from companion.mavlink.px4 import Mode

HERE = Path(__file__).resolve().parent
ECHO = HERE / "echo"
FLOOR, LEAST, RIVAL, OURS = "C echo", "Python struct", "mavsdk callback", "companion run"
_READY_S = 60.0
_WARM_UP_S = 0.5
_SETTINGS = (
    "tick.rate_hz=250",
    "tick.floor_hz=50",
    "mission.duration_s=100000",  # a mission that outlasts the run
    # every guard looks, but a busy machine must show in the figures and not end the flight
    "guards.pose_age_s.limit=5",
    "guards.link_jitter_s.limit=5",
    "guards.clock_jump_s.limit=1",
)


class Kind(NamedTuple):
    """A candidate: its command, but for the port; the line it prints when it answers; how its answers are known."""

    name: str
    command: tuple[str, ...]
    ready: str
    answer: Answer


class Result:
    """What one candidate did at one rate, over all rounds."""

    def __init__(self) -> None:
        self.latencies_us: list[float] = []
        self.round_medians_us: list[float] = []
        self.lost = 0
        self.own_s = self.tree_s = self.wall_s = 0.0

    @property
    def median_us(self) -> float:
        return statistics.median(self.latencies_us)

    @property
    def cpu_percent(self) -> float:
        """Of one core, with the processes it started."""
        return 100.0 * self.tree_s / self.wall_s

    def row(self, floor: Result | None, least: Result | None, rival: Result | None) -> dict[str, Any]:
        return {
            "median_us": round(self.median_us, 1),
            "p99_us": round(statistics.quantiles(self.latencies_us, n=100)[98], 1),
            "cpu_percent": round(self.cpu_percent, 2),
            "cpu_percent_without_children": round(100.0 * self.own_s / self.wall_s, 2),
            "ratio_to_c_echo": None if floor is None else round(self.median_us / floor.median_us, 2),
            "ratio_to_mavsdk": None if rival is None else round(self.median_us / rival.median_us, 2),
            "cpu_ratio_to_struct": None if least is None else round(self.cpu_percent / least.cpu_percent, 2),
            "cpu_ratio_to_mavsdk": None if rival is None else round(self.cpu_percent / rival.cpu_percent, 2),
            "samples": len(self.latencies_us),
            "lost": self.lost,
            "round_medians_us": [round(median, 1) for median in self.round_medians_us],
        }


def kinds(config: Path, overrides: list[str], folder: Path, baseline: Path | None) -> list[Kind]:
    """The candidates; the C echo only where there is a compiler. `baseline`: an older checkout, one more of them."""
    found = []
    if compiler := shutil.which("cc"):
        subprocess.run([compiler, "-O2", "-o", str(folder / "echo"), str(ECHO / "echo.c")], check=True)
        found.append(Kind(FLOOR, (str(folder / "echo"), "{port}"), "ready", BY_ECHO))
    settings = [part for text in (*_SETTINGS, *overrides) for part in ("--set", text)]
    run = (
        "-m",
        "companion",
        "run",
        "--uncertified",  # the shipped certificate is for the paper's own tick rate
        str(config),
        "--link",
        "udpin://127.0.0.1:{port}",
        "--out",
        str(folder / "flights"),
    )
    if baseline is not None:
        older = ("env", f"--chdir={baseline}", f"PYTHONPATH={baseline}", sys.executable)
        found.append(Kind(f"{OURS}, baseline", (*older, *run, *settings), "engaged", BY_TIME))
    return [
        *found,
        Kind(OURS, (sys.executable, *run, *settings), "engaged", BY_TIME),
        Kind(LEAST, (sys.executable, str(ECHO / "echo_struct.py"), "{port}"), "ready", BY_THRUST),
        Kind("pymavlink mavutil", (sys.executable, str(ECHO / "echo_mavutil.py"), "{port}"), "ready", BY_THRUST),
        Kind(RIVAL, (sys.executable, str(ECHO / "echo_mavsdk.py"), "{port}"), "ready", BY_THRUST),
    ]


def run_once(kind: Kind, rates_hz: list[float], seconds: float, folder: Path, results: dict[float, Result]) -> None:
    """Start a candidate, bring it to where it answers, measure it at every rate, end it."""
    port = free_port()
    candidate = Candidate([part.format(port=port) for part in kind.command], kind.ready, folder / "output")
    autopilot = Autopilot(port)
    try:
        until_s = time.monotonic() + _READY_S
        while not candidate.is_ready():
            autopilot.play(rates_hz[0], 0.1)
            if time.monotonic() > until_s:
                raise RuntimeError(f"{kind.name} not ready within {_READY_S:g} s: {candidate.output().strip()}")
        answered = 0
        for rate_hz in rates_hz:
            autopilot.play(rate_hz, _WARM_UP_S)
            (own_s, tree_s), began_s = candidate.cpu_s(), time.monotonic()
            with quiet_memory():
                timing = autopilot.time(rate_hz, seconds, kind.answer)
            (own_end_s, tree_end_s), ended_s = candidate.cpu_s(), time.monotonic()
            candidate.is_ready()  # or it has ended meanwhile
            if not timing.latencies_us:
                raise RuntimeError(f"{kind.name} answered nothing at {rate_hz:g} Hz: {candidate.output().strip()}")
            result = results[rate_hz]
            result.latencies_us += timing.latencies_us
            result.round_medians_us.append(statistics.median(timing.latencies_us))
            result.lost += timing.lost
            result.own_s += own_end_s - own_s
            result.tree_s += tree_end_s - tree_s
            result.wall_s += ended_s - began_s
            answered += len(timing.latencies_us)
        if kind.name == OURS:
            land(candidate, autopilot, kind, answered)
    finally:
        autopilot.close()
        candidate.kill()


def land(candidate: Candidate, autopilot: Autopilot, kind: Kind, answered: int) -> None:
    """End the flight as a pilot does, and see that it was one: in control throughout, every tick on disk."""
    autopilot.mode = Mode.HOLD
    autopilot.play(100.0, 0.2)
    ended = candidate.ends(60.0)
    said = candidate.output()
    ticks = re.search(r"in control for .* (\d+) ticks", said)
    if not ended or candidate.process.returncode != 0 or ticks is None or int(ticks[1]) < answered:
        raise RuntimeError(f"{kind.name} did not fly to the end: {said.strip()}")


@contextmanager
def quiet_memory() -> Iterator[None]:
    """No collection of garbage in the driver while it measures."""
    gc.collect()
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


def table(rows: dict[float, dict[str, dict[str, Any]]], others_percent: float) -> Table:
    shown = Table(title="Telemetry in to set-point out, µs")
    columns = ("candidate", "Hz", "median", "p99", "÷ C", "÷ mavsdk", "CPU %", "÷ struct")
    for column in columns:
        shown.add_column(column, justify="left" if column == "candidate" else "right", no_wrap=True)
    keys = ("ratio_to_c_echo", "ratio_to_mavsdk", "cpu_percent", "cpu_ratio_to_struct")
    for rate_hz, candidates in rows.items():
        for name, row in candidates.items():
            cells = ("-" if row[key] is None else f"{row[key]:.2f}" for key in keys)
            times = (f"{row['median_us']:.0f}", f"{row['p99_us']:.0f}")
            shown.add_row(name, f"{rate_hz:g}", *times, *cells)
        shown.add_section()
    shown.caption = (
        "CPU: of one core, with the log writer, and as a ratio. "
        f"Other work took {others_percent:.0f} % of the machine: it cools caches, and raises every figure."
    )
    return shown


def main() -> None:
    parser = argparse.ArgumentParser(description="Latency of the control loop, beside four echoes.")
    parser.add_argument("--config", type=Path, default=HERE.parent / "config" / "paper_quadrotor.yaml")
    parser.add_argument("--set", dest="overrides", metavar="KEY=VALUE", action="append", default=[])
    parser.add_argument("--rates", type=float, nargs="+", metavar="HZ", default=[250.0, 100.0])
    parser.add_argument("--seconds", type=float, default=10.0, help="measured, per candidate and rate (default: 10)")
    parser.add_argument("--rounds", type=int, default=4, help="how many turns that time is split into (default: 4)")
    parser.add_argument(
        "--baseline", type=checkout, metavar="DIR", help="an older checkout of this project, flown beside it"
    )
    parser.add_argument("--only", action="append", metavar="NAME", help="candidates whose name contains this")
    parser.add_argument("--json", action="store_true", help="one JSON object on stdout and nothing else")
    arguments = parser.parse_args()

    console = Console(stderr=True)  # its progress bar has no thread: nothing runs beside the driver
    with (
        tempfile.TemporaryDirectory() as name,
        Progress(console=console, transient=True, auto_refresh=False) as progress,
    ):
        folder = Path(name)
        chosen = [
            kind
            for kind in kinds(arguments.config, arguments.overrides, folder, arguments.baseline)
            if not arguments.only or any(part in kind.name for part in arguments.only)
        ]
        results = {kind.name: {rate: Result() for rate in arguments.rates} for kind in chosen}
        others = OtherWork()
        task = progress.add_task("", total=arguments.rounds * len(chosen))
        for _ in range(arguments.rounds):
            for kind in chosen:
                run_once(kind, arguments.rates, arguments.seconds / arguments.rounds, folder, results[kind.name])
                progress.update(task, advance=1, description=kind.name, refresh=True)
        others_percent = others.percent()
    rows = {}
    for rate in arguments.rates:
        reference = [results[name][rate] if name in results else None for name in (FLOOR, LEAST, RIVAL)]
        rows[rate] = {name: by_rate[rate].row(*reference) for name, by_rate in results.items()}
    if arguments.json:
        by_rate = {f"{rate:g}": rows[rate] for rate in rows}
        print(json.dumps({"config": arguments.config.name, "other_work_percent": others_percent, "rates_hz": by_rate}))
    else:
        Console().print(table(rows, others_percent))


if __name__ == "__main__":
    main()
