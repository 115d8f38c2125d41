"""Tools beside a flight: what is not hot is handed to them, what they ask is sent on, and nothing of theirs matters."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from companion.flight.session import Session
from companion.mavlink.codec import Frame
from companion.mavlink.sharing import ToolServer

_LOOK_S: Final = 0.1  # between two looks at the door while nobody is in


class ToolAccess:
    """Looks after the door, once a turn of the loop and after the set-point is out."""

    def __init__(self, flight: Session, door: ToolServer) -> None:
        self._flight = flight
        self._door: ToolServer | None = door
        self._look_s = 0.0

    def turn(self, frames: Iterable[Frame]) -> None:
        """Frames of the vehicle in, at most one question out. Never waits, never raises."""
        door, now_s = self._door, self._flight.now_s
        if door is None:
            return
        if not door.attached:
            if now_s < self._look_s:
                return
            self._look_s = now_s + _LOOK_S
        try:
            if door.attached:
                door.offer(frames)
            asked = door.asked(now_s)
        except Exception as error:  # whatever a guest has done, it is no reason to end a flight
            self._door = None
            self._flight.event("door_closed", f"{type(error).__name__}: {error}")
            return
        if asked:
            self._flight.port.forward(asked, self._flight.time_us())
