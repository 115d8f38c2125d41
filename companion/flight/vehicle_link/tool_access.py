"""Tools beside a flight: what is not hot is handed to them, what they ask is sent on, and nothing of theirs matters."""

from __future__ import annotations

from typing import Final

from companion.flight.vehicle_link.link import VehicleLink
from companion.mavlink.tool_server import ToolServer

__all__ = ["ToolAccess", "ToolServer"]

_LOOK_S: Final = 0.1  # between two looks for a tool while none is attached


class ToolAccess:
    """Serves a tool, once a turn of the loop and after the set-point is out."""

    def __init__(self, link: VehicleLink, server: ToolServer) -> None:
        self._link = link
        self._server: ToolServer | None = server
        self._look_s = 0.0

    def turn(self, now_s: float, *, heard: bool) -> str | None:
        """Frames of the vehicle in, at most one question out. Never waits, never raises.

        `heard`: whether anything came in this turn. Returns why no tool is served from now on, when that happens.
        """
        server = self._server
        if server is None:
            return None
        if not server.attached:
            if now_s < self._look_s:
                return None
            self._look_s = now_s + _LOOK_S
        try:
            if server.attached and heard:
                server.offer(self._link.heard)
            asked = server.asked(now_s)
        except Exception as error:  # whatever a tool has done, it is no reason to end a flight
            self._server = None
            return f"{type(error).__name__}: {error}"
        if asked:
            self._link.forward(asked)
        return None
