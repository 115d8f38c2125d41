"""The loop: one blocking thread that waits for what comes over the link and hands it on.

Odometry goes to `ticks`, the hot path; changes of authority are `changes`, what is slow is `housekeeping`, the guards
that may come after the set-point are `watch`.
"""

from __future__ import annotations

import contextlib
import math
import time
import traceback
from collections.abc import Callable

from companion.config.schema import Config
from companion.flight.authority.states import Reason, State
from companion.flight.host.runtime import Status, Summary, quiet_memory, stop_signals
from companion.flight.host.service import Notifier
from companion.flight.housekeeping import Housekeeping
from companion.flight.readiness.engage import Engagement, plan
from companion.flight.release import let_go
from companion.flight.session import Session
from companion.flight.steering import LiveCommands
from companion.flight.ticks import Ticks
from companion.flight.tool_access import ToolAccess
from companion.flight.transitions import Changes, ending, taken_by_failsafe
from companion.flight.vehicle_link.odometry import ATTITUDE_QUATERNION, LOCAL_POSITION_NED, ODOMETRY
from companion.flight.vehicle_link.port import CURRENT_MODE, HEARTBEAT
from companion.mavlink.codec import Frame
from companion.mavlink.link import Link, LinkError
from companion.mavlink.sharing import ToolServer
from companion.record.recorder import Recorder

_POSE = frozenset({ODOMETRY.message_id, ATTITUDE_QUATERNION.message_id, LOCAL_POSITION_NED.message_id})
_MODE = frozenset({HEARTBEAT.message_id, CURRENT_MODE.message_id})
_CONNECTING, _CHECKING, _STANDBY, _ENGAGED, _RELEASED = State  # on its class, looking up a member costs tenfold
_LOCKSTEP_SILENCE_S = 15.0


class FlightProcess:
    """One flight: from the first heartbeat to a release with a named reason.

    `lockstep`: time is the odometry's own, and every sample is answered, so that a flight is a function of its inputs.
    `warning`: why no certificate covers it; `uncertified`: go on where the vehicle's gains are not the certified ones;
    `door`: where tools may come in and ask the vehicle.
    """

    def __init__(
        self,
        config: Config,
        link: Link,
        recorder: Recorder,
        *,
        hedging: bool | None = None,
        engage: bool = False,
        lockstep: bool = False,
        warning: str | None = None,
        uncertified: bool = False,
        door: ToolServer | None = None,
        notifier: Notifier | None = None,
        on_status: Callable[[Status], None] | None = None,
        say: Callable[[str], None] = lambda _: None,
    ) -> None:
        hedging = config.controller.hedging if hedging is None else hedging
        self._flight = flight = Session(
            config, link, recorder, hedging=hedging, lockstep=lockstep, uncertified=uncertified, say=say
        )
        self._port, self._pilot, self._pose = flight.port, flight.pilot, flight.pose
        self._limits = flight.limits
        self._lockstep = lockstep
        self._warning = warning
        self._notifier = notifier
        self._guests = None if door is None else ToolAccess(flight, door)
        self._changes = Changes(flight, warning)
        steps = plan(*flight.ids, can_fly=config.vehicle_kind.can_fly)
        self._keeping = Housekeeping(flight, Engagement(steps) if engage else None, notifier, on_status)
        self._live = LiveCommands(flight)
        self._ticks = Ticks(flight, self._changes, self._keeping)
        self._fresh_until_s = -math.inf  # in control: before then neither pose nor heartbeat can be stale

    def stop(self, reason: Reason = Reason.OPERATOR) -> None:
        """Ask for a release; safe from a signal handler."""
        self._flight.fault = reason

    def run(self) -> Summary:
        """Fly. Returns when control has ended and, where it was ours to end, the release mode has been asked for."""
        flight = self._flight
        if self._warning is not None:
            flight.event("uncertified", self._warning)
        flight.event(_CONNECTING.name.lower(), "link, waiting for vehicle {}/{}".format(*flight.ids))
        with quiet_memory(), stop_signals(self.stop):
            try:
                self._loop()
            except LinkError as error:
                self._changes.end(Reason.LINK_LOST, str(error))
            except Exception as error:  # whatever it was, the vehicle is handed back and the log tells
                self._changes.end(Reason.INTERNAL_ERROR, f"{type(error).__name__}: {error}")
                flight.event("traceback", traceback.format_exc())
            if self._notifier is not None:
                self._notifier.stopping(flight.reason.value)
            with contextlib.suppress(LinkError):
                let_go(flight, self._take)
        detail = ending(flight)
        if not self._lockstep:  # there, how many came after the end is chance
            flight.event("traffic", flight.port.tally())
        flight.event(f"released_{flight.reason.value}", detail)
        flight.say(f"released: {flight.reason.value} ({detail})")
        return Summary(
            flight.reason, detail, flight.engaged, self._pilot.elapsed_s, flight.ticks, taken_by_failsafe(flight)
        )

    def _loop(self) -> None:
        """Until control has ended."""
        flight, port, keeping = self._flight, self._port, self._keeping
        heard_s = flight.began_wall_s
        overrun_s = self._limits[Reason.TICK_OVERRUN]
        while flight.state is not _RELEASED:
            data = port.receive()
            wall_s = time.monotonic()
            if not self._lockstep:
                flight.now_s = wall_s
            if flight.state is not _ENGAGED or flight.fault is not None or flight.now_s > self._fresh_until_s:
                self._look_at_ages()  # before what has come is believed: after a pause of ours it is stale
            if data:
                heard_s = wall_s
                flight.stamp_us = flight.time_us()
                frames = port.frames(data, flight.stamp_us)
                for frame in frames:
                    self._take(frame)
                if port.steering:
                    self._live.take()
            elif self._lockstep:
                self._silence(wall_s - heard_s)
            if self._guests is not None:
                self._guests.turn(frames if data else ())
            clock_s = flight.passed_s if self._lockstep and flight.sample is not None else wall_s
            if clock_s >= keeping.due_s:
                keeping.keep(clock_s, wall_s)
            if time.monotonic() - wall_s > overrun_s and flight.state is _ENGAGED and not self._lockstep:
                flight.refuse(Reason.TICK_OVERRUN, f"a tick took {time.monotonic() - wall_s:.3f} s")

    def _look_at_ages(self) -> None:
        """Decide, unless nothing can have changed: in control, only time passes between two messages.

        What has been heard stays fresh until a time that later messages can only put off, so it is looked up no more
        often than that.
        """
        flight, limits = self._flight, self._limits
        now = flight.now_s
        if (
            flight.state is not _ENGAGED
            or flight.fault is not None
            or now - flight.pose_at_s > limits[Reason.POSE_STALE]
            or now - flight.heartbeat_at_s > limits[Reason.HEARTBEAT_LOST]
        ):
            self._fresh_until_s = -math.inf
            self._changes.decide()
        else:
            self._fresh_until_s = min(
                flight.pose_at_s + limits[Reason.POSE_STALE], flight.heartbeat_at_s + limits[Reason.HEARTBEAT_LOST]
            )

    # -- what comes in ------------------------------------------------------------------------------------------------

    def _take(self, frame: Frame) -> None:
        """One frame of the vehicle."""
        if self._flight.state is _RELEASED and not self._lockstep:
            return  # by a frame before this one
        number = frame[0]
        if number in _POSE:
            sample = self._pose.take(frame)
            if sample is not None:
                self._ticks.take(sample)
                if self._lockstep and self._flight.state is _RELEASED:
                    self._ticks.answer(sample)
        elif number in _MODE:
            self._changes.hear(frame)
        else:
            self._keeping.take(frame)

    def _silence(self, silent_s: float) -> None:
        """In lockstep time stands still without the plant, so its silence is measured by the wall."""
        if self._port.connected and silent_s > _LOCKSTEP_SILENCE_S:
            self._flight.refuse(Reason.HEARTBEAT_LOST, f"the plant has been silent for {silent_s:.0f} s of wall time")
