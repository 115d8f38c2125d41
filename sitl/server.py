"""The plant on its wires, under one of two clocks.

Real time: the simulation keeps up with the wall clock. Lockstep: simulated time stands still until a peer has asked for
ODOMETRY by SET_MESSAGE_INTERVAL; from then on it moves to the next ODOMETRY, sends it, and waits for the
SET_ATTITUDE_TARGET that carries that sample's time. So a flight over real sockets is deterministic, whatever the
machine does meanwhile, and as fast as the machine allows. Nothing here draws on the wall clock but to wait.
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
from typing import Final, NamedTuple

from companion.mavlink.codec import FrameParser
from sitl.autopilot import Autopilot
from sitl.ports import Endpoint, Port, open_port
from sitl.services import Services
from sitl.streams import NEVER_US, Streams
from sitl.telemetry import Telemetry

STILL_HEARTBEAT_S: Final = 0.1
SETPOINT_TIMEOUT_S: Final = 10.0
LONGEST_WAIT_S: Final = 0.02
STALL_US: Final = 250_000
GUEST_POLL_US: Final = 20_000
LOCKSTEP_EPOCH_US: Final = 1_700_000_000_000_000  # SYSTEM_TIME must not depend on the day


class StopReason(Enum):
    """Why the plant stopped."""

    REQUESTED = "requested"
    SIGNAL = "signal"


class ServeResult(NamedTuple):
    """What a run of the plant was like."""

    reason: StopReason
    simulated_s: float
    wall_s: float
    odometry_sent: int  # lockstep: the number of ticks
    stalls: int  # real time: how often the machine was too slow and simulated time was let slip
    frames: int
    bad_crc: int
    ignored: int


class LockstepTimeoutError(RuntimeError):
    """In lockstep, no set-point came for the ODOMETRY just sent."""


class _Link:
    """One wire with everything that is its own."""

    def __init__(self, port: Port, profile_streams: Streams, services: Services) -> None:
        self.port = port
        self.streams = profile_streams
        self.services = services
        self.parser = FrameParser(stream=port.stream)

    def handle(self, data: bytes, now_us: int) -> None:
        """Take received bytes, and answer them."""
        if not self.streams.started:
            self.streams.start(now_us)
        handle = self.services.handle
        for frame in self.parser.feed(data):
            handle(frame)
        self.flush()

    def flush(self) -> None:
        replies = self.services.replies
        if replies:
            self.port.send(replies)
            replies.clear()


class _Server:
    def __init__(self, autopilot: Autopilot, links: list[_Link], stop: Callable[[], bool]) -> None:
        self._autopilot = autopilot
        self._links = links
        self._stop = stop
        self._signalled = False
        self._heartbeat_at = 0.0
        self.stalls = 0
        self.odometry_sent = 0

    # --- real time --------------------------------------------------------------------------------------------------

    def run_realtime(self) -> StopReason:
        autopilot, links = self._autopilot, self._links
        descriptors = [link.port.fileno() for link in links]
        start = time.monotonic() - 1e-6 * autopilot.time_us
        while not self._stopping():
            now_us = int(1e6 * (time.monotonic() - start))
            behind = now_us - autopilot.time_us
            if behind > STALL_US:
                self.stalls += 1
                start += 1e-6 * behind
                now_us -= behind
            self._advance(now_us)
            next_s = 1e-6 * min(link.streams.due_us for link in links)
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
        for link in self._links:  # how many heartbeats went out while standing must not show in the flight
            link.streams.sequence = 0
        guests = [link for link in self._links if link is not master]
        streams, services = master.streams, master.services
        receive, handle = master.port.receive_waiting, master.handle
        guest_poll_us = 0
        while True:
            if streams.odometry_due_us == NEVER_US:
                if self._stand_still() is None:
                    break
                continue
            services.setpoint_ms = -1
            self._advance(streams.odometry_due_us)
            sample_ms = autopilot.time_us // 1000 & 0xFFFFFFFF
            deadline = 0.0
            while services.setpoint_ms != sample_ms:
                data = receive()
                if data:
                    handle(data, autopilot.time_us)
                    if services.changed or autopilot.notices:
                        self._tell_all()
                    continue
                if self._stopping():
                    return self._reason()
                now = time.monotonic()
                deadline = deadline or now + SETPOINT_TIMEOUT_S
                if now > deadline:
                    raise LockstepTimeoutError(
                        f"lockstep: no SET_ATTITUDE_TARGET with time_boot_ms {sample_ms} within {SETPOINT_TIMEOUT_S} s"
                    )
            if guests and autopilot.time_us >= guest_poll_us:
                guest_poll_us = autopilot.time_us + GUEST_POLL_US
                self._receive_all(guests)
            if self._signalled or self._stop():
                break
        return self._reason()

    def _stand_still(self) -> _Link | None:
        """Answer, and beat, until ODOMETRY is wanted; the link that wants it, `None` if the plant is to stop."""
        descriptors = [link.port.fileno() for link in self._links]
        while not self._stopping():
            now = time.monotonic()
            if now >= self._heartbeat_at:
                self._heartbeat_at = now + STILL_HEARTBEAT_S
                for link in self._links:
                    link.port.send([link.streams.request(0) or b""])
            readable, _, _ = select.select(descriptors, [], [], LONGEST_WAIT_S)
            if readable:
                self._receive_all()
            for link in self._links:
                if link.services.odometry_requested and link.port.connected:
                    return link
        return None

    # --- both -------------------------------------------------------------------------------------------------------

    def _advance(self, to_us: int) -> None:
        """Move simulated time, sending what falls due on the way at its own time, ODOMETRY after the others."""
        autopilot, links = self._autopilot, self._links
        outgoing: list[list[bytes]] = [[] for _ in links]
        while True:
            due = min([link.streams.due_us for link in links])
            if due > to_us:
                break
            autopilot.advance(due)
            for link, frames in zip(links, outgoing, strict=True):
                streams = link.streams
                streams.others(due, frames)
                if streams.odometry_due_us <= due:
                    streams.odometry(due, frames)
                    self.odometry_sent += 1
        autopilot.advance(to_us)
        if autopilot.notices:
            self._tell_all()
        for link, frames in zip(links, outgoing, strict=True):
            if frames:
                link.port.send(frames)

    def _receive_all(self, links: Sequence[_Link] | None = None) -> None:
        for link in links or self._links:
            while data := link.port.receive():
                link.handle(data, self._autopilot.time_us)
        self._tell_all()

    def _tell_all(self) -> None:
        """Status texts to ground stations, parameters that one link changed to the others."""
        notices = self._autopilot.notices
        for link in self._links:
            if link.services.ground_station_seen:
                for notice in notices:
                    link.services.send_status_text(notice.severity, notice.text)
            for changed in link.services.changed:
                for other in self._links:
                    if other is not link:
                        other.services.send_parameter(changed)
            link.services.changed.clear()
        notices.clear()
        for link in self._links:
            link.flush()

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


def serve(
    autopilot: Autopilot,
    endpoints: Sequence[Endpoint],
    *,
    lockstep: bool = False,
    stop: Callable[[], bool] | None = None,
    on_ready: Callable[[int], None] | None = None,
) -> ServeResult:
    """Put an autopilot on its endpoints and run it until `stop()` is true or a SIGTERM or SIGINT comes.

    Args:
        endpoints: where to listen; in lockstep the one that asks for ODOMETRY leads, the others are guests.
        lockstep: which clock; see the module.
        stop: asked at least every 50 ms of wall time.
        on_ready: called once with the UDP port of the first endpoint (0 for a serial line) when all are open.

    Raises: `OSError` that names the port or device that cannot be opened; `LockstepTimeoutError`.
    """
    if not endpoints:
        raise ValueError("no endpoint to serve")
    system_id = autopilot.parameters.integer("MAV_SYS_ID")
    component_id = autopilot.parameters.integer("MAV_COMP_ID")
    epoch_us = LOCKSTEP_EPOCH_US if lockstep else time.time_ns() // 1000 - autopilot.time_us
    links: list[_Link] = []
    try:
        for endpoint in endpoints:
            port = open_port(endpoint)
            telemetry = Telemetry(autopilot, system_id, component_id, epoch_us)
            streams = Streams(telemetry, endpoint.profile)
            links.append(_Link(port, streams, Services(autopilot, telemetry, streams, system_id, component_id)))
        server = _Server(autopilot, links, stop or (lambda: False))
        start, start_us = time.monotonic(), autopilot.time_us
        with server.signals():
            if on_ready is not None:
                on_ready(links[0].port.number)
            reason = server.run_lockstep() if lockstep else server.run_realtime()
        return ServeResult(
            reason,
            1e-6 * (autopilot.time_us - start_us),
            time.monotonic() - start,
            server.odometry_sent,
            server.stalls,
            sum(link.parser.frames for link in links),
            sum(link.parser.bad_crc for link in links),
            sum(link.services.ignored for link in links),
        )
    finally:
        for link in links:
            link.port.close()
