"""The paper's experiment: the plant in one process, the flight process in this one, real sockets between them."""

from __future__ import annotations

import contextlib
import os
import select
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

from companion.config import Config
from companion.flight.authority import Reason
from companion.flight.process import FlightProcess
from companion.flight.runtime import Status, Summary
from companion.mavlink.link import open_link
from companion.record.folder import open_folder
from companion.record.reader import Flight, read_flight
from sitl.metrics import Metrics, score

_READY_S = 20.0


class ExperimentError(Exception):
    """The plant did not start, or the log is incomplete; the message is one line."""


class Outcome(NamedTuple):
    """One controller's flight."""

    controller: str
    folder: Path
    summary: Summary
    flight: Flight
    metrics: Metrics | None  # None when it was never in control
    realtime_factor: float  # flown time over wall time, the start included

    @property
    def complete(self) -> bool:
        """Whether the whole mission was flown."""
        return self.summary.reason is Reason.MISSION_COMPLETE and self.metrics is not None


@contextlib.contextmanager
def plant(
    config_path: Path, overrides: tuple[str, ...], *, lockstep: bool, port: int
) -> Iterator[tuple[int, subprocess.Popen[str]]]:
    """A plant in a process of its own; yields the UDP port it listens on, and the process. Raises `ExperimentError`."""
    arguments = [sys.executable, "-m", "companion", "sitl", str(config_path), "--serve", "--port", str(port)]
    arguments += ["--lockstep"] if lockstep else []
    for override in overrides:
        arguments += ["--set", override]
    # Unbuffered and in a session of its own: its first line tells the port, and Ctrl-C is ours to pass on.
    process = subprocess.Popen(
        arguments,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )
    assert process.stdout is not None
    assert process.stderr is not None
    try:
        ready, _, _ = select.select([process.stdout], [], [], _READY_S)
        line = process.stdout.readline() if ready else ""
        if "udp port" not in line:
            process.kill()
            complaint = process.stderr.read().strip().splitlines()
            raise ExperimentError(complaint[-1].removeprefix("companion: ") if complaint else "the plant did not start")
        yield int(line.rsplit(maxsplit=1)[-1]), process
    finally:
        process.terminate()
        try:
            process.wait(5.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        process.stdout.close()
        process.stderr.close()


@contextlib.contextmanager
def _sharing_a_core(plant_pid: int) -> Iterator[None]:
    """Plant and flight take turns in lockstep: handing over on one core costs half of waking up another."""
    before = os.sched_getaffinity(0)
    core = {max(before)}
    os.sched_setaffinity(plant_pid, core)
    os.sched_setaffinity(0, core)
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)


def fly(
    config: Config,
    config_path: Path,
    folder: Path,
    controller: str,
    *,
    overrides: tuple[str, ...] = (),
    lockstep: bool = True,
    port: int = 0,
    on_status: Callable[[Status], None] | None = None,
) -> Outcome:
    """Fly the config's mission with one controller, `hedged` or `standard`. Raises `ExperimentError` or `LinkError`."""
    with contextlib.ExitStack() as open_things:
        recorder = open_folder(folder, config_path, config, blocking=lockstep)
        open_things.callback(recorder.close)
        bound, process = open_things.enter_context(plant(config_path, overrides, lockstep=lockstep, port=port))
        link = open_link(f"udpout://127.0.0.1:{bound}")
        open_things.callback(link.close)
        if lockstep and hasattr(os, "sched_setaffinity"):
            open_things.enter_context(_sharing_a_core(process.pid))
        flight_process = FlightProcess(
            config,
            link,
            recorder,
            hedging=controller == "hedged",
            engage=True,
            lockstep=lockstep,
            on_status=on_status,
        )
        began_s = time.monotonic()
        summary = flight_process.run()
        wall_s = time.monotonic() - began_s
    complaint = recorder.close()
    if complaint is not None:
        raise ExperimentError(complaint)
    flight = read_flight(folder)
    ticks = flight.ticks
    flown_s = float(ticks["time_s"][-1] - ticks["time_s"][0]) if len(ticks) else 0.0
    try:
        metrics = score(config, flight)
    except ValueError:
        metrics = None
    return Outcome(controller, folder, summary, flight, metrics, flown_s / wall_s)
