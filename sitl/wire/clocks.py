"""The plant on its wires, under one of two clocks.

Real time: the simulation keeps up with the wall clock. Lockstep: simulated time stands still until a peer has asked for
ODOMETRY by SET_MESSAGE_INTERVAL; from then on it moves to the next ODOMETRY, sends it, and waits for the
SET_ATTITUDE_TARGET that carries that sample's time. So a flight over real sockets is deterministic, whatever the
machine does meanwhile, and as fast as the machine allows. Nothing here draws on the wall clock but to wait.

On an impaired wire simulated time moves from one arrival to the next instead. The plant waits where a sample arrives
that will be answered; the answer is taken off the wire at once and executed when it has come through.
"""

from __future__ import annotations

import select
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from enum import Enum
from types import FrameType
from typing import Final

from sitl.autopilot.autopilot import Autopilot
from sitl.messages.streams import NEVER_US
from sitl.wire.wire import Peer, Wire

STILL_HEARTBEAT_S: Final = 0.1
SETPOINT_TIMEOUT_S: Final = 10.0
LONGEST_WAIT_S: Final = 0.02
STALL_US: Final = 250_000
GUEST_POLL_US: Final = 20_000
PEER_POLL_S: Final = 2e-5


class StopReason(Enum):
    """Why the plant stopped."""

    REQUESTED = "requested"
    SIGNAL = "signal"


class LockstepTimeoutError(RuntimeError):
    """In lockstep, no set-point came for the ODOMETRY just sent."""


class Clocks:
    """Runs an autopilot on its wires. Attributes: `stalls`, `odometry_sent`, as in `sitl.wire.server.ServeResult`."""

    def __init__(self, autopilot: Autopilot, wires: list[Wire], stop: Callable[[], bool], peer: Peer | None) -> None:
        self._autopilot = autopilot
        self._wires = wires
        self._stop = stop
        self._peer = peer
        self._signalled = False
        self._silent = False  # the peer did not answer the last sample: ask it instead of the wire
        self._heartbeat_at = 0.0
        self.stalls = 0
        self.odometry_sent = 0

    # --- real time --------------------------------------------------------------------------------------------------

    def run_realtime(self) -> StopReason:
        autopilot, wires, peer = self._autopilot, self._wires, self._peer
        descriptors = [wire.port.fileno() for wire in wires]
        start = time.monotonic() - 1e-6 * autopilot.time_us
        while not self._stopping():
            now_us = int(1e6 * (time.monotonic() - start))
            behind = now_us - autopilot.time_us
            if behind > STALL_US:
                self.stalls += 1
                start += 1e-6 * behind
                now_us -= behind
            if peer is not None and peer.ended:
                peer.gone = True
            self._advance(now_us)
            next_s = 1e-6 * min(wire.due_us for wire in wires)
            wait = min(max(start + next_s - time.monotonic(), 0.0), LONGEST_WAIT_S)
            readable, _, _ = select.select(descriptors, [], [], wait)
            if readable:
                self._advance(min(int(1e6 * (time.monotonic() - start)), autopilot.time_us + STALL_US))
                self._receive_all()
        return self._reason()

    # --- lockstep ---------------------------------------------------------------------------------------------------

    def run_lockstep(self) -> StopReason:
        autopilot = self._autopilot
        master = self._stand_still()
        if master is None:
            return self._reason()
        for wire in self._wires:  # how many heartbeats went out while standing must not show in the flight
            wire.streams.sequence = 0
        guests = [wire for wire in self._wires if wire is not master]
        streams, impaired, peer = master.streams, master.channels is not None, self._peer
        guest_poll_us = 0
        while True:
            if streams.odometry_due_us == NEVER_US:
                if self._stand_still() is None:
                    break
                continue
            master.sample_ms = -1
            sent = master.sent
            if impaired and not master.prompt:
                self._advance(min([wire.due_us for wire in self._wires]))
            else:
                self._advance(streams.odometry_due_us)
            if master.sample_ms >= 0 and (peer is None or not peer.gone):
                if not self._await_answer(master):
                    break
            elif peer is not None and master.sent != sent:
                self._await_idle(master, peer)
            if guests and autopilot.time_us >= guest_poll_us:
                guest_poll_us = autopilot.time_us + GUEST_POLL_US
                self._receive_all(guests)
            if self._signalled or self._stop():
                break
        return self._reason()

    def _await_answer(self, master: Wire) -> bool:
        """Take in what comes until the sample just sent is answered; False when the plant is to stop instead."""
        autopilot, peer, wanted_ms = self._autopilot, self._peer, master.sample_ms
        port, handle = master.port, master.handle
        receive = port.receive if self._silent else port.receive_waiting
        master.answered_ms = master.services.setpoint_ms = -1
        deadline = 0.0
        while master.answered_ms != wanted_ms:
            idle = peer is not None and peer.idle(master.sent)  # if so, all that it had to say is here already
            data = port.receive() if idle else receive()
            if data:
                handle(data, autopilot.time_us)
                if master.services.changed or autopilot.notices:
                    self._tell_all()
                continue
            if peer is not None and idle:
                self._silent = True
                peer.gone = peer.ended
                return True
            if self._silent:
                time.sleep(PEER_POLL_S)
            if self._stopping():
                return False
            now = time.monotonic()
            deadline = deadline or now + SETPOINT_TIMEOUT_S
            if now > deadline:
                raise LockstepTimeoutError(
                    f"lockstep: no SET_ATTITUDE_TARGET with time_boot_ms {wanted_ms} within {SETPOINT_TIMEOUT_S} s"
                )
        self._silent = False
        return True

    def _await_idle(self, master: Wire, peer: Peer) -> None:
        """Let the companion take in what needs no set-point, and hear what it has to say to that."""
        deadline = time.monotonic() + SETPOINT_TIMEOUT_S
        while not (peer.gone or peer.idle(master.sent)) and not self._stopping():
            if time.monotonic() > deadline:
                raise LockstepTimeoutError(f"lockstep: the companion has not come back within {SETPOINT_TIMEOUT_S} s")
            time.sleep(PEER_POLL_S)
        peer.gone = peer.ended
        self._receive_all([master])

    def _stand_still(self) -> Wire | None:
        """Answer, and beat, until ODOMETRY is wanted; the wire that wants it, `None` if the plant is to stop."""
        descriptors = [wire.port.fileno() for wire in self._wires]
        for wire in self._wires:
            wire.standing = True
        while not self._stopping():
            now = time.monotonic()
            if now >= self._heartbeat_at:
                self._heartbeat_at = now + STILL_HEARTBEAT_S
                for wire in self._wires:
                    wire.send([wire.streams.request(0) or b""], self._autopilot.time_us)
            readable, _, _ = select.select(descriptors, [], [], LONGEST_WAIT_S)
            if readable:
                self._receive_all()
            if self._peer is not None and self._peer.ended:
                return None  # it has given up before it asked for anything
            for wire in self._wires:
                if wire.services.commands.odometry_requested and wire.port.connected:
                    for each in self._wires:
                        each.standing = False
                    return wire
        return None

    # --- both -------------------------------------------------------------------------------------------------------

    def _advance(self, to_us: int) -> None:
        """Move simulated time, sending what falls due on the way at its own time, ODOMETRY after the others."""
        autopilot, wires = self._autopilot, self._wires
        outgoing: list[list[bytes]] = [[] for _ in wires]
        while True:
            due = min([wire.due_us for wire in wires])
            if due > to_us:
                break
            autopilot.advance(due)
            for wire, frames in zip(wires, outgoing, strict=True):
                streams = wire.streams
                streams.others(due, frames)
                if streams.odometry_due_us <= due:
                    streams.odometry(due, frames)
                    self.odometry_sent += 1
                if wire.channels is not None:
                    wire.send(frames, due)
                    frames.clear()
                    wire.arrive(due)
        autopilot.advance(to_us)
        if autopilot.notices:
            self._tell_all()
        for wire, frames in zip(wires, outgoing, strict=True):
            if frames:
                wire.send(frames, to_us)
            if wire.channels is not None:
                wire.push()
            if wire.services.logs.sending:
                wire.services.send_logs(to_us)
                wire.flush(to_us)

    def _receive_all(self, wires: Sequence[Wire] | None = None) -> None:
        for wire in wires or self._wires:
            while data := wire.port.receive():
                wire.handle(data, self._autopilot.time_us)
        self._tell_all()

    def _tell_all(self) -> None:
        """Status texts to ground stations, parameters that one link changed to the others."""
        notices = self._autopilot.notices
        for wire in self._wires:
            if wire.services.ground_station_seen:
                for notice in notices:
                    wire.services.send_status_text(notice.severity, notice.text)
            for changed in wire.services.changed:
                for other in self._wires:
                    if other is not wire:
                        other.services.send_parameter(changed)
            wire.services.changed.clear()
        notices.clear()
        for wire in self._wires:
            wire.flush(self._autopilot.time_us)

    def _stopping(self) -> bool:
        return self._signalled or self._stop()

    def _reason(self) -> StopReason:
        return StopReason.SIGNAL if self._signalled else StopReason.REQUESTED

    @contextmanager
    def signals(self) -> Iterator[None]:
        """SIGTERM and SIGINT end the run in good order; only the main thread can listen to them."""
        if threading.current_thread() is not threading.main_thread():
            yield
            return

        def on_signal(_number: int, _frame: FrameType | None) -> None:
            self._signalled = True

        previous = {number: signal.signal(number, on_signal) for number in (signal.SIGTERM, signal.SIGINT)}
        try:
            yield
        finally:
            for number, handler in previous.items():
                signal.signal(number, handler)
