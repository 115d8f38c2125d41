"""The flight process on the plant in lockstep, over MAVLink in memory: set-points as it made them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from companion.config import Config
from companion.flight.authority.states import Reason
from companion.flight.process import FlightProcess
from companion.record.folder import open_folder
from companion.record.reader import read_flight
from sitl.build import build_world
from sitl.metrics import in_control
from sitl.wire.memory import LockstepLink


def fly(config: Config, folder: Path, *, hedging: bool) -> tuple[Reason, np.ndarray]:
    """Why it ended, and (n, 6): the time of each tick's sample in control, attitude w first, and thrust."""
    recorder = open_folder(folder, Path("lockstep"), config, blocking=True, direct=True)
    try:
        link = LockstepLink(build_world(config).autopilot)
        flown = FlightProcess(config, link, recorder, hedging=hedging, engage=True, lockstep=True, wall=link.wall)
        summary = flown.run()
    finally:
        recorder.close()
    ticks = in_control(read_flight(folder))
    return summary.reason, np.column_stack([ticks["time_s"], ticks["setpoint_q_wxyz"], ticks["setpoint_thrust"]])
