"""Live commands: the newest that is not refused is flown, and who is refused is told why."""

from __future__ import annotations

from companion.flight.authority.states import State
from companion.flight.session import Session
from companion.flight.vehicle_link import live_command as steer
from companion.mavlink.codec import Frame


class LiveCommands:
    """Takes what the port has put aside for us."""

    def __init__(self, flight: Session) -> None:
        self._flight = flight
        self._own = (flight.config.link.system_id, flight.config.link.component_id)
        self._fence = flight.config.guards.fence
        self._refusals = steer.Refusals()

    def take(self) -> None:
        """Fly or refuse what has come."""
        flight = self._flight
        frames, flight.port.steering = flight.port.steering, []
        for frame in frames:
            refused = self._refused(frame)
            if refused is not None and self._refusals.tell(flight.now_s):
                flight.event("command_refused", refused)
                flight.tell(f"companion: refused: {refused}")

    def _refused(self, frame: Frame) -> str | None:
        """Steer to where the frame says; or why not."""
        flight = self._flight
        command = steer.parse(frame, self._own)
        if isinstance(command, str):
            return command
        if flight.state is not State.ENGAGED:
            return "not in control"
        outside = steer.outside(command, self._fence, flight.pilot.origin)
        if outside is None:
            flight.pilot.steer(command)
        return outside
