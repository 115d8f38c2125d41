"""One scenario flown: the real flight process, and the plant in the same program, on one of two transports."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Final, NamedTuple

from companion.config import Config, ConfigError, load_config
from companion.flight.host.clock import Wall
from companion.flight.host.runtime import Summary
from companion.flight.process import FlightProcess
from companion.mavlink.link import open_link
from companion.record.folder import open_folder
from companion.record.reader import read_flight
from sitl.build import World, build_world
from sitl.scenarios.run import ScenarioRun
from sitl.scenarios.scenario import BY_A_TRUE_ESTIMATE, Flown, Scenario
from sitl.scenarios.settled import settled_world
from sitl.scenarios.verdict import problems, worst_error_m
from sitl.scenarios.watched_link import WatchedLink
from sitl.wire.lockstep import LockstepTimeoutError
from sitl.wire.memory import LockstepLink, OwnClockLink
from sitl.wire.ports import NOBODY, UdpEndpoint
from sitl.wire.server import serve

_READY_S: Final = 20.0
_PATIENCE_S: Final = 60.0


class Bases(NamedTuple):
    """The files that scenarios build on, by the name that a scenario calls them, and what is overridden in all."""

    paths: dict[str, Path]
    overrides: tuple[str, ...] = ()


class PlantError(Exception):
    """The plant came to grief; the message is one line."""


def fly(scenario: Scenario, bases: Bases, folder: Path, *, sockets: bool = False) -> Flown:
    """Fly one scenario in this process, main thread. The flight folder stays.

    `sockets`: over UDP instead of in memory. In lockstep the record is the same; where the companion goes by its own
    clock it is then the machine's, and the record never twice the same.
    """
    began_s = time.monotonic()
    reason, error = "-", None
    went_m = flown_s = None
    found: list[str] = []
    try:
        path = bases.paths[scenario.base]
        config = load_config(path, (*BY_A_TRUE_ESTIMATE[scenario.base], *scenario.overrides, *bases.overrides))
        summary, run, complaint = _fly(scenario, config, path, folder, sockets=sockets)
        flight = read_flight(folder)
        reason, error = summary.reason.value, worst_error_m(config, flight)
        asked = run.request_faults.requests
        seen = run.observer.account()
        went_m, flown_s = (seen.in_control_m, summary.engaged_s) if summary.engaged else (None, None)
        found = problems(scenario, config, summary, flight, seen, asked)
        found += [complaint] if complaint else []
        found += [f"nothing ended it within {scenario.limit_s:g} s"] if run.timed_out else []
    except (ConfigError, OSError, ValueError, PlantError) as problem:
        found = [str(problem)]
    wall_s = time.monotonic() - began_s
    return Flown(scenario.name, scenario.reason.value, reason, error, tuple(found), wall_s, went_m, flown_s)


def _fly(
    scenario: Scenario, config: Config, path: Path, folder: Path, *, sockets: bool
) -> tuple[Summary, ScenarioRun, str | None]:
    """How it ended, the run, and what the recorder complains of."""
    lockstep = not scenario.own_clock
    recorder = open_folder(folder, path, config, blocking=lockstep, direct=not sockets)
    try:
        world = settled_world(config) if scenario.airborne else build_world(config, complete=True)
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
        link = run.companion = WatchedLink()
        meet = _over_udp if sockets else _in_memory
        with meet(world, run, link, lockstep=lockstep) as wall:
            process = FlightProcess(config, link, recorder, engage=scenario.engage, lockstep=lockstep, wall=wall)
            run.process = process
            summary = process.run()
            link.ended = True
    finally:
        complaint = recorder.close()
    return summary, run, complaint


@contextlib.contextmanager
def _in_memory(world: World, run: ScenarioRun, link: WatchedLink, *, lockstep: bool) -> Iterator[Wall]:
    """A plant that runs while the companion waits, and on to the end of its coast; their clock on the wall.

    Raises `PlantError`.
    """
    meet = LockstepLink if lockstep else OwnClockLink
    memory = meet(world.autopilot, stop=lambda: run.over, channels=world.channels, peer=link)
    link.attach(memory, memory.sleep)
    yield memory.wall
    try:
        memory.finish()
    except LockstepTimeoutError as error:
        raise PlantError(str(error)) from None


@contextlib.contextmanager
def _over_udp(world: World, run: ScenarioRun, link: WatchedLink, *, lockstep: bool) -> Iterator[None]:
    """A plant in a thread, from when it listens until the end of its coast. Raises `PlantError`."""
    ready, cut = threading.Event(), threading.Event()
    port = 0
    trouble: str | None = None

    def on_ready(bound: int) -> None:
        nonlocal port
        port = bound
        ready.set()

    def run_plant() -> None:
        nonlocal trouble
        try:
            serve(
                world.autopilot,
                [UdpEndpoint(0, NOBODY)],
                lockstep=lockstep,
                stop=lambda: run.over or cut.is_set(),
                on_ready=on_ready,
                channels=world.channels,
                peer=link,
            )
        except (OSError, LockstepTimeoutError) as error:
            trouble = str(error)
        except Exception as error:  # a defect of the plant's own must fail the scenario, not hang it
            trouble = f"the plant: {type(error).__name__}: {error}"
        finally:
            ready.set()

    thread = threading.Thread(target=run_plant, name="plant")
    thread.start()
    try:
        ready.wait(_READY_S)
        if trouble is None:
            udp = open_link(f"udpout://127.0.0.1:{port}")
            with contextlib.closing(udp):
                link.attach(udp)
                yield
                thread.join(_PATIENCE_S)
    finally:
        cut.set()
        thread.join()
    if trouble is not None:
        raise PlantError(trouble)
