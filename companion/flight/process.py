"""The loop: one blocking thread that waits for what comes over the link and hands it on.

Odometry goes to `ticks`, the hot path; changes of authority are `changes`, what is slow is `housekeeping`, the guards
that may come after the set-point are `watch`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from companion.config.mission.identifying import as_flown
from companion.config.schema import Config
from companion.control.types import Odometry
from companion.flight.authority.states import Reason, State
from companion.flight.host.clock import Wall
from companion.flight.host.runtime import Status, Summary, quiet_memory, stop_signals
from companion.flight.host.service import Notifier
from companion.flight.housekeeping import Housekeeping
from companion.flight.readiness.engage import Engagement, plan
from companion.flight.release import let_go, tell_error, whatever_happens
from companion.flight.session import Session, To
from companion.flight.steering import LiveCommands
from companion.flight.ticks import Ticks
from companion.flight.transitions import Changes, describe_ending, taken_by_failsafe
from companion.flight.vehicle_link.link import Link, LinkError
from companion.flight.vehicle_link.tool_access import ToolAccess, ToolServer
from companion.record.recorder import Recorder

_CONNECTING, _CHECKING, _STANDBY, _ENGAGED, _RELEASED = State  # on its class, looking up a member costs tenfold
_LOCKSTEP_SILENCE_S = 15.0


class FlightProcess:
    """One flight: from the first heartbeat to a release with a named reason.

    `lockstep`: time is the odometry's own, and every sample is answered, so that a flight is a function of its inputs.
    `bench`: the propellers are off, so that control may begin on the ground. `warning`: why no certificate covers it;
    `uncertified`: go on where the vehicle's gains are not the certified ones; `anyway`: where the config makes no sense
    beside the vehicle; `tools`: serves a tool that asks the vehicle; `print_line`: takes a line for the person and
    never waits; `wall`: the clock on the wall, the system's by default.
    """

    def __init__(
        self,
        config: Config,
        link: Link,
        recorder: Recorder,
        *,
        hedging: bool | None = None,
        engage: bool = False,
        bench: bool = False,
        lockstep: bool = False,
        warning: str | None = None,
        uncertified: bool = False,
        anyway: bool = True,
        tools: ToolServer | None = None,
        notifier: Notifier | None = None,
        on_status: Callable[[Status], None] | None = None,
        wall: Wall | None = None,
        print_line: Callable[[str], None] = lambda _: None,
    ) -> None:
        config = as_flown(config)
        identifying = config.mission.identification is not None
        hedging = config.controller.hedging if hedging is None or identifying else hedging
        self._flight = flight = Session(
            config,
            link,
            recorder,
            hedging=hedging,
            lockstep=lockstep,
            uncertified=uncertified,
            anyway=anyway,
            engage=engage,
            bench=bench,
            wall=wall,
            print_line=print_line,
        )
        self._link = flight.link
        self._lockstep = lockstep
        self._bench, self._warning = bench, warning
        self._notifier = notifier
        self._tools = None if tools is None else ToolAccess(flight.link, tools)
        self._changes = Changes(flight, warning)
        steps = plan(can_fly=config.vehicle_kind.can_fly)
        self._housekeeping = Housekeeping(flight, Engagement(steps) if engage else None, notifier, on_status)
        self._live_commands = LiveCommands(flight)
        self._ticks = Ticks(flight, self._changes, self._housekeeping.restart)
        self._handlers: dict[type, Callable[[Any], None]] = {
            Odometry: self._on_sample,
            **self._changes.handlers,
            **self._housekeeping.handlers,
        }

    def stop(self, reason: Reason = Reason.OPERATOR) -> None:
        """Ask for a release; safe from a signal handler."""
        self._flight.refuse(reason)

    def run(self) -> Summary:
        """Fly. Returns when control has ended and, where it was ours to end, the release mode has been asked for."""
        flight, announce = self._flight, self._flight.announce
        if self._warning is not None:
            announce("uncertified", self._warning)
        if self._bench:
            announce("bench", "BENCH: propellers off? control begins on the ground too", To.LOG | To.PERSON)
        for remark in self._link.remarks:
            announce("signing", remark, To.LOG | To.PERSON)
        announce(_CONNECTING.name.lower(), "link, waiting for vehicle {}/{}".format(*flight.ids))
        with quiet_memory(), stop_signals(self.stop):
            try:
                self._loop()
            except LinkError as error:
                self._changes.end(Reason.LINK_LOST, str(error))
            except Exception as error:  # whatever it was, the vehicle is handed back and the log tells
                self._changes.end(Reason.INTERNAL_ERROR, f"{type(error).__name__}: {error}")
                tell_error(flight)
            return self._end()

    def _end(self) -> Summary:
        """Control has ended: hand the vehicle back, and say why. A step that goes wrong keeps none of the others."""
        flight, announce = self._flight, self._flight.announce
        reason, detail = flight.ending.reason, flight.ending.detail
        with whatever_happens(flight):
            if self._notifier is not None:
                self._notifier.stopping(reason.value)
        with whatever_happens(flight):
            let_go(flight, self._hand_on)
        with whatever_happens(flight):
            detail = describe_ending(flight)
        with whatever_happens(flight):
            if not self._lockstep:  # there, how many came after the end is chance
                announce("traffic", flight.link.tally())
        with whatever_happens(flight):
            complaint = flight.link.close()
            if complaint is not None:
                announce("signing", complaint, To.LOG | To.PERSON)
        with whatever_happens(flight):
            announce(
                f"released_{reason.value}", detail, To.LOG | To.PERSON, line=f"released: {reason.value} ({detail})"
            )
        return Summary(reason, detail, flight.engaged, flight.pilot.elapsed_s, flight.ticks, taken_by_failsafe(flight))

    def _loop(self) -> None:
        """Until control has ended."""
        flight, link, clock, housekeeping = self._flight, self._link, self._flight.clock, self._housekeeping
        freshness, overrun_s, lockstep = flight.freshness, flight.limits[Reason.TICK_OVERRUN], self._lockstep
        heard_s = clock.began_wall_s
        while flight.state is not _RELEASED:
            data = link.receive()
            wall_s = clock.wall_s()
            clock.waited(wall_s)
            if not lockstep:
                flight.turn(wall_s)
            # Decided before what has come is believed: after a pause of ours it is stale. In control nothing changes
            # between two messages but that what was heard grows old.
            if flight.state is not _ENGAGED or flight.fault is not None or clock.now_s > freshness.until_s:
                self._changes.decide()
            if data:
                heard_s = wall_s
                clock.stamp()
                for message in link.messages(data):
                    self._hand_on(message)
                self._live_commands.fly_newest()
            elif lockstep:
                self._silence(wall_s - heard_s)
            if self._tools is not None:
                closed = self._tools.turn(clock.now_s, heard=bool(data))
                if closed is not None:
                    flight.announce("tools_closed", closed)
            clock_s = clock.passed_s if lockstep and flight.sample is not None else wall_s
            if clock_s >= housekeeping.due_s:
                housekeeping.run_due(clock_s, wall_s)
            if clock.wall_s() - wall_s > overrun_s and flight.state is _ENGAGED and not lockstep:
                flight.refuse(Reason.TICK_OVERRUN, f"a tick took {clock.wall_s() - wall_s:.3f} s")

    # -- what comes in ------------------------------------------------------------------------------------------------

    def _hand_on(self, message: Any) -> None:
        """One record of the vehicle, to whoever uses it."""
        if self._flight.state is not _RELEASED or self._lockstep:  # by a record before this one
            self._handlers[type(message)](message)

    def _on_sample(self, sample: Odometry) -> None:
        self._ticks.on_sample(sample)
        if self._lockstep and self._flight.state is _RELEASED:
            self._ticks.answer(sample)

    def _silence(self, silent_s: float) -> None:
        """In lockstep time stands still without the plant, so its silence is measured by the wall."""
        if self._link.connected and silent_s > _LOCKSTEP_SILENCE_S:
            self._flight.refuse(Reason.HEARTBEAT_LOST, f"the plant has been silent for {silent_s:.0f} s of wall time")
