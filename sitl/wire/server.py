"""The plant, served: an autopilot on its endpoints until it is stopped."""

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

from sitl.autopilot.autopilot import Autopilot
from sitl.messages.log_card import LogFile
from sitl.wire import realtime
from sitl.wire.lockstep import Lockstep, Wait
from sitl.wire.plant import FIXED_EPOCH_US, Plant
from sitl.wire.ports import Endpoint, open_port
from sitl.wire.signed_port import SignedPort
from sitl.wire.wire import Channels, Peer

LONGEST_WAIT_S: Final = 0.02
PEER_POLL_S: Final = 2e-5


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


def serve(
    autopilot: Autopilot,
    endpoints: Sequence[Endpoint],
    *,
    lockstep: bool = False,
    stop: Callable[[], bool] | None = None,
    on_ready: Callable[[int], None] | None = None,
    logs: Sequence[LogFile] = (),
    signing_key: bytes | None = None,
    channels: Channels | None = None,
    peer: Peer | None = None,
) -> ServeResult:
    """Put an autopilot on its endpoints and run it until `stop()` is true or a SIGTERM or SIGINT comes.

    Args:
        endpoints: where to listen; in lockstep the one that asks for ODOMETRY leads, the others are listened to.
        lockstep: which clock; see `sitl.wire.lockstep` and `sitl.wire.realtime`.
        stop: asked at least every 50 ms of wall time.
        on_ready: called once with the UDP port of the first endpoint (0 for a serial line) when all are open.
        logs: what LOG_REQUEST_LIST finds.
        signing_key: every frame must be signed by it, and is.
        channels: what the frames of the first endpoint meet on their way.
        peer: the companion on the first endpoint, where it runs in this process: in lockstep the plant then knows when
            it will not answer. Only on an impaired wire.

    Raises: `OSError` that names the port or device that cannot be opened; `LockstepTimeoutError`.
    """
    if not endpoints:
        raise ValueError("no endpoint to serve")
    epoch_us = FIXED_EPOCH_US if lockstep else time.time_ns() // 1000 - autopilot.time_us
    plant = Plant(autopilot, epoch_us, logs)
    wires = plant.wires
    stalls = 0
    try:
        for endpoint in endpoints:
            port = open_port(endpoint)
            if signing_key is not None:
                port = SignedPort(port, signing_key)
            plant.add(port, endpoint.profile, None if wires else channels)
        start, start_us = time.monotonic(), autopilot.time_us
        with _signals() as signalled:

            def stopping() -> bool:
                return signalled() or (stop is not None and stop())

            if on_ready is not None:
                on_ready(wires[0].port.number)
            if lockstep:
                _run_lockstep(plant, stopping, peer)
            else:
                stalls = realtime.run(plant, stopping, peer)
            reason = StopReason.SIGNAL if signalled() else StopReason.REQUESTED
        return ServeResult(
            reason,
            1e-6 * (autopilot.time_us - start_us),
            time.monotonic() - start,
            plant.odometry_sent,
            stalls,
            sum(wire.parser.frames for wire in wires),
            sum(wire.parser.bad_crc for wire in wires),
            sum(wire.services.ignored for wire in wires),
        )
    finally:
        for wire in wires:
            wire.port.close()


def _run_lockstep(plant: Plant, stop: Callable[[], bool], peer: Peer | None) -> None:
    """Lockstep with somebody in another thread or process: waiting is waiting for a socket or a line."""
    descriptors = [wire.port.fileno() for wire in plant.wires]
    for wait in Lockstep(plant, stop, peer).run():
        if wait is Wait.FRAMES:
            select.select(descriptors, [], [], LONGEST_WAIT_S)
        elif wait is Wait.PEER:
            time.sleep(PEER_POLL_S)


@contextmanager
def _signals() -> Iterator[Callable[[], bool]]:
    """SIGTERM and SIGINT end the run in good order; only the main thread can listen to them."""
    came = False

    def on_signal(_number: int, _frame: FrameType | None) -> None:
        nonlocal came
        came = True

    if threading.current_thread() is not threading.main_thread():
        yield lambda: came
        return
    previous = {number: signal.signal(number, on_signal) for number in (signal.SIGTERM, signal.SIGINT)}
    try:
        yield lambda: came
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
