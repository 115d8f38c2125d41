"""Lockstep: simulated time stands still until the companion has answered.

It stands until a peer has asked for ODOMETRY by SET_MESSAGE_INTERVAL; from then on it moves to the next ODOMETRY, sends
it, and waits for the SET_ATTITUDE_TARGET that carries that sample's time. So a flight is deterministic, whatever the
machine does meanwhile, and as fast as the machine allows. Nothing here draws on the wall clock but to wait.

On an impaired wire simulated time moves from one arrival to the next instead. The plant waits where a sample arrives
that will be answered; the answer is taken off the wire at once and executed when it has come through.

Waiting itself is left to the caller: over sockets another thread or process answers meanwhile, in memory the companion
is called (`sitl.wire.memory`).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Iterator
from enum import Enum
from typing import Final

from sitl.messages.streams import NEVER_US
from sitl.wire.plant import Plant
from sitl.wire.wire import Peer, Wire

CALL_S: Final = 0.1  # between heartbeats while nobody is there
HEARTBEAT_S: Final = 1.0  # by the wall, while time stands still
SETPOINT_TIMEOUT_S: Final = 10.0
OTHERS_POLL_US: Final = 20_000


class Wait(Enum):
    """What a plant in lockstep waits for, where nothing has come."""

    FRAMES = "frames"  # on any wire; for no longer than until the next heartbeat is due
    ANSWER = "answer"  # on the wire that leads, which has been waited for already
    PEER = "peer"  # to have taken in what was sent, after which it may have nothing to say


class LockstepTimeoutError(RuntimeError):
    """In lockstep, no set-point came for the ODOMETRY just sent."""


class Lockstep:
    """Runs a plant in lockstep with whoever asks for ODOMETRY first.

    Args: `stop` ends the run; `peer`, the companion, where it runs in the same process; `wall_s`, a clock that goes on
    while time stands still.
    """

    def __init__(
        self,
        plant: Plant,
        stop: Callable[[], bool],
        peer: Peer | None,
        wall_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._plant = plant
        self._stop = stop
        self._peer = peer
        self._wall_s = wall_s
        self._silent = False  # the peer did not answer the last sample: ask it instead of the wire

    def run(self) -> Iterator[Wait]:
        """Run until `stop()`. Yields whenever there is nothing to do until something comes.

        Raises `LockstepTimeoutError`.
        """
        plant, autopilot = self._plant, self._plant.autopilot
        leader = yield from self._stand_still()
        if leader is None:
            return
        for wire in plant.wires:  # how many heartbeats went out while standing must not show in the flight
            wire.streams.sequence = 0
        others = [wire for wire in plant.wires if wire is not leader]
        streams, impaired, peer = leader.streams, leader.channels is not None, self._peer
        other_poll_us = 0
        while True:
            if streams.odometry_due_us == NEVER_US:
                if (yield from self._stand_still()) is None:
                    return
                continue
            leader.sample_ms = -1
            sent = leader.sent
            if impaired and not leader.prompt:
                plant.advance(min([wire.due_us for wire in plant.wires]))
            else:
                plant.advance(streams.odometry_due_us)
            if leader.sample_ms >= 0 and (peer is None or not peer.gone):
                if not (yield from self._await_answer(leader)):
                    return
            elif peer is not None and leader.sent != sent:
                yield from self._await_idle(leader, peer)
            if others and autopilot.time_us >= other_poll_us:
                other_poll_us = autopilot.time_us + OTHERS_POLL_US
                plant.receive_all(others)
            if self._stop():
                return

    def _await_answer(self, leader: Wire) -> Generator[Wait, None, bool]:
        """Take in what comes until the sample just sent is answered; False when the plant is to stop instead."""
        plant, autopilot, peer, wanted_ms = self._plant, self._plant.autopilot, self._peer, leader.sample_ms
        port, handle, services = leader.port, leader.handle, leader.services
        receive = port.receive if self._silent else port.receive_waiting
        leader.answered_ms = services.setpoint_ms = -1
        deadline = 0.0
        while leader.answered_ms != wanted_ms:
            idle = peer is not None and peer.idle(leader.sent)  # if so, all that it had to say is here already
            data = port.receive() if idle else receive()
            if data:
                handle(data, autopilot.time_us)
                if services.changed or autopilot.notices:
                    plant.send_notices()
                continue
            if peer is not None and idle:
                self._silent = True
                peer.gone = peer.ended
                return True
            yield Wait.PEER if self._silent else Wait.ANSWER
            if self._stop():
                return False
            now = self._wall_s()
            deadline = deadline or now + SETPOINT_TIMEOUT_S
            if now > deadline:
                raise LockstepTimeoutError(
                    f"lockstep: no SET_ATTITUDE_TARGET with time_boot_ms {wanted_ms} within {SETPOINT_TIMEOUT_S} s"
                )
        self._silent = False
        return True

    def _await_idle(self, leader: Wire, peer: Peer) -> Generator[Wait]:
        """Let the companion take in what needs no set-point, and hear what it has to say to that."""
        deadline = self._wall_s() + SETPOINT_TIMEOUT_S
        while not (peer.gone or peer.idle(leader.sent)) and not self._stop():
            if self._wall_s() > deadline:
                raise LockstepTimeoutError(f"lockstep: the companion has not come back within {SETPOINT_TIMEOUT_S} s")
            yield Wait.PEER
        peer.gone = peer.ended
        self._plant.receive_all([leader])

    def _stand_still(self) -> Generator[Wait, None, Wire | None]:
        """Answer and send heartbeats until ODOMETRY is wanted; the wire that wants it, `None` if the plant is to stop.

        Whoever is heard gets a heartbeat at once, so that how many it gets is no matter of chance.
        """
        plant, wires = self._plant, self._plant.wires
        due_s = dict.fromkeys(wires, 0.0)
        greeted = {wire for wire in wires if wire.port.connected}
        for wire in wires:
            wire.standing = True
        while not self._stop():
            now = self._wall_s()
            for wire in wires:
                if wire.port.connected and wire not in greeted:
                    greeted.add(wire)
                elif now < due_s[wire]:
                    continue
                wire.send([wire.streams.request(0) or b""], plant.autopilot.time_us)
                due_s[wire] = now + (HEARTBEAT_S if wire in greeted else CALL_S)
                if wire not in greeted:
                    wire.streams.sequence = 0  # nobody has been heard: what went out may have reached nobody
            yield Wait.FRAMES
            plant.receive_all()
            if self._peer is not None and self._peer.ended:
                return None  # it has given up before it asked for anything
            for wire in wires:
                if wire.services.commands.odometry_requested and wire.port.connected:
                    for each in wires:
                        each.standing = False
                    return wire
        return None
