"""A companion computer that speaks plain pymavlink to the plant: over UDP, or in memory and in simulated time."""

from __future__ import annotations

import math
import socket
import time
from collections.abc import Callable
from typing import Any, Final

from pymavlink.dialects.v20 import development as mavlink

from harness.processes import PATIENCE_S
from sitl.autopilot.autopilot import PHYSICS_DT_US, Autopilot
from sitl.autopilot.modes import FlightMode, custom_mode
from sitl.messages.streams import Profile
from sitl.wire.memory import MemoryPort
from sitl.wire.plant import FIXED_EPOCH_US, Plant

HOVER: Final = 0.5
NAN: Final = math.nan


class Client:
    """What both have in common. Attributes: `raw`, the datagrams heard; `patience_s`, for an answer."""

    patience_s = PATIENCE_S

    def __init__(self, component_id: int = 191) -> None:
        self.mav = mavlink.MAVLink(None, srcSystem=1, srcComponent=component_id)
        self.mav.robust_parsing = True
        self.raw: list[bytes] = []
        self._waiting: list[Any] = []

    def now_s(self) -> float:
        """On the clock that its patience goes by."""
        raise NotImplementedError

    def send_raw(self, data: bytes) -> None:
        """One datagram to the plant."""
        raise NotImplementedError

    def receive_raw(self, timeout_s: float) -> bytes:
        """The next datagram; empty where none came in time."""
        raise NotImplementedError

    def send(self, message: Any) -> None:
        self.send_raw(bytes(message.pack(self.mav)))
        self.mav.seq = (self.mav.seq + 1) & 255

    def command(self, number: int, *parameters: float, target: tuple[int, int] = (1, 1)) -> None:
        filled = [*parameters, *[0.0] * (7 - len(parameters))]
        self.send(mavlink.MAVLink_command_long_message(*target, number, 0, *filled))

    def setpoint(self, q_wxyz: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0), thrust: float = HOVER, ms: int = 0) -> None:
        q = list(q_wxyz)
        self.send(mavlink.MAVLink_set_attitude_target_message(ms, 1, 1, 7, q, 0.0, 0.0, 0.0, thrust))

    def heartbeat(self, kind: int = mavlink.MAV_TYPE_ONBOARD_CONTROLLER) -> None:
        self.send(mavlink.MAVLink_heartbeat_message(kind, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 4, 3))

    def receive(self, timeout_s: float) -> list[Any]:
        """Messages of the next datagram."""
        data = self.receive_raw(timeout_s)
        if not data:
            return []
        self.raw.append(data)
        return self.mav.parse_buffer(data) or []

    def wait(self, name: str, matches: Callable[[Any], bool] = lambda _: True, timeout_s: float | None = None) -> Any:
        """The next message of a name that matches; what else comes is dropped."""
        patience_s = self.patience_s if timeout_s is None else timeout_s
        deadline = self.now_s() + patience_s
        while True:
            while self._waiting:
                message = self._waiting.pop(0)
                if message.get_type() == name and matches(message):
                    return message
            left = deadline - self.now_s()
            assert left > 0.0, f"no {name} within {patience_s} s"
            self._waiting = self.receive(left)

    def collect(self, seconds: float, keep: Callable[[], None] = lambda: None) -> list[Any]:
        """Everything that comes within a while; `keep` is called in between."""
        end = self.now_s() + seconds
        found, self._waiting = self._waiting, []
        while (left := end - self.now_s()) > 0.0:
            keep()
            found += self.receive(min(left, 0.02))
        return found

    def acknowledged(self, number: int) -> int:
        answer = self.wait("COMMAND_ACK", lambda m: m.command == number)
        assert (answer.target_system, answer.target_component) == (1, 191)
        result: int = answer.result
        return result

    def until_mode(self, mode: FlightMode, timeout_s: float | None = None) -> Any:
        return self.wait("CURRENT_MODE", lambda m: m.custom_mode == custom_mode(mode), timeout_s)


class UdpClient(Client):
    """On a socket of its own."""

    def __init__(self, port: int, component_id: int = 191) -> None:
        super().__init__(component_id)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._to = ("127.0.0.1", port)

    def close(self) -> None:
        self._socket.close()

    def now_s(self) -> float:
        return time.monotonic()

    def send_raw(self, data: bytes) -> None:
        self._socket.sendto(data, self._to)

    def receive_raw(self, timeout_s: float) -> bytes:
        self._socket.settimeout(max(timeout_s, 1e-6))
        try:
            return self._socket.recv(65536)
        except (TimeoutError, BlockingIOError):
            return b""


class MemoryClient(Client):
    """On a port in memory. While it waits, simulated time passes; at no other time."""

    patience_s = 8.0

    def __init__(self, plant: Plant, port: MemoryPort, component_id: int = 191) -> None:
        super().__init__(component_id)
        self._plant, self._port = plant, port

    def now_s(self) -> float:
        return 1e-6 * self._plant.autopilot.time_us

    def send_raw(self, data: bytes) -> None:
        self._port.incoming.append(data)
        self._plant.receive_all()

    def receive_raw(self, timeout_s: float) -> bytes:
        plant, autopilot = self._plant, self._plant.autopilot
        until_us = autopilot.time_us + max(round(1e6 * timeout_s), PHYSICS_DT_US)
        while not self._port.outgoing and autopilot.time_us + PHYSICS_DT_US <= until_us:
            due_us = max(min(wire.due_us for wire in plant.wires), autopilot.time_us + PHYSICS_DT_US)
            plant.advance(min(until_us, due_us))
        return self._port.outgoing.popleft() if self._port.outgoing else b""


def clients(pilot: Autopilot, *ends: tuple[Profile, int]) -> list[MemoryClient]:
    """A plant that goes by its own clock, and a client at the end of each wire: of this profile, of this component."""
    plant = Plant(pilot, FIXED_EPOCH_US)
    found = []
    for profile, component_id in ends:
        port = MemoryPort()
        plant.add(port, profile)
        found.append(MemoryClient(plant, port, component_id))
    return found
