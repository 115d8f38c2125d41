"""The driver: an autopilot, armed, in OFFBOARD once it is streamed to, that sends odometry and times the answers."""

from __future__ import annotations

import contextlib
import math
import socket
import struct
import time
from collections.abc import Iterator
from typing import NamedTuple

import harness_path  # noqa: F401 - finds `harness`
from harness.fake_autopilot import FakeAutopilot
from pymavlink.dialects.v20 import development as mavlink

from companion.mavlink.codec import Encoder, Layout

ODOMETRY = Layout("ODOMETRY")
SET_ATTITUDE_TARGET = Layout("SET_ATTITUDE_TARGET")
_PAYLOAD = 10  # where it begins in a frame
_HEARTBEAT_S = 0.5
_MODE_S = 0.05
_TIMEOUT_S = 0.1
_DATAGRAM_BYTES = 2048


class Answer(NamedTuple):
    """How a candidate's answer to one sample is known: message, and bytes in it that repeat a part of the sample."""

    message_id: int
    at: slice
    repeats_time: bool  # the sample's time in milliseconds; or else its x, as sent


BY_TIME = Answer(SET_ATTITUDE_TARGET.message_id, slice(_PAYLOAD, _PAYLOAD + 4), True)
BY_THRUST = Answer(SET_ATTITUDE_TARGET.message_id, slice(_PAYLOAD + 32, _PAYLOAD + 36), False)
BY_ECHO = Answer(ODOMETRY.message_id, slice(_PAYLOAD + 8, _PAYLOAD + 12), False)


class Timing(NamedTuple):
    """Latencies of the samples answered, and how many were not in time."""

    latencies_us: list[float]
    lost: int


class Autopilot(FakeAutopilot):
    """The tests' fake autopilot with samples that move, spoken to whoever listens on a UDP port of this machine."""

    def __init__(self, port: int) -> None:
        super().__init__()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.connect(("127.0.0.1", port))
        # A kernel timeout: Python's own would poll before each receive, and that would count as the candidate's time.
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, struct.pack("ll", 0, int(_TIMEOUT_S * 1e6)))
        self._odometry = Encoder(ODOMETRY, 1, 1)
        self._sequence = 0  # of the samples; what is said beside them counts for itself
        self._unheard: list[bytes] = []  # what came beside the answers: taken in between two samples
        self._time_us = 10_000_000
        self._heartbeat_at_s = self._mode_at_s = 0.0

    def play(self, rate_hz: float, seconds: float) -> None:
        """Send odometry at a rate, whether it is answered or not."""
        for _ in self._due(rate_hz, seconds):
            self._drain()
            self._put(self._sample(rate_hz))
            self._beside()

    def time(self, rate_hz: float, seconds: float, answer: Answer) -> Timing:
        """The same, and wait for each answer. A late one delays the next sample: there are never two at once."""
        latencies: list[float] = []
        lost = 0
        clock, send, receive = time.perf_counter_ns, self._socket.send, self._receive
        want_id, at = answer.message_id.to_bytes(3, "little"), answer.at
        for _ in self._due(rate_hz, seconds):
            self._drain()
            frame = self._sample(rate_hz)
            key = struct.pack("<I", self._time_us // 1000) if answer.repeats_time else frame[BY_ECHO.at]
            began_ns = clock()
            send(frame)
            while data := receive():
                ended_ns = clock()
                if data[at] == key and data[7:10] == want_id:
                    latencies.append((ended_ns - began_ns) * 1e-3)
                    break
                self._unheard.append(data)
            else:
                lost += 1
            self._beside()
        return Timing(latencies, lost)

    def close(self) -> None:
        self._socket.close()

    def _due(self, rate_hz: float, seconds: float) -> Iterator[None]:
        """Wake up at the rate, and end when the next is due; what has been missed by more than a period is lost."""
        period_s = 1.0 / rate_hz
        due_s = time.monotonic()
        until_s = due_s + seconds
        while due_s < until_s:
            time.sleep(max(0.0, due_s - time.monotonic()))
            yield
            due_s = max(due_s + period_s, time.monotonic() - period_s)
        time.sleep(max(0.0, due_s - time.monotonic()))  # what follows is due then: the vehicle's clock runs as ours

    def _sample(self, rate_hz: float) -> bytes:
        """The next ODOMETRY: a slow circle at 1 m."""
        self._time_us += round(1e6 / rate_hz)
        t = self._time_us * 1e-6
        x, y = 0.1 * math.sin(0.7 * t), 0.1 * math.cos(0.7 * t)
        vx, vy = 0.07 * math.cos(0.7 * t), -0.07 * math.sin(0.7 * t)
        tilt = 0.5 * 0.03 * math.sin(0.7 * t)  # half angle
        values: dict[str, float | tuple[float, ...]] = {
            "time_usec": self._time_us, "x": x, "y": y, "z": -1.0 + 0.01 * math.sin(t),
            "q": (math.cos(tilt), 0.0, math.sin(tilt), 0.0), "vx": vx, "vy": vy, "vz": 0.01 * math.cos(t),
            "rollspeed": 0.0, "pitchspeed": 0.02 * math.cos(0.7 * t), "yawspeed": 0.0,
            "pose_covariance": (0.01,) * 21, "velocity_covariance": (0.01,) * 21,
            "frame_id": 1, "child_frame_id": 1, "reset_counter": 0, "estimator_type": 0, "quality": 100,
        }  # fmt: skip
        wire: list[float] = []
        for field in ODOMETRY.fields:
            value = values[field]
            wire.extend(value if isinstance(value, tuple) else (value,))
        self._sequence = self._sequence + 1 & 255
        return self._odometry.encode(self._sequence, *wire)

    def _beside(self) -> None:
        """Heartbeat, mode and answers, after the sample's so that they cost none its time."""
        for data in self._unheard:
            self.hear(data)
        self._unheard.clear()
        self.heard.clear()
        now_s = time.monotonic()
        if now_s - self._heartbeat_at_s > _HEARTBEAT_S:
            self._heartbeat_at_s = now_s
            self.answers.append(self.heartbeat())
        if now_s - self._mode_at_s > _MODE_S:
            self._mode_at_s = now_s
            self.answers.append(self.current_mode())
            level = [1.0, 0.0, 0.0, 0.0]  # in the air, and its thrust says so too: otherwise nobody takes control
            self.answers.append(mavlink.MAVLink_extended_sys_state_message(0, mavlink.MAV_LANDED_STATE_IN_AIR))
            self.answers.append(mavlink.MAVLink_attitude_target_message(0, 0, level, 0.0, 0.0, 0.0, 0.5))
        for message in self.answers:
            self._put(self.pack(message))
        self.answers.clear()

    def _drain(self) -> None:
        while data := self._receive(socket.MSG_DONTWAIT):
            self._unheard.append(data)

    def _receive(self, flags: int = 0) -> bytes:
        try:
            return self._socket.recv(_DATAGRAM_BYTES, flags)
        except (BlockingIOError, ConnectionRefusedError):
            return b""

    def _put(self, frame: bytes) -> None:
        with contextlib.suppress(ConnectionRefusedError):  # nobody listens yet
            self._socket.send(frame)
