"""Flies scenarios: the real flight process over real sockets, the plant in a thread beside it."""

from __future__ import annotations

import contextlib
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path
from typing import Final, NamedTuple

from companion.config import Config, ConfigError, load_config
from companion.flight.host.runtime import Summary
from companion.flight.process import FlightProcess
from companion.mavlink.link import open_link
from companion.record.folder import open_folder
from companion.record.reader import read_flight
from sitl.build import World, build_world
from sitl.scenarios.index import by_name
from sitl.scenarios.run import ScenarioRun
from sitl.scenarios.scenario import Flown, Scenario
from sitl.scenarios.verdict import problems, worst_error_m
from sitl.scenarios.watched_link import WatchedLink
from sitl.wire.clocks import LockstepTimeoutError
from sitl.wire.ports import UdpEndpoint
from sitl.wire.server import serve

ALTITUDE_M: Final = 5.0
SETTLE_S: Final = 8.0  # of Hold, before anybody is there
_NOBODY: Final = 9  # the discard port: heartbeats before the companion is heard reach nobody
_READY_S: Final = 20.0
_PATIENCE_S: Final = 60.0


class Bases(NamedTuple):
    """The files that scenarios build on, by the name that a scenario calls them, and what is overridden in all."""

    paths: dict[str, Path]
    overrides: tuple[str, ...] = ()


def fly(scenario: Scenario, bases: Bases, folder: Path) -> Flown:
    """Fly one scenario in this process, main thread. The flight folder stays."""
    began_s = time.monotonic()
    reason, error = "-", None
    found: list[str] = []
    try:
        path = bases.paths[scenario.base]
        config = load_config(path, (*scenario.overrides, *bases.overrides))
        summary, run, trouble = _play(scenario, config, path, folder)
        flight = read_flight(folder)
        reason, error = summary.reason.value, worst_error_m(config, flight)
        asked = run.request_faults.requests
        found = problems(scenario, config, summary, flight, run.observer.account(), asked)
        found += [trouble] if trouble else []
        found += [f"nothing ended it within {scenario.limit_s:g} s"] if run.timed_out else []
    except (ConfigError, OSError, ValueError) as problem:
        found = [str(problem)]
    return Flown(scenario.name, scenario.reason.value, reason, error, tuple(found), time.monotonic() - began_s)


def _play(scenario: Scenario, config: Config, path: Path, folder: Path) -> tuple[Summary, ScenarioRun, str | None]:
    world = build_world(config, complete=True)
    if scenario.airborne:
        world.autopilot.start_in_air(ALTITUDE_M, SETTLE_S)
    run = ScenarioRun(
        world,
        scenario.happens,
        before=scenario.before,
        limit_s=scenario.limit_s,
        coast_s=scenario.coast_s,
        pilot=scenario.pilot,
        engage=scenario.engage,
        companion_ids=(config.link.system_id, config.link.component_id),
    )
    link = WatchedLink()
    run.companion = link
    with _flying(world, run, link, lockstep=not scenario.realtime) as plant:
        recorder = open_folder(folder, path, config, blocking=not scenario.realtime)
        try:
            link.attach(open_link(f"udpout://127.0.0.1:{plant.port}"))
            process = FlightProcess(config, link, recorder, engage=scenario.engage, lockstep=not scenario.realtime)
            run.process = process
            summary = process.run()
        finally:
            link.ended = True
            complaint = recorder.close()
    link.close()
    return summary, run, plant.trouble or complaint


class _Plant:
    """A plant that runs in a thread. Attributes: `port` it listens on; `trouble`, one line, if it came to any."""

    def __init__(self, world: World, run: ScenarioRun, link: WatchedLink, *, lockstep: bool) -> None:
        self.port = 0
        self.trouble: str | None = None
        self.ready = threading.Event()
        self.cut = threading.Event()
        self._world, self._run, self._link, self._lockstep = world, run, link, lockstep

    def run(self) -> None:
        try:
            serve(
                self._world.autopilot,
                [UdpEndpoint(0, _NOBODY)],
                lockstep=self._lockstep,
                stop=lambda: self._run.over or self.cut.is_set(),
                on_ready=self._on_ready,
                channels=self._world.channels,
                peer=self._link,
            )
        except (OSError, LockstepTimeoutError) as error:
            self.trouble = str(error)
        except Exception as error:  # a defect of the plant's own must fail the scenario, not hang it
            self.trouble = f"the plant: {type(error).__name__}: {error}"
        finally:
            self.ready.set()

    def _on_ready(self, port: int) -> None:
        self.port = port
        self.ready.set()


@contextlib.contextmanager
def _flying(world: World, run: ScenarioRun, link: WatchedLink, *, lockstep: bool) -> Iterator[_Plant]:
    """A plant, from when it listens until it has coasted after the companion's end."""
    plant = _Plant(world, run, link, lockstep=lockstep)
    thread = threading.Thread(target=plant.run, name="plant")
    thread.start()
    try:
        plant.ready.wait(_READY_S)
        yield plant
        thread.join(_PATIENCE_S)
    finally:
        plant.cut.set()
        thread.join()


def fly_all(
    names: Sequence[str], bases: Bases, folder: Path, on_flown: Callable[[Flown], None], workers: int
) -> list[Flown]:
    """Fly scenarios by name, several at a time; their verdicts in the order of `names`.

    Those that take the wall's time begin first, so that nobody waits for them at the end. Ctrl-C ends what flies.
    """
    begin = sorted(names, key=lambda name: not by_name(name).realtime)
    flown: dict[str, Flown] = {}
    with ProcessPoolExecutor(workers, get_context("spawn")) as pool:
        before = signal.signal(signal.SIGINT, signal.SIG_IGN)  # workers inherit it: in them only a flight listens
        try:
            futures = [pool.submit(_fly_named, name, bases, folder / name) for name in begin]
        finally:
            signal.signal(signal.SIGINT, before)
        try:
            for future in as_completed(futures):
                result = future.result()
                flown[result.name] = result
                on_flown(result)
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise
    return [flown[name] for name in names]


def _fly_named(name: str, bases: Bases, folder: Path) -> Flown:
    return fly(by_name(name), bases, folder)
