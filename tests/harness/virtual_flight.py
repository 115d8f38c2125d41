"""The flight process against the scripted autopilot, in one program and in virtual time.

Not lockstep: the process goes by its own clock as on a vehicle, with its timeouts, ages and rates. But that clock only
moves while it waits for bytes, so that a flight is the same on a busy machine and takes no longer than its arithmetic.
"""

from __future__ import annotations

import re
import threading
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import pytest

from companion.commands.run import exit_code
from companion.config import load_config
from companion.flight.host.runtime import Summary
from companion.flight.process import FlightProcess
from companion.mavlink.link import LinkError
from companion.record.folder import open_folder
from harness.fake_autopilot import ScriptedAutopilot
from harness.virtual_time import VirtualTime, virtual_time

ROOT: Final = Path(__file__).resolve().parents[2]
RIG: Final = ROOT / "config" / "antx_rig.yaml"
SLOW: Final = ("tick.rate_hz=100", "tick.floor_hz=60", "mission.duration_s=60", "guards.heartbeat_age_s.limit=1.0")
RECEIVE_S: Final = 0.02  # how long `open_link` lets a receipt wait
QUEUED: Final = 250  # datagrams that a socket's queue holds; what comes then is lost
_PATIENCE_S: Final = 60.0  # of virtual time, for what a test waits for; and of real time, for a process that hangs


class VirtualLink:
    """The companion's end. Implements `companion.mavlink.link.Link`.

    Attributes: `error`, what every receipt raises, once it has worked for `works` more; `closed`.
    """

    stream = False
    name = "virtual"

    def __init__(self, autopilot: ScriptedAutopilot, clock: VirtualTime, before_wait: Callable[[], None]) -> None:
        self._autopilot, self._clock, self._before_wait = autopilot, clock, before_wait
        self._began_s = self._due_s = clock.now_s
        self._incoming: deque[bytes] = deque()
        self._heard = False  # as over UDP: where the companion is, is not known before
        self.closed = False
        self.error: Exception | None = None
        self.works = 0

    def receive(self) -> bytes:
        self._before_wait()
        if self.error is not None:
            self.works -= 1
            if self.works < 0:
                raise self.error
        if self.closed:
            raise LinkError("the test is over")
        clock, until_s = self._clock, self._clock.now_s + RECEIVE_S
        while not self._incoming and self._due_s <= until_s:
            clock.now_s = max(clock.now_s, self._due_s)
            self._due_s += ScriptedAutopilot.PERIOD_S
            self._autopilot.now_s = clock.now_s - self._began_s
            if self._heard:
                self._incoming.extend(self._autopilot.words())
        if not self._incoming:
            clock.now_s = max(clock.now_s, until_s)
            return b""
        return self._incoming.popleft()

    def sleep(self, seconds: float) -> None:
        """The companion does not get to run. The vehicle does, and what it says is queued."""
        until_s = self._clock.now_s + seconds
        while self._due_s <= until_s:
            self._clock.now_s = max(self._clock.now_s, self._due_s)
            self._due_s += ScriptedAutopilot.PERIOD_S
            self._autopilot.now_s = self._clock.now_s - self._began_s
            words = self._autopilot.words()
            self._incoming.extend(words[: max(QUEUED - len(self._incoming), 0)])
        self._clock.now_s = until_s

    def send(self, data: bytes) -> None:
        self._heard = True
        self._autopilot.hear(data)

    def lock(self) -> None:
        """There is one other end."""

    def close(self) -> None:
        self.closed = True


class VirtualFlight:
    """A flight that a test drives: it flies while the test waits for something, and stands still meanwhile.

    Attributes: `autopilot`, what it flies; `lines`, what it has printed; `process`; `summary`, when it has ended.
    """

    def __init__(self, folder: Path, settings: tuple[str, ...], clock: VirtualTime, *, engage: bool) -> None:
        self.autopilot = ScriptedAutopilot()
        self.folder = folder / "flight"
        self.lines: list[str] = []
        self.summary: Summary | None = None
        self._clock = clock
        self._enough: Callable[[], bool] = lambda: True
        self._go, self._pause = threading.Semaphore(0), threading.Semaphore(0)
        self._error: BaseException | None = None
        self._read = 0  # lines that `until` has been past
        config = load_config(RIG, (*SLOW, *settings))
        self._recorder = open_folder(self.folder, RIG, config, blocking=True, direct=True)
        self._link = VirtualLink(self.autopilot, clock, self._wait_for_test)
        self.process = FlightProcess(config, self._link, self._recorder, engage=engage, print_line=self.lines.append)
        self._thread = threading.Thread(target=self._fly, name="flight", daemon=True)
        self._thread.start()
        self._wait_for_flight()

    # -- what a test does ---------------------------------------------------------------------------------------------

    def until(self, pattern: str, within_s: float = _PATIENCE_S) -> str:
        """Fly until it prints a line that matches; that line."""

        def found() -> str | None:
            while self._read < len(self.lines):
                self._read += 1
                if re.search(pattern, self.lines[self._read - 1]):
                    return self.lines[self._read - 1]
            return None

        line: list[str] = []

        def enough() -> bool:
            if (new := found()) is not None:
                line.append(new)
            return bool(line)

        if not self._fly_until(enough, within_s) and not enough():
            pytest.fail(f"no {pattern!r} within {within_s:g} s of flight: {self.lines}")
        return line[0]

    def until_heard(self, happened: Callable[[], Any], within_s: float) -> bool:
        """Fly until something is so; whether it came to that."""
        return self._fly_until(lambda: bool(happened()), within_s) or bool(happened())

    def fly_on(self, seconds: float) -> None:
        """Fly for so long."""
        self._fly_until(lambda: False, seconds)

    def stop_for(self, seconds: float, *, asleep: bool = False) -> None:
        """The process is stopped for so long, or the whole computer sleeps; the vehicle flies on."""
        self._link.sleep(seconds)
        self._clock.slept_s += seconds if asleep else 0.0

    def exit_code(self, within_s: float) -> int:
        """Fly to the end, which must come in time; with what code `companion run` ends."""
        self._fly_until(lambda: False, within_s)
        if self.summary is None:
            pytest.fail(f"still flying after {within_s:g} s: {self.lines}")
        return exit_code(self.summary)

    @property
    def complaint(self) -> str:
        """What `companion run` says on stderr where control never began."""
        assert self.summary is not None
        return self.summary.detail

    @property
    def running(self) -> bool:
        """Whether it has not ended."""
        return self.summary is None and self._error is None

    def close(self) -> None:
        """End it, however it stands."""
        self._link.close()
        self._fly_until(lambda: False, _PATIENCE_S)
        self._thread.join(_PATIENCE_S)
        self._recorder.close()
        if self._error is not None:
            raise self._error

    # -- taking turns -------------------------------------------------------------------------------------------------

    def _fly_until(self, enough: Callable[[], bool], within_s: float) -> bool:
        """Let it fly; whether there was enough before the time was over or the flight."""
        until_s = self._clock.now_s + within_s
        reached = False

        def stop() -> bool:
            nonlocal reached
            reached = enough()
            return reached or self._clock.now_s >= until_s

        if not self.running:
            return enough()
        self._enough = stop
        self._go.release()
        self._wait_for_flight()
        return reached

    def _wait_for_flight(self) -> None:
        assert self._pause.acquire(timeout=_PATIENCE_S), "the process hangs"

    def _wait_for_test(self) -> None:
        """In the flight's thread, before it waits for bytes."""
        if self._enough():
            self._pause.release()
            self._go.acquire()

    def _fly(self) -> None:
        try:
            self.summary = self.process.run()
        except BaseException as error:
            self._error = error
        finally:
            self._pause.release()


@contextmanager
def flown(tmp_path: Path, *settings: str, engage: bool = False) -> Iterator[VirtualFlight]:
    """A flight that has begun, in virtual time; it is ended at the end of the `with`. `settings` are overrides."""
    with virtual_time(VirtualTime()) as clock:
        flight = VirtualFlight(tmp_path, settings, clock, engage=engage)
        try:
            yield flight
        finally:
            flight.close()
