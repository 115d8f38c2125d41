"""When what happens in a flight, worked out once by the plant's own streams: it does not depend on how it flies."""

from __future__ import annotations

import numpy as np

from sitl.autopilot.autopilot import CONTROL_DT_US, PHYSICS_DT_US
from sitl.campaign.loop import ANSWER, CONTROL, ESTIMATE, READ, Flags
from sitl.vehicles.vehicle import VehicleState
from sitl.wire.plant import Plant


def timeline(plant: Plant, until_us: int) -> Flags:
    """What happens in each millisecond from now on. The plant is of no use after that: its streams have run on."""
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
    frames: list[bytes] = []
    while (due_us := wire.due_us) < until_us:
        place = max((due_us - begin_us) // PHYSICS_DT_US, 0)
        autopilot.time_us = begin_us + PHYSICS_DT_US * place
        looked = False
        streams.others(due_us, frames)
        flags[place] |= ESTIMATE * looked
        looked = False
        if streams.odometry_due_us <= due_us:
            sent = streams.odometry(due_us, frames)
            flags[place] |= READ * looked + ANSWER * sent
        frames.clear()
    return flags
