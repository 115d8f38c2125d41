"""The paper's experiment: the plant in one process, the flight process in this one, real sockets between them."""

from __future__ import annotations

import contextlib
import os
import queue
import select
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from multiprocessing.queues import Queue
from pathlib import Path
from typing import NamedTuple

from companion.config import Config
from companion.errors import CompanionError
from companion.flight.authority.states import Reason
from companion.flight.host.runtime import Status, Summary, stop_signals
from companion.flight.process import FlightProcess
from companion.mavlink.link import open_link
from companion.processes import end_with_parent
from companion.record.folder import open_folder
from companion.record.reader import Flight, read_flight
from companion.safe_path import child_environment, python_command
from sitl.metrics import Metrics, score

_READY_S = 20.0
_REFRESH_S = 0.25  # a progress report costs as long as ten ticks


class ExperimentError(CompanionError):
    """The plant did not start, or the log is incomplete; the message is one line."""


class Job(NamedTuple):
    """One controller's flight, as handed to a process of its own."""

    config: Config
    config_path: Path
    folder: Path
    controller: str  # `hedged` or `standard`
    overrides: tuple[str, ...]
    lockstep: bool
    port: int
    core: int | None  # in lockstep: the core that plant and flight share


class Outcome(NamedTuple):
    """How it went."""

    controller: str
    folder: Path
    summary: Summary
    flight: Flight
    metrics: Metrics | None  # None when it was never in control
    flown_s: float  # of the plant's time, from the first odometry on
    wall_s: float

    @property
    def complete(self) -> bool:
        """Whether the whole mission was flown."""
        return self.summary.reason is Reason.MISSION_COMPLETE and self.metrics is not None


@contextlib.contextmanager
def plant(
    config_path: Path, overrides: tuple[str, ...], *, lockstep: bool, port: int
) -> Iterator[tuple[int, subprocess.Popen[str]]]:
    """A plant in a process of its own; yields the UDP port it listens on, and the process. Raises `ExperimentError`."""
    arguments = python_command("companion", "sitl", str(config_path), "--serve", "--port", str(port))
    arguments += ["--end-with-input"]
    arguments += ["--lockstep"] if lockstep else []
    for override in overrides:
        arguments += ["--set", override]
    # Unbuffered and in a session of its own: its first line tells the port, and Ctrl-C is ours to pass on.
    process = subprocess.Popen(
        arguments,
        stdin=subprocess.PIPE,  # it ends with us, even where we are killed
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        env={**child_environment(), "PYTHONUNBUFFERED": "1"},
    )
    assert process.stdin is not None
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
        process.stdin.close()
        process.stdout.close()
        process.stderr.close()


def _share_a_core(core: int, plant_pid: int) -> None:
    """Plant and flight take turns in lockstep: handing over on one core costs half of waking up another."""
    os.sched_setaffinity(plant_pid, {core})
    os.sched_setaffinity(0, {core})


_reports: Queue[tuple[str, Status]] | None = None  # of a flight's own process: where its progress goes


def _begin(reports: Queue[tuple[str, Status]]) -> None:
    global _reports  # noqa: PLW0603 - a queue can be handed to a pool's processes only at their birth
    _reports = reports
    end_with_parent()


def fly(job: Job) -> tuple[Summary, float]:
    """Fly one mission in this process: how it ended, and the wall time it took.

    Raises `ExperimentError`, `LinkError` or `ConfigError`.
    """
    with contextlib.ExitStack() as open_things:
        recorder = open_folder(job.folder, job.config_path, job.config, blocking=job.lockstep)
        open_things.callback(recorder.close)
        bound, process = open_things.enter_context(
            plant(job.config_path, job.overrides, lockstep=job.lockstep, port=job.port)
        )
        link = open_link(f"udpout://127.0.0.1:{bound}")
        open_things.callback(link.close)
        if job.core is not None:
            _share_a_core(job.core, process.pid)
        shown_s = 0.0

        def on_status(status: Status) -> None:
            nonlocal shown_s
            if _reports is not None and time.monotonic() - shown_s > _REFRESH_S:
                shown_s = time.monotonic()
                _reports.put((job.controller, status))

        flight_process = FlightProcess(
            job.config,
            link,
            recorder,
            hedging=job.controller == "hedged",
            engage=True,
            lockstep=job.lockstep,
            on_status=on_status,
        )
        began_s = time.monotonic()
        with stop_signals(flight_process.stop):  # until the log is closed
            summary = flight_process.run()
            wall_s = time.monotonic() - began_s
            open_things.close()
    complaint = recorder.close()
    if complaint is not None:
        raise ExperimentError(complaint)
    return summary, wall_s


def fly_all(jobs: list[Job], on_status: Callable[[str, Status], None]) -> list[Outcome]:
    """Fly every job at the same time, each in a process of its own. Raises what `fly` raises.

    Ctrl-C reaches the flights, which release and end; this process waits for them.
    """
    context = get_context("spawn")
    reports: Queue[tuple[str, Status]] = context.Queue()
    with ProcessPoolExecutor(len(jobs), context, _begin, (reports,)) as pool:
        before = signal.signal(signal.SIGINT, signal.SIG_IGN)
        try:
            futures = [pool.submit(fly, job) for job in jobs]
            while not all(future.done() for future in futures):
                with contextlib.suppress(queue.Empty):
                    on_status(*reports.get(timeout=_REFRESH_S))
            ended = [future.result() for future in futures]
        except BrokenProcessPool:
            raise ExperimentError("a flight's process has gone: it was killed") from None
        finally:
            signal.signal(signal.SIGINT, before)
    return [_outcome(job, summary, wall_s) for job, (summary, wall_s) in zip(jobs, ended, strict=True)]


def _outcome(job: Job, summary: Summary, wall_s: float) -> Outcome:
    flight = read_flight(job.folder)
    ticks = flight.ticks
    flown_s = float(ticks["time_s"][-1] - ticks["time_s"][0]) if len(ticks) else 0.0
    try:
        metrics = score(job.config, flight)
    except ValueError:
        metrics = None
    return Outcome(job.controller, job.folder, summary, flight, metrics, flown_s, wall_s)


def realtime_factor(outcomes: list[Outcome]) -> float:
    """How much of the plant's time passed in a second of ours, all flights together."""
    return sum(o.flown_s for o in outcomes) / max(o.wall_s for o in outcomes)


def tick_rate_hz(outcomes: list[Outcome]) -> float:
    """How often the controllers ticked in a second of the plant's time: what came, and not what was asked for."""
    return sum(len(o.flight.ticks) for o in outcomes) / max(sum(o.flown_s for o in outcomes), 1e-6)
