"""What tools on the shared link cost the loop: `companion run` at 250 Hz in real time on the plant, asked meanwhile.

    python benchmarks/services.py [--seconds N] [--rounds N] [--json]

Per kind of question one flight, in which quiet and busy stretches take turns, so that the machine's noise hits both
alike. The time is from before the plant's send of an ODOMETRY to the kernel's stamp on the set-point that answers it:
what queues in front of the odometry counts, what the plant does meanwhile does not. Lost is an ODOMETRY without answer.
"""

from __future__ import annotations

import argparse
import json
import os
import socket
import statistics
import struct
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any, NamedTuple

from processes import Candidate, OtherWork
from pymavlink.dialects.v20 import development as mavlink
from rich.console import Console
from rich.table import Table
from service_tools import CONFIG, TOOLS, Inside, tool

import sitl.wire.server
from companion.config import load_config
from sitl.build import build_world
from sitl.messages.log_card import synthetic_log
from sitl.wire.ports import Endpoint, UdpEndpoint, UdpPort

HERE = Path(__file__).resolve().parent
RATE_HZ = 250.0
SETTINGS = (
    "tick.rate_hz=250",
    "tick.floor_hz=50",
    "mission.duration_s=100000",
    # a busy machine must show in the figures and not end the flight
    "guards.pose_age_s.limit=5",
    "guards.clock_jump_s.limit=5",
    *(f"guards.{name}.enabled=false" for name in ("tick_overrun_s", "pose_rate_hz", "link_delay_s", "link_jitter_s")),
    "guards.envelope.enabled=false",
)
QUICK = "plant.parameters={COM_SPOOLUP_TIME: 0.2, MPC_TKO_RAMP_T: 0.5, NAV_MC_ALT_RAD: 0.3, MIS_TAKEOFF_ALT: 1.0}"
INSIDE = "mavsdk inside"
_ODOMETRY = mavlink.MAVLINK_MSG_ID_ODOMETRY.to_bytes(3, "little")
_SETPOINT = mavlink.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET.to_bytes(3, "little")
_STAMP_NS = 35  # SO_TIMESTAMPNS
_SETTLE_S = 0.5


# -- the plant's port, with stamps -----------------------------------------------------------------------------------


class Stamps:
    """When each sample was sent and answered, ns of the wall clock, by its time in milliseconds."""

    def __init__(self) -> None:
        self.sent: dict[int, int] = {}
        self.answered: dict[int, int] = {}


class StampedPort(UdpPort):
    """A UDP port of the plant that notes when."""

    def __init__(self, endpoint: UdpEndpoint, stamps: Stamps) -> None:
        super().__init__(endpoint)
        self._stamps = stamps
        self._socket.setsockopt(socket.SOL_SOCKET, _STAMP_NS, 1)
        self._receive = self._stamped  # type: ignore[assignment]

    def _stamped(self, size: int, flags: int) -> tuple[bytes, Any]:
        data, ancillary, _, sender = self._socket.recvmsg(size, 64, flags)
        if data[7:10] == _SETPOINT:
            seconds, nanoseconds = struct.unpack("qq", ancillary[0][2][:16])
            self._stamps.answered.setdefault(int.from_bytes(data[10:14], "little"), seconds * 10**9 + nanoseconds)
        return data, sender

    def send(self, frames: list[bytes]) -> None:
        for frame in frames:
            if frame[7:10] == _ODOMETRY:
                stamp_us = int.from_bytes(frame[10:18], "little")
                self._stamps.sent[round(1e-3 * stamp_us) & 0xFFFFFFFF] = time.time_ns()
        super().send(frames)


# -- one flight --------------------------------------------------------------------------------------------------------


class Stretch(NamedTuple):
    """A part of a flight, ns of the wall clock."""

    busy: bool
    from_ns: int
    to_ns: int


def fly(kind: str, seconds: float, rounds: int, folder: Path) -> dict[str, Any]:
    """One flight with quiet and busy stretches in turn."""
    stamps, stop, ready = Stamps(), threading.Event(), threading.Event()
    config = load_config(CONFIG, (*SETTINGS, QUICK))
    port: list[int] = []

    def open_stamped(endpoint: Endpoint) -> UdpPort:
        assert isinstance(endpoint, UdpEndpoint)
        return StampedPort(endpoint, stamps)

    sitl.wire.server.open_port = open_stamped
    results: dict[str, Any] = {}

    def direct() -> None:
        try:
            ready.wait()
            results.update(_direct(kind, f"udpout://127.0.0.1:{port[0]}", seconds, rounds, folder))
        except Exception as error:
            results["failure"] = error
        finally:
            stop.set()

    director = threading.Thread(target=direct)
    director.start()
    sitl.wire.server.serve(
        build_world(config).autopilot,
        [UdpEndpoint(0, 9)],
        stop=stop.is_set,
        on_ready=lambda number: (port.append(number), ready.set()),
        logs=[synthetic_log(4_000_000, 1)],
    )
    director.join()
    if "failure" in results:
        raise RuntimeError(f"{kind}: the flight failed") from results["failure"]
    return figures(results, stamps)


def _direct(kind: str, url: str, seconds: float, rounds: int, folder: Path) -> dict[str, Any]:
    """Fly, ask, be quiet, and so on; then end it as an operator does."""
    busy = folder / "busy"
    environment = {**os.environ, "XDG_RUNTIME_DIR": str(folder), "SERVICES_BUSY": str(busy)}
    os.environ.update(environment)
    how = [str(HERE / "services.py"), "--inside"] if kind == INSIDE else ["-m", "companion"]
    settings = [part for text in SETTINGS for part in ("--set", text)]
    run = ["run", str(CONFIG), "--link", url, "--engage", "--uncertified", "--out", str(folder / "flights"), *settings]
    candidate = Candidate([sys.executable, *how, *run], "engaged", folder / "output")
    try:
        until_s = time.monotonic() + 60.0
        while not candidate.is_ready():
            time.sleep(0.1)
            if time.monotonic() > until_s:
                raise RuntimeError(candidate.output())
        stretches, answers = [], []
        for _ in range(rounds):
            time.sleep(_SETTLE_S)
            stretches.append(_stretch(False, seconds))
            if kind == INSIDE:
                busy.touch()
                time.sleep(_SETTLE_S)
                stretches.append(_stretch(True, seconds))
                busy.unlink()
                continue
            command = [sys.executable, str(HERE / "services.py"), "--tool", kind, url, str(seconds + 2 * _SETTLE_S)]
            with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
                assert process.stdout is not None
                if process.stdout.readline().strip() != "ready":
                    raise RuntimeError(f"{kind}: no way in: {candidate.output().strip()}")
                time.sleep(_SETTLE_S)
                stretches.append(_stretch(True, seconds))
                answers.append(json.loads(process.stdout.readline()))
        candidate.is_ready()  # or it has ended meanwhile
        candidate.process.terminate()
        candidate.ends(10.0)
    finally:
        candidate.kill()
    return {"stretches": stretches, "answers": answers}


def _stretch(busy: bool, seconds: float) -> Stretch:
    began_ns = time.time_ns()
    time.sleep(seconds)
    return Stretch(busy, began_ns, time.time_ns())


def figures(results: dict[str, Any], stamps: Stamps) -> dict[str, Any]:
    """Latencies of quiet and busy stretches, and what was lost.

    A ratio is the median over the rounds of busy to the quiet just before it: the machine's other work, which comes and
    goes, falls out of it.
    """
    told: dict[str, Any] = {"quiet": _Told(), "busy": _Told()}
    for stretch in results["stretches"]:
        sent = {ms: at for ms, at in stamps.sent.items() if stretch.from_ns <= at < stretch.to_ns}
        latencies = [1e-3 * (stamps.answered[ms] - at) for ms, at in sent.items() if ms in stamps.answered]
        told["busy" if stretch.busy else "quiet"].add(latencies, len(sent) - len(latencies))
    quiet, busy = told["quiet"], told["busy"]
    told = {"quiet": quiet.row(), "busy": busy.row()}
    for name in ("median", "p99"):
        before, meanwhile = getattr(quiet, name), getattr(busy, name)
        ratios = [b / q for q, b in zip(before, meanwhile, strict=True)]
        told[f"{name}_ratio"] = round(statistics.median(ratios), 2)
    for answer in results["answers"]:
        for key, value in answer.items():
            told[key] = value if isinstance(value, bool) else told.get(key, 0) + value
    return told


class _Told:
    """Some stretches of one sort."""

    def __init__(self) -> None:
        self.median: list[float] = []
        self.p99: list[float] = []
        self.all: list[float] = []
        self.lost = 0

    def add(self, latencies_us: list[float], lost: int) -> None:
        self.median.append(statistics.median(latencies_us))
        self.p99.append(statistics.quantiles(latencies_us, n=100)[98])
        self.all += latencies_us
        self.lost += lost

    def row(self) -> dict[str, Any]:
        return {
            "median_us": round(statistics.median(self.all), 1),
            "p99_us": round(statistics.quantiles(self.all, n=100)[98], 1),
            "samples": len(self.all),
            "lost": self.lost,
        }


def table(rows: dict[str, dict[str, Any]], seconds: float, others_percent: float) -> Table:
    shown = Table(title="Odometry out of the plant to set-point back, 250 Hz")
    columns = ("asked", "quiet µs", "asked µs", "÷", "p99 ÷", "ticks", "lost", "got")
    for column in columns:
        shown.add_column(column, justify="left" if column in ("asked", "got") else "right", no_wrap=True)
    for name, row in rows.items():
        quiet, busy = row["quiet"], row["busy"]
        got = f"{row['parameters'] / seconds:.0f} /s " if "parameters" in row else ""
        got += f"{1e-3 * row['log_bytes'] / seconds:.0f} kB/s" if "log_bytes" in row else ""
        ratios = (f"{row['median_ratio']:.2f}", f"{row['p99_ratio']:.2f}")
        counts = (str(quiet["samples"] + busy["samples"]), str(quiet["lost"] + busy["lost"]))
        shown.add_row(name, f"{quiet['median_us']:.0f}", f"{busy['median_us']:.0f}", *ratios, *counts, got)
    shown.caption = f"Other work, the tools' included, took {others_percent:.0f} % of the machine."
    return shown


def main() -> None:
    if sys.argv[1:2] == ["--tool"]:
        tool(sys.argv[2], sys.argv[3], float(sys.argv[4]))
        return
    if sys.argv[1:2] == ["--inside"]:
        from companion import cli  # noqa: PLC0415
        from companion.commands import run as command  # noqa: PLC0415

        command.ToolServer = Inside  # type: ignore[assignment,misc]
        cli.main(sys.argv[2:])
    parser = argparse.ArgumentParser(description="What tools on the shared link cost the loop.")
    parser.add_argument("--seconds", type=float, default=4.0, help="of each stretch (default: 4)")
    parser.add_argument("--rounds", type=int, default=6, help="quiet and busy stretches of each flight (default: 6)")
    parser.add_argument("--only", action="append", metavar="NAME", help="kinds whose name contains this")
    parser.add_argument("--json", action="store_true", help="one JSON object on stdout and nothing else")
    arguments = parser.parse_args()
    rows, others = {}, OtherWork()
    for kind in (*TOOLS, INSIDE):
        if arguments.only and not any(part in kind for part in arguments.only):
            continue
        with tempfile.TemporaryDirectory() as name:
            Path(name).chmod(0o700)
            rows[kind] = fly(kind, arguments.seconds, arguments.rounds, Path(name))
    if arguments.json:
        print(json.dumps({"rate_hz": RATE_HZ, "other_work_percent": others.percent(), "kinds": rows}))
    else:
        tool_s = arguments.rounds * (arguments.seconds + 2 * _SETTLE_S)
        console = Console()
        console.width = max(console.width, 96)
        console.print(table(rows, tool_s, others.percent()))


if __name__ == "__main__":
    main()
