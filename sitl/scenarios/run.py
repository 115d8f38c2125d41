"""One flight of a scenario: the plant, the companion's link, and the script that makes things happen on time."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, Final, Protocol

from pymavlink.dialects.v20 import development as mavlink

from sitl.autopilot.modes import FlightMode
from sitl.autopilot.request_faults import RequestFaults
from sitl.build import World
from sitl.scenarios.observer import Observer
from sitl.scenarios.watched_link import WatchedLink
from sitl.wire.wire import Channels
from sitl.world.environment import Environment
from sitl.world.estimator import Estimator

STREAMED_S: Final = 1.5  # of the companion's set-points before the pilot dares to switch
_GROUND_STATION: Final = (255, 190)


class Stoppable(Protocol):
    """As much of a flight process as a scenario touches."""

    def stop(self) -> None: ...


class Happening(Protocol):
    """Something that befalls a flight."""

    def happen(self, run: ScenarioRun) -> None:
        """Do it to this flight, now."""


class ScenarioRun:
    """One flight. Time in the script counts from where OFFBOARD began.

    Args: `world` that it flies in; `script` of (s, what happens); `before` happens at once; `limit_s` after which the
    operator ends it; `coast_s` for how long the plant runs on after the companion has ended; `pilot` whether somebody
    switches to OFFBOARD once the companion streams, `engage` whether the companion does it itself; `companion_ids`
    system and component.
    """

    def __init__(
        self,
        world: World,
        script: tuple[tuple[float, Happening], ...],
        *,
        before: tuple[Happening, ...],
        limit_s: float,
        coast_s: float,
        pilot: bool,
        engage: bool,
        companion_ids: tuple[int, int],
    ) -> None:
        assert world.environment is not None
        assert world.estimator is not None
        assert world.channels is not None
        self.autopilot = world.autopilot
        self.environment: Environment = world.environment
        self.estimator: Estimator = world.estimator
        self.channels: Channels = world.channels
        self.request_faults = self.autopilot.request_faults = RequestFaults()
        self.observer = Observer(self.autopilot)
        self.companion: WatchedLink | None = None
        self.process: Stoppable | None = None
        self.companion_ids = companion_ids
        self.timed_out = False
        self.over = False
        self._ground_station = mavlink.MAVLink(None, srcSystem=_GROUND_STATION[0], srcComponent=_GROUND_STATION[1])
        self._pending: list[tuple[float, Callable[[], None]]] = [
            (at_s, partial(what.happen, self)) for at_s, what in script
        ]
        self._running: list[Callable[[float], None]] = []
        self._pilot = pilot and not engage
        self._nobody_switches = not (pilot or engage)
        self._limit_s, self._coast_s = limit_s, coast_s
        self._began_us = self.autopilot.time_us
        self._streamed_us: int | None = None
        self._gone_us: int | None = None
        self.autopilot.on_control = self._control
        for what in before:
            what.happen(self)

    @property
    def time_s(self) -> float:
        """Since OFFBOARD began; zero before. Where nobody is going to switch to it, since the start."""
        began_us = self.observer.engaged_us
        if began_us is None:
            began_us = self._began_us if self._nobody_switches else self.autopilot.time_us
        return 1e-6 * (self.autopilot.time_us - began_us)

    def later(self, after_s: float, action: Callable[[], None]) -> None:
        """Do this some time after now."""
        self._pending.append((self.time_s + after_s, action))

    def each_step(self, action: Callable[[float], None]) -> None:
        """Do this at every control step, with the seconds since now."""
        began_us = self.autopilot.time_us
        self._running.append(lambda now_us: action(1e-6 * (now_us - began_us)))

    def send_from_ground_station(self, message: Any) -> None:
        """A frame of a ground station, as the autopilot forwards it to the companion."""
        self._ground_station.seq = self._ground_station.seq + 1 & 255
        self.channels.down.put(bytes(message.pack(self._ground_station)), self.autopilot.time_us)

    def _control(self, now_us: int) -> None:
        self.environment.step(now_us)
        for action in self._running:
            action(now_us)
        self.observer.on_control(now_us)
        if self.observer.engaged_us is not None or self._nobody_switches:
            self._play()
        elif self._pilot:
            self._switch_on(now_us)
        self._finish(now_us)

    def _play(self) -> None:
        now_s = self.time_s + 1e-6
        due = sorted((p for p in self._pending if p[0] <= now_s), key=lambda p: p[0])
        if due:
            self._pending = [p for p in self._pending if p[0] > now_s]
            for _, action in due:
                action()

    def _switch_on(self, now_us: int) -> None:
        """The pilot hands over once the companion has streamed for a while."""
        if self._streamed_us is None:
            self._streamed_us = now_us if self.observer.setpoints else None
        elif now_us - self._streamed_us >= 1e6 * STREAMED_S:
            self._pilot = False
            self.autopilot.commander.request(FlightMode.OFFBOARD, now_us)
            self.autopilot.follow_mode()

    @property
    def _reckoned_us(self) -> int:
        engaged = self.observer.engaged_us
        return self._began_us if engaged is None else engaged

    def _finish(self, now_us: int) -> None:
        if self.companion is not None and self.companion.gone:
            if self._gone_us is None:
                self._gone_us = now_us
            self.over = now_us - self._gone_us >= 1e6 * self._coast_s
        elif not self.timed_out and now_us - self._reckoned_us > 1e6 * self._limit_s:
            self.timed_out = True
            if self.companion is not None and self.process is not None:
                self.companion.before_next(self.process.stop)
