"""Live commands: the newest that is not refused is flown, and who is refused is told why."""

from __future__ import annotations

import math
from typing import Final

from companion.control.types import Odometry, PositionSetpoint
from companion.flight.authority.states import State
from companion.flight.session import Session, To
from companion.flight.vehicle_link.live_command import LiveCommand, Refusals, outside
from companion.trajectory.sample import Sample
from companion.trajectory.streamed import Phase

_PERIOD_S: Final = 0.02
_TOLD: Final = To.LOG | To.PERSON | To.GROUND_STATION


class LiveCommands:
    """Flies what those who may steer have sent: the newest, at most fifty times a second."""

    def __init__(self, flight: Session) -> None:
        self._flight = flight
        self._fence = flight.config.guards.fence
        self._refusals = Refusals()
        self._flown_s = -math.inf
        self._stream, self._phase = flight.pilot.stream, Phase.NONE
        self._planner: tuple[int, int] | None = None  # whose stream is followed
        self._sample: Odometry | None = None  # the last pose, and when it was heard
        self._sampled_s = 0.0

    def fly_newest(self) -> None:
        """Fly or refuse what has come since; what comes too fast waits, and only the last of it is kept."""
        flight = self._flight
        if self._stream is not None:
            if flight.sample is not self._sample:
                self._sample, self._sampled_s = flight.sample, flight.clock.now_s
            if self._stream.phase is not self._phase:
                self._tell_phase()
        if not flight.link.steering:
            return
        now_s = flight.clock.now_s
        if 0.0 <= now_s - self._flown_s < _PERIOD_S:
            return
        self._flown_s = now_s
        for command in flight.link.live_commands():
            refused = command.wanted if isinstance(command.wanted, str) else self._fly(command)
            if refused is not None and self._refusals.tell(flight.clock.now_s):
                flight.announce("command_refused", refused)
                flight.announce("command_refused", f"refused: {refused}", To.GROUND_STATION)

    def _fly(self, command: LiveCommand) -> str | None:
        """Steer there; or why not."""
        flight, wanted = self._flight, command.wanted
        if flight.state is not State.ENGAGED or isinstance(wanted, str):
            return "not in control"
        if self._stream is not None and self._stream.phase is Phase.FOLLOWED and command.sender != self._planner:
            return "another planner streams"
        refused = outside(wanted, self._fence, flight.pilot.origin)
        if refused is not None:
            return refused
        if isinstance(wanted, PositionSetpoint):
            flight.pilot.steer(wanted)
            return None
        return self._follow(wanted, command)

    def _follow(self, sample: Sample, command: LiveCommand) -> str | None:
        """Fly by a sample of a stream; or why not. The place where it would brake to must be inside the fence too."""
        pilot = self._flight.pilot
        if self._stream is None or self._sample is None:
            return "a stream needs anchor: setpoint"
        x, y, z = self._stream.stop_ned_m(sample)
        refused = outside(PositionSetpoint(x, y, z, 0.0), self._fence, pilot.origin)
        if refused is not None:
            return f"to brake: {refused}"
        refused = pilot.follow(sample, self._sample.time_s + command.heard_s - self._sampled_s)
        if refused is None:
            self._planner = command.sender
        return refused

    def _tell_phase(self) -> None:
        """A stream has begun or ended."""
        assert self._stream is not None
        before, self._phase = self._phase, self._stream.phase
        phase = self._phase
        if phase is Phase.FOLLOWED and self._planner is not None:
            self._flight.announce("stream", "streamed by {}/{}".format(*self._planner), _TOLD)
        elif phase is Phase.ENDED:
            self._flight.announce("stream_ended", f"stream ended, braking: {self._stream.why}", _TOLD)
        elif before is Phase.FOLLOWED:
            self._flight.announce("stream_ended", "stream ended: another command", To.LOG)
