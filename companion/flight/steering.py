"""Live commands: the newest that is not refused is flown, and who is refused is told why."""

from __future__ import annotations

import math
from typing import Final

from companion.control.types import PositionSetpoint
from companion.flight.authority.states import State
from companion.flight.session import Session, To
from companion.flight.vehicle_link.live_command import Refusals, outside

_PERIOD_S: Final = 0.02


class LiveCommands:
    """Flies what those who may steer have sent: the newest, at most fifty times a second."""

    def __init__(self, flight: Session) -> None:
        self._flight = flight
        self._fence = flight.config.guards.fence
        self._refusals = Refusals()
        self._flown_s = -math.inf

    def fly_newest(self) -> None:
        """Fly or refuse what has come since; what comes too fast waits, and only the last of it is kept."""
        flight = self._flight
        if not flight.link.steering:
            return
        now_s = flight.clock.now_s
        if 0.0 <= now_s - self._flown_s < _PERIOD_S:
            return
        self._flown_s = now_s
        for command in flight.link.live_commands():
            refused = command if isinstance(command, str) else self._fly(command)
            if refused is not None and self._refusals.tell(flight.clock.now_s):
                flight.announce("command_refused", refused)
                flight.announce("command_refused", f"refused: {refused}", To.GROUND_STATION)

    def _fly(self, command: PositionSetpoint) -> str | None:
        """Steer there; or why not."""
        flight = self._flight
        if flight.state is not State.ENGAGED:
            return "not in control"
        refused = outside(command, self._fence, flight.pilot.origin)
        if refused is None:
            flight.pilot.steer(command)
        return refused
