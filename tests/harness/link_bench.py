"""A flight's link on the bench: its wire and its log are lists, and what comes over it is written by the test."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from companion.config import Config, load_config
from companion.control.types import PositionSetpoint
from companion.flight.host.clock import Clock
from companion.flight.vehicle_link.link import VehicleLink
from companion.mavlink.codec import FrameParser, Layout
from companion.mavlink.signing import Signing

ROOT = Path(__file__).resolve().parents[2]
RIG = ROOT / "config" / "antx_rig.yaml"
STEERING = (
    "steering.enabled=true", "steering.system_ids=[255]", "controller.anchor=setpoint",
    "controller.limits.speed_m_s=0.3",
    "guards.fence={enabled: true, radius_m: 5, lower_ned_m: [-5, -5, -5], upper_ned_m: [5, 5, 5]}",
)  # fmt: skip
KEY = bytes(range(1, 33))
OFFBOARD = 6 << 16
TIMESYNC = Layout("TIMESYNC")


class Wire:
    """A link without a wire."""

    stream = False
    name = "wire"

    def __init__(self) -> None:
        self.sent: list[bytes] = []
        self.locked = 0

    def receive(self) -> bytes:
        return b""

    def send(self, data: bytes) -> None:
        self.sent.append(data)

    def lock(self) -> None:
        self.locked += 1

    def close(self) -> None: ...


class Log:
    """Keeps what would be recorded."""

    def __init__(self) -> None:
        self.records: list[tuple[int, bytes]] = []

    def add(self, kind: int, time_us: int, data: bytes) -> None:
        self.records.append((kind, data))


def config(*overrides: str) -> Config:
    return load_config(RIG, overrides)


class Bench:
    """A link to the vehicle, its wire and its log."""

    def __init__(self, *overrides: str) -> None:
        self.wire, self.log = Wire(), Log()
        self.link = VehicleLink(config(*overrides), self.wire, self.log, Clock())  # type: ignore[arg-type]

    def hear(self, *frames: bytes) -> list[int]:
        """Message ids believed, every message taken as the process does."""
        for _ in self.link.messages(b"".join(frames)):
            pass
        return [frame.message_id for frame in self.link.heard]

    def prove(self, vehicle: Signing) -> None:
        """Hear a heartbeat of a vehicle that has the key, and its answer to what it is asked."""
        assert self.hear(vehicle.sign(heartbeat())) == []
        assert self.hear(vehicle.sign(packed(mavlink.MAVLink_timesync_message(1, self.asked())))) == []
        (frame,) = FrameParser().feed(self.wire.sent[-1])  # it is asked for a heartbeat: the last may be a recording
        assert frame.message_id == mavlink.MAVLINK_MSG_ID_COMMAND_LONG
        assert self.hear(vehicle.sign(heartbeat())) == [0]

    def asked(self) -> int:
        """The number that the vehicle is to send back."""
        (frame,) = FrameParser().feed(self.wire.sent[-1])
        values = TIMESYNC.named(frame.payload)
        assert (frame.message_id, values["tc1"]) == (TIMESYNC.message_id, 0)
        return int(values["ts1"])

    def steered(self) -> list[float]:
        """Where those who may steer want it, north, since this was last asked."""
        commands = [command.wanted for command in self.link.live_commands()]
        assert all(isinstance(command, PositionSetpoint) for command in commands)
        return [command.x_m for command in commands if isinstance(command, PositionSetpoint)]


def packed(message: Any, system: int = 1, component: int = 1) -> bytes:
    return bytes(message.pack(mavlink.MAVLink(None, srcSystem=system, srcComponent=component)))


def heartbeat(autopilot: int = 12, mode: int = OFFBOARD, **sender: int) -> bytes:
    return packed(mavlink.MAVLink_heartbeat_message(2, autopilot, 0x81, mode, 4, 3), **sender)


def current_mode(mode: int = OFFBOARD, intended: int = OFFBOARD) -> bytes:
    return packed(mavlink.MAVLink_current_mode_message(3, mode, intended))


def target(component: int = 191, x: float = 1.0, **sender: int) -> bytes:
    message = mavlink.MAVLink_set_position_target_local_ned_message(
        0, 1, component, 1, 0xDF8, x, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0
    )
    return packed(message, **{"system": 255, "component": 190, **sender})
