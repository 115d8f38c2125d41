"""The plant, served: an autopilot on its endpoints until it is stopped. The clocks are in `sitl.wire.clocks`."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

from sitl.autopilot.autopilot import Autopilot
from sitl.messages.log_download import LogFile
from sitl.messages.services import Services
from sitl.messages.streams import Streams
from sitl.messages.telemetry import Telemetry
from sitl.wire.clocks import Clocks, StopReason
from sitl.wire.ports import Endpoint, open_port
from sitl.wire.signed_port import SignedPort
from sitl.wire.wire import Channels, Peer, Wire

LOCKSTEP_EPOCH_US: Final = 1_700_000_000_000_000  # SYSTEM_TIME must not depend on the day


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
        endpoints: where to listen; in lockstep the one that asks for ODOMETRY leads, the others are guests.
        lockstep: which clock; see `sitl.wire.clocks`.
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
    system_id = autopilot.parameters.integer("MAV_SYS_ID")
    component_id = autopilot.parameters.integer("MAV_COMP_ID")
    epoch_us = LOCKSTEP_EPOCH_US if lockstep else time.time_ns() // 1000 - autopilot.time_us
    wires: list[Wire] = []
    card = list(logs)
    try:
        for endpoint in endpoints:
            port = open_port(endpoint)
            if signing_key is not None:
                port = SignedPort(port, signing_key)
            telemetry = Telemetry(autopilot, system_id, component_id, epoch_us)
            streams = Streams(telemetry, endpoint.profile, autopilot.time_us)
            services = Services(autopilot, telemetry, streams, system_id, component_id, card)
            wires.append(Wire(port, streams, services, None if wires else channels))
        for wire in wires:
            wire.neighbours = [other for other in wires if other is not wire]
        server = Clocks(autopilot, wires, stop or (lambda: False), peer)
        start, start_us = time.monotonic(), autopilot.time_us
        with server.signals():
            if on_ready is not None:
                on_ready(wires[0].port.number)
            reason = server.run_lockstep() if lockstep else server.run_realtime()
        return ServeResult(
            reason,
            1e-6 * (autopilot.time_us - start_us),
            time.monotonic() - start,
            server.odometry_sent,
            server.stalls,
            sum(wire.parser.frames for wire in wires),
            sum(wire.parser.bad_crc for wire in wires),
            sum(wire.services.ignored for wire in wires),
        )
    finally:
        for wire in wires:
            wire.port.close()
