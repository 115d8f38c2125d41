"""Handing the vehicle back: Hold is asked for until it is granted, and never twice where once was enough.

PX4 accepts DO_SET_MODE before it decides, so acceptance is not belief; but asking again after it might take the
vehicle from a pilot who has chosen another mode meanwhile. Silence follows in any case, and PX4's failsafe knows it.
"""

from __future__ import annotations

from typing import Any, Final

from companion.flight.port import Port
from companion.mavlink import px4
from companion.mavlink.px4 import Mode, Result

LISTEN_S: Final = 0.1  # a pilot's switch may be waiting in the queue: what the vehicle says is heard out first
_ASK_AGAIN_S: Final = 0.25
_PATIENCE_S: Final = 2.0


class HandOver:
    """What to ask of the vehicle, and when that is over."""

    def __init__(self, port: Port, ids: tuple[int, int], now_s: float) -> None:
        self._port = port
        self._request = px4.set_mode(*ids, Mode.HOLD)
        self._until_s = now_s + _PATIENCE_S
        self._ask_s = now_s + LISTEN_S
        self._reports = -1  # mode reports heard when last asked
        self._answer: int | None = None

    def acknowledged(self, result: int) -> None:
        """A COMMAND_ACK of DO_SET_MODE; the last one counts."""
        self._answer = result

    def over(self, now_s: float) -> bool:
        """Whether the vehicle has left OFFBOARD, or patience has ended."""
        return self._port.mode != Mode.OFFBOARD or now_s >= self._until_s

    def advance(self, now_s: float) -> Any | None:
        """The request to send now, if any."""
        still_offboard = self._port.mode_reports > self._reports  # said after the last request
        if now_s < self._ask_s or self._answer == Result.ACCEPTED or not still_offboard:
            return None
        self._ask_s, self._reports = now_s + _ASK_AGAIN_S, self._port.mode_reports
        return self._request
