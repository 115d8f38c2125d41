"""When what happens in a flight, from the schedule of the plant's own streams: it does not depend on how it flies."""

from __future__ import annotations

import numpy as np

from sitl.autopilot.autopilot import CONTROL_DT_US, PHYSICS_DT_US
from sitl.campaign.loop import ANSWER, CONTROL, ESTIMATE, READ, Flags
from sitl.vehicles.vehicle import VehicleState
from sitl.wire.plant import Plant


def timeline(plant: Plant, until_us: int) -> Flags:
    """What happens in each millisecond from now on. The plant is of no use after that: its ODOMETRY has run on."""
    autopilot = plant.autopilot
    (wire,) = plant.wires
    streams, begin_us = wire.streams, autopilot.time_us
    flags = np.zeros((until_us - begin_us) // PHYSICS_DT_US, dtype=np.uint8)
    next_control = (autopilot.next_control_us - begin_us) // PHYSICS_DT_US
    flags[next_control :: CONTROL_DT_US // PHYSICS_DT_US] |= CONTROL
    state, looked = autopilot.estimate(), False

    def look() -> VehicleState:
        nonlocal looked
        looked = True
        return state

    autopilot.estimate = look
    for build, due_us in streams.upcoming(until_us):
        looked = False
        build(0)  # a message asks for the estimate or does not, always
        if looked:
            flags[np.maximum(np.array(due_us) - begin_us, 0) // PHYSICS_DT_US] |= ESTIMATE
    for at_us, read, sent in streams.upcoming_odometry(until_us):
        flags[max(at_us - begin_us, 0) // PHYSICS_DT_US] |= READ * read + ANSWER * sent
    return flags
