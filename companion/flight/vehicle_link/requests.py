"""What is asked of the vehicle, as plain records, and the messages that ask it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from companion.flight.vehicle_link.messages import AUTOPILOT_VERSION, ROWS
from companion.flight.vehicle_link.modes import Mode
from companion.flight.vehicle_link.odometry import PoseSource
from companion.mavlink import px4
from companion.mavlink.codec import Layout

HEARTBEAT = Layout("HEARTBEAT")
CURRENT_MODE = Layout("CURRENT_MODE")
_MODE_HZ = 20.0


@dataclass(frozen=True, slots=True)
class Arm:
    """Arm, with PX4's checks."""


@dataclass(frozen=True, slots=True)
class SetMode:
    """Change to a mode."""

    mode: Mode


@dataclass(frozen=True, slots=True)
class TellHeartbeat:
    """A heartbeat now, out of turn."""


@dataclass(frozen=True, slots=True)
class TellFirmware:
    """Which firmware it is."""


@dataclass(frozen=True, slots=True)
class ReadParameter:
    """One parameter by name. PX4 answers an unknown name with silence."""

    name: str


@dataclass(frozen=True, slots=True)
class Stream:
    """Odometry at this rate, and beside it the mode and what else `messages.ROWS` wants to be asked for."""

    odometry_hz: float
    flying: bool = True  # whether also what only a vehicle that flies tells


Request = Arm | SetMode | TellHeartbeat | TellFirmware | ReadParameter | Stream


def encode(request: Request, ids: tuple[int, int], pose: PoseSource) -> list[Any]:
    """The pymavlink messages that ask it of the vehicle with these ids."""
    match request:
        case Arm():
            return [px4.arm(*ids)]
        case SetMode(mode):
            return [px4.set_mode(*ids, mode)]
        case TellHeartbeat():
            return [px4.request_message(*ids, HEARTBEAT.message_id)]
        case TellFirmware():
            return [px4.request_message(*ids, AUTOPILOT_VERSION.message_id)]
        case ReadParameter(name):
            return [px4.read_parameter(*ids, name)]
        case Stream(odometry_hz, flying):
            rates = [(CURRENT_MODE.message_id, _MODE_HZ)]
            rates += [(row.message_id, row.rate_hz) for row in ROWS if row.rate_hz and (flying or not row.flying)]
            rates += [(message_id, odometry_hz) for message_id in pose.message_ids]
            return [px4.message_interval(*ids, message_id, rate_hz) for message_id, rate_hz in rates]
