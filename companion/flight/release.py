"""Handing the vehicle back: the configured mode is asked for until it is seen, and never twice where once was enough.

PX4 accepts DO_SET_MODE before it decides, so acceptance is not belief; but asking again after it might take the
vehicle from a pilot who has chosen another mode meanwhile. Silence follows in any case, and PX4's failsafe knows it.
"""

from __future__ import annotations

import contextlib
import math
import traceback
from collections.abc import Callable, Iterator
from typing import Any, Final

from companion.control.types import Odometry
from companion.flight.authority import states as authority
from companion.flight.authority.states import Reason
from companion.flight.session import Session, To
from companion.flight.vehicle_link.link import LinkError, VehicleLink
from companion.flight.vehicle_link.messages import Answer, Command, Heartbeat, ModeReport
from companion.flight.vehicle_link.modes import Mode, Result
from companion.flight.vehicle_link.requests import SetMode, TellHeartbeat

LISTEN_S: Final = 0.1  # a pilot's switch may be waiting in the queue: what the vehicle says is heard out first
_ASK_AGAIN_S: Final = 0.25
_UNHEARD_S: Final = 1.2  # without any report of the mode by then, Hold is asked for blindly: a heartbeat takes 1 s
_PATIENCE_S: Final = 2.0
_WALL_PATIENCE_S: Final = 15.0  # in lockstep, where time may stand still
_WHO_S: Final = 0.3
_MOST_ERRORS: Final = 20  # while listening
_MODES: Final = {"hold": Mode.HOLD, "land": Mode.LAND, "return": Mode.RETURN, "position": Mode.POSITION}


class HandOver:
    """What to ask of the vehicle, and when that is over. Attribute: `request`, what is asked."""

    def __init__(self, link: VehicleLink, mode: Mode, now_s: float) -> None:
        self._link = link
        self.request = SetMode(mode)
        self._until_s = now_s + _PATIENCE_S
        self._ask_s = now_s + LISTEN_S
        self._blindly_s = now_s + _UNHEARD_S
        self._reports = link.mode_reports  # heard when last asked; what came before now may be a second old
        self._hear_s = now_s
        self._answer: int | None = None

    def on_answer(self, result: int) -> None:
        """A COMMAND_ACK of DO_SET_MODE; the last one counts."""
        self._answer = result

    def disbelieve(self) -> None:
        """What was reported up to now is from before a pause of ours, and PX4 may have acted on the silence since."""
        self._reports, self._blindly_s = self._link.mode_reports, math.inf

    def over(self, now_s: float) -> bool:
        """Whether the vehicle has left OFFBOARD, or patience has ended."""
        return self._link.mode != Mode.OFFBOARD or now_s >= self._until_s

    def advance(self, now_s: float) -> SetMode | TellHeartbeat | None:
        """The request to send now, if any.

        The mode comes unasked twice a second while it stays (CURRENT_MODE), and a request for that is denied then; a
        heartbeat that is asked for comes at once.
        """
        if now_s >= self._hear_s:
            self._hear_s = math.inf
            return TellHeartbeat()
        still_offboard = self._link.mode_reports > self._reports  # said after the last request
        if now_s < self._ask_s or self._answer == Result.ACCEPTED or not (still_offboard or now_s >= self._blindly_s):
            return None
        self._ask_s, self._reports, self._blindly_s = now_s + _ASK_AGAIN_S, self._link.mode_reports, math.inf
        self._hear_s = now_s + _ASK_AGAIN_S - LISTEN_S
        return self.request


def let_go(flight: Session, hand_on: Callable[[Any], None]) -> None:
    """Ask for the configured mode, unless somebody else has control. `hand_on` answers the plant in lockstep.

    Whatever goes wrong meanwhile, the request goes out. Raises `LinkError`.
    """
    if not flight.streamed:
        return
    link, clock, reason = flight.link, flight.clock, flight.ending.reason
    with whatever_happens(flight):
        link.send_heartbeat(flight.state, reason)
    with whatever_happens(flight):
        flight.announce("released", reason.value, To.GROUND_STATION)
    if reason in authority.TAKEN:
        _hear_who(flight)
        return
    if link.mode != Mode.OFFBOARD:
        return
    # What has landed is to disarm: in Hold PX4 goes on believing that it flies, in Land it finds the ground.
    mode = Mode.LAND if reason is Reason.LANDED else _MODES[flight.config.release.mode]
    hand_over = HandOver(link, mode, clock.elapsed_s())
    gave_up_s = clock.wall_s() + _WALL_PATIENCE_S
    errors = 0
    while not hand_over.over(clock.elapsed_s()) and clock.wall_s() < gave_up_s:
        try:
            _ask_and_hear(flight, hand_over, hand_on)
        except LinkError:
            raise
        except Exception:
            errors += 1
            if errors == 1:
                tell_error(flight)
            if errors == _MOST_ERRORS:  # nothing can be heard: who listens for longer only delays the request
                if not flight.backlog.waiting:
                    link.request(hand_over.request)
                return


def _ask_and_hear(flight: Session, hand_over: HandOver, hand_on: Callable[[Any], None]) -> None:
    """Send the request that is due, and hear what the vehicle says next."""
    link, clock = flight.link, flight.clock
    if flight.backlog.waiting:
        hand_over.disbelieve()
    request = hand_over.advance(clock.elapsed_s())
    if request is not None:
        link.request(request)
    data = link.receive()
    clock.stamp()
    if not flight.lockstep:
        flight.turn(clock.wall_s())
    for message in link.messages(data):
        if isinstance(message, Odometry):
            flight.is_old(message)  # the backlog has seen it
        if isinstance(message, Answer):
            if message.command == Command.SET_MODE:
                hand_over.on_answer(message.result)
        elif flight.lockstep and not isinstance(message, Heartbeat | ModeReport):
            hand_on(message)  # the plant's time moves only when it is answered


def tell_error(flight: Session) -> None:
    """The exception in hand, to the log; one that has no room for it any more is not waited for."""
    with contextlib.suppress(Exception):
        flight.announce("traceback", traceback.format_exc())


@contextlib.contextmanager
def whatever_happens(flight: Session) -> Iterator[None]:
    """For a step on the way out: what goes wrong in it is told, and the way goes on."""
    try:
        yield
    except LinkError:
        pass  # there is nobody any more to hand anything to
    except Exception:
        tell_error(flight)


def _hear_who(flight: Session) -> None:
    """A heartbeat tells that the mode has changed; who changed it, the next CURRENT_MODE does. Nothing is sent."""
    link = flight.link
    until_s = flight.clock.wall_s() + _WHO_S
    while link.intended_mode is None and not flight.lockstep and flight.clock.wall_s() < until_s:
        data = link.receive()
        flight.clock.stamp()
        for _ in link.messages(data):
            pass  # the link has noted what it tells
