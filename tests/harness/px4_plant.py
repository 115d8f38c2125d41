"""The shipped PX4 quadrotor in memory, and scripts for it that were run at a real PX4 v1.17 too."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, Final

from pymavlink.dialects.v20 import development as mavlink

from companion.config import load_config
from companion.mavlink.px4 import Result
from harness.plant_client import MemoryClient, clients
from sitl.autopilot.autopilot import Autopilot
from sitl.autopilot.modes import FlightMode
from sitl.build import build_world
from sitl.messages.streams import Profile

PX4: Final = Path(__file__).resolve().parents[2] / "config" / "px4_quadrotor.yaml"
ARM: Final = mavlink.MAV_CMD_COMPONENT_ARM_DISARM
SET_MODE: Final = mavlink.MAV_CMD_DO_SET_MODE
OFFBOARD: Final = (1.0, 6.0)
HOVER: Final = 0.49
LEVEL: Final = (1.0, 0.0, 0.0, 0.0)


def plant() -> tuple[Autopilot, MemoryClient]:
    """The shipped quadrotor on the ground, and a companion on its link, which has said something."""
    pilot = build_world(load_config(PX4, ("plant.sensors=null",))).autopilot
    (companion,) = clients(pilot, (Profile.ONBOARD, 191))
    companion.heartbeat()
    companion.command(511, mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE, 20_000)
    return pilot, companion


def stream(companion: MemoryClient, seconds: float, thrust: float, q_wxyz: tuple[float, ...] = LEVEL) -> list[Any]:
    """Set-points at 50 Hz; everything that came meanwhile."""
    heard: list[Any] = []
    for _ in range(round(50 * seconds)):
        companion.setpoint(q_wxyz, thrust)
        heard += companion.collect(0.02)
    return heard


def armed_in_offboard(thrust: float) -> tuple[Autopilot, MemoryClient]:
    pilot, companion = plant()
    stream(companion, 0.2, thrust)
    companion.command(SET_MODE, *OFFBOARD)
    stream(companion, 0.2, thrust)
    companion.command(ARM, 1)
    assert companion.acknowledged(ARM) == Result.ACCEPTED
    return pilot, companion


def in_the_air(height_m: float = 60.0) -> tuple[Autopilot, MemoryClient]:
    pilot, companion = plant()
    pilot.start_in_air(height_m)
    stream(companion, 0.1, HOVER)
    companion.command(SET_MODE, *OFFBOARD)
    stream(companion, 0.2, HOVER)
    assert pilot.commander.mode is FlightMode.OFFBOARD
    return pilot, companion


def landed_states(heard: list[Any]) -> list[int]:
    return [m.landed_state for m in heard if m.get_type() == "EXTENDED_SYS_STATE"]


def tilt_deg(pilot: Autopilot) -> float:
    _, x, y, _ = pilot.truth().q_wxyz
    return math.degrees(math.acos(1.0 - 2.0 * (x * x + y * y)))
