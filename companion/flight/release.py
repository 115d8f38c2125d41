"""Handing the vehicle back: the configured mode is asked for until it is seen, and never twice where once was enough.

PX4 accepts DO_SET_MODE before it decides, so acceptance is not belief; but asking again after it might take the
vehicle from a pilot who has chosen another mode meanwhile. Silence follows in any case, and PX4's failsafe knows it.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any, Final

from pymavlink.dialects.v20 import development as mavlink

from companion.flight.authority import states as authority
from companion.flight.session import Session
from companion.flight.vehicle_link.ground_station import system_status
from companion.flight.vehicle_link.port import CURRENT_MODE, HEARTBEAT, Port
from companion.mavlink import px4
from companion.mavlink.codec import Frame, decode_cold
from companion.mavlink.px4 import Mode, Result

LISTEN_S: Final = 0.1  # a pilot's switch may be waiting in the queue: what the vehicle says is heard out first
_ASK_AGAIN_S: Final = 0.25
_UNHEARD_S: Final = 1.2  # without any report of the mode by then, Hold is asked for blindly: a heartbeat takes 1 s
_PATIENCE_S: Final = 2.0
_WALL_PATIENCE_S: Final = 15.0  # in lockstep, where time may stand still
_WHO_S: Final = 0.3
_MODE: Final = frozenset({HEARTBEAT.message_id, CURRENT_MODE.message_id})
_MODES: Final = {"hold": Mode.HOLD, "land": Mode.LAND, "return": Mode.RETURN, "position": Mode.POSITION}


class HandOver:
    """What to ask of the vehicle, and when that is over."""

    def __init__(self, port: Port, ids: tuple[int, int], mode: Mode, now_s: float) -> None:
        self._port = port
        self._request = px4.set_mode(*ids, mode)
        self._until_s = now_s + _PATIENCE_S
        self._ask_s = now_s + LISTEN_S
        self._blindly_s = now_s + _UNHEARD_S
        self._reports = (
            port.mode_reports
        )  # mode reports heard when last asked; what came before now may be a second old
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
        if now_s < self._ask_s or self._answer == Result.ACCEPTED or not (still_offboard or now_s >= self._blindly_s):
            return None
        self._ask_s, self._reports, self._blindly_s = now_s + _ASK_AGAIN_S, self._port.mode_reports, math.inf
        return self._request


def let_go(flight: Session, take: Callable[[Frame], None]) -> None:
    """Ask for the configured mode, unless somebody else has control. `take` answers the plant in lockstep."""
    if not flight.streamed:
        return
    flight.send(px4.heartbeat(system_status(flight.state, flight.reason)))
    flight.tell(f"companion: {flight.reason.value}")
    if flight.reason in authority.TAKEN:
        _hear_who(flight)
        return
    if flight.port.mode != Mode.OFFBOARD:
        return
    hand_over = HandOver(flight.port, flight.ids, _MODES[flight.config.release.mode], flight.clock_s())
    gave_up_s = time.monotonic() + _WALL_PATIENCE_S
    while not hand_over.over(flight.clock_s()) and time.monotonic() < gave_up_s:
        request = hand_over.advance(flight.clock_s())
        if request is not None:
            flight.send(request)
        for frame in flight.port.frames(flight.port.receive(), flight.time_us()):
            if frame.message_id in _MODE:
                flight.port.note(frame)
            elif frame.message_id == mavlink.MAVLINK_MSG_ID_COMMAND_ACK:
                answer = decode_cold(frame)
                if answer.command == mavlink.MAV_CMD_DO_SET_MODE:
                    hand_over.acknowledged(answer.result)
            elif flight.lockstep:
                take(frame)  # the plant's time moves only when it is answered


def _hear_who(flight: Session) -> None:
    """A heartbeat tells that the mode has changed; who changed it, the next CURRENT_MODE does. Nothing is sent."""
    until_s = time.monotonic() + _WHO_S
    while flight.port.intended_mode is None and not flight.lockstep and time.monotonic() < until_s:
        for frame in flight.port.frames(flight.port.receive(), flight.time_us()):
            if frame.message_id == CURRENT_MODE.message_id:
                flight.port.note(frame)
