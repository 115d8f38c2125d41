"""Frames that only the vehicle could have sent, with anything in them: control may end, but for a named reason."""

from __future__ import annotations

import math
import random
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import development as mavlink

from companion.config import load_config
from companion.config.guards.rows import Reason
from companion.flight.process import FlightProcess
from companion.mavlink.codec import Encoder, FrameParser, Layout, crc_extra, mcrf4xx
from companion.mavlink.px4 import Mode

ROOT = Path(__file__).resolve().parents[3]
QUADROTOR = ROOT / "config" / "paper_quadrotor.yaml"
SETTINGS = (
    "tick.rate_hz=100", "tick.floor_hz=50", "mission.duration_s=1000", "steering.enabled=true",
    "steering.system_ids=[255]", "controller.anchor=setpoint", "controller.limits.speed_m_s=0.3",
    "guards.fence={enabled: true, radius_m: 5, lower_ned_m: [-5, -5, -5], upper_ned_m: [5, 5, 5]}",
)  # fmt: skip
ODOMETRY = Layout("ODOMETRY")
SETPOINT = Layout("SET_ATTITUDE_TARGET")
PERIOD_US = 10_000
SETTLE, HOSTILE = 400, 60
MODES, POSE = [0, 436], [331]  # most of these end control at once
OTHERS = [31, 32, 77, 111, 230, 22, 253, 245, 84, 4, 148]  # what the process looks at, and some beside


class Recorder:
    """Keeps nothing."""

    dropped = 0

    def add(self, kind: int, time_us: int, data: bytes) -> None: ...

    def flush(self) -> None: ...


def signed_off(message_id: int, payload: bytes, system: int = 1, component: int = 1) -> bytes:
    """A frame whose CRC is right, whatever is in it."""
    body = bytes([len(payload), 0, 0, 0, system, component]) + message_id.to_bytes(3, "little") + payload
    return b"\xfd" + body + mcrf4xx(body + crc_extra(message_id)).to_bytes(2, "little")


class Vehicle:
    """A link to a vehicle that hovers, obeys, and after a while says anything."""

    stream = False
    name = "scripted"

    def __init__(self, seed: int) -> None:
        self._random = random.Random(seed)
        self._ending = POSE if seed % 2 else MODES + POSE
        self._parser = FrameParser()
        self._packer = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
        self._odometry = Encoder(ODOMETRY, 1, 1)
        self._k = 0
        self._mode = Mode.HOLD
        self._answered = True
        self.hostile = 0
        self.setpoints: list[dict[str, Any]] = []

    def receive(self) -> bytes:
        self._k += 1
        if self._k > SETTLE and self._mode == Mode.OFFBOARD and self.hostile < HOSTILE:
            self.hostile += 1
            return b"".join(self._hostile() for _ in range(self._random.randint(1, 20))) + self._sample()
        return self._words() + self._sample()

    def _words(self) -> bytes:
        base = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | mavlink.MAV_MODE_FLAG_SAFETY_ARMED
        beat = mavlink.MAVLink_heartbeat_message(2, 12, base, self._mode, mavlink.MAV_STATE_ACTIVE, 3)
        mode = mavlink.MAVLink_current_mode_message(0, self._mode, self._mode)
        air = mavlink.MAVLink_extended_sys_state_message(0, mavlink.MAV_LANDED_STATE_IN_AIR)
        flown = mavlink.MAVLink_attitude_target_message(0, 0, [1.0, 0.0, 0.0, 0.0], 0.0, 0.0, 0.0, 0.49)
        return b"".join(bytes(message.pack(self._packer)) for message in (beat, mode, air, flown))

    def _sample(self) -> bytes:
        values = dict.fromkeys(ODOMETRY.fields, 0.0) | {
            "time_usec": 1_000_000 + PERIOD_US * self._k, "q": (1.0, 0.0, 0.0, 0.0), "z": -2.0, "frame_id": 1,
            "child_frame_id": 1, "pose_covariance": (0.01,) * 21, "velocity_covariance": (0.01,) * 21,
            "reset_counter": 0, "estimator_type": 0, "quality": 100,
        }  # fmt: skip
        wire: list[float] = []
        for name in ODOMETRY.fields:
            value = values[name]
            wire.extend(value if isinstance(value, tuple) else (value,))
        return self._odometry.encode(self._k, *wire)

    def _hostile(self) -> bytes:
        """Anything in the vehicle's name, or a command of somebody who may steer."""
        chosen = self._random
        if chosen.random() < 0.2:
            return signed_off(84, chosen.randbytes(50) + bytes([1, 191, chosen.choice([1, 1, 7])]), 255, 190)
        payload = (
            chosen.choice([b"\xff", b"\x00", b"\x7f", b""]) * 255 if chosen.random() < 0.2 else chosen.randbytes(255)
        )
        return signed_off(
            chosen.choice(self._ending if chosen.random() < 0.01 else OTHERS), payload[: chosen.randint(0, 255)]
        )

    def send(self, data: bytes) -> None:
        for frame in self._parser.feed(data):
            if frame.message_id == SETPOINT.message_id:
                self.setpoints.append(SETPOINT.named(frame.payload))
                if self._k > SETTLE - 50 and self._mode == Mode.HOLD:
                    self._mode = Mode.OFFBOARD

    def lock(self) -> None: ...

    def close(self) -> None: ...


@pytest.mark.parametrize("seed", range(40))
def test_nothing_the_vehicle_could_say_is_an_error_of_ours_or_makes_us_send_nonsense(seed: int) -> None:
    vehicle = Vehicle(seed)
    process = FlightProcess(load_config(QUADROTOR, SETTINGS), vehicle, Recorder(), lockstep=True)  # type: ignore[arg-type]
    receive = vehicle.receive

    def until_over() -> bytes:
        if vehicle.hostile >= HOSTILE:
            process.stop()
        return receive()

    vehicle.receive = until_over  # type: ignore[method-assign]
    summary = process.run()
    assert vehicle.hostile > 0, summary
    assert summary.engaged, summary
    assert summary.reason is not Reason.INTERNAL_ERROR, summary
    for setpoint in vehicle.setpoints:
        assert math.isclose(sum(q * q for q in setpoint["q"]), 1.0, rel_tol=1e-4)
        assert 0.0 <= setpoint["thrust"] <= 0.95
        assert setpoint["type_mask"] == 7
