"""Real time: the simulation keeps up with the wall clock."""

from __future__ import annotations

import select
import time
from collections.abc import Callable
from typing import Final

from sitl.wire.plant import Plant
from sitl.wire.wire import Peer

LONGEST_WAIT_S: Final = 0.02
STALL_US: Final = 250_000


def run(plant: Plant, stop: Callable[[], bool], peer: Peer | None) -> int:
    """Run until `stop()`; how often the machine was too slow, so that simulated time was let slip."""
    autopilot, wires = plant.autopilot, plant.wires
    descriptors = [wire.port.fileno() for wire in wires]
    start = time.monotonic() - 1e-6 * autopilot.time_us
    stalls = 0
    while not stop():
        now_us = int(1e6 * (time.monotonic() - start))
        behind = now_us - autopilot.time_us
        if behind > STALL_US:
            stalls += 1
            start += 1e-6 * behind
            now_us -= behind
        if peer is not None and peer.ended:
            peer.gone = True
        plant.advance(now_us)
        next_s = 1e-6 * min(wire.due_us for wire in wires)
        wait = min(max(start + next_s - time.monotonic(), 0.0), LONGEST_WAIT_S)
        readable, _, _ = select.select(descriptors, [], [], wait)
        if readable:
            plant.advance(min(int(1e6 * (time.monotonic() - start)), autopilot.time_us + STALL_US))
            plant.receive_all()
    return stalls
