"""A scripted autopilot on a real socket, and `companion run` against it."""

import math
import re
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import development as mavlink

ROOT = Path(__file__).resolve().parents[2]
RIG = ROOT / "config" / "antx_rig.yaml"
SLOW = ["--uncertified", "--set", "tick.rate_hz=100", "--set", "tick.floor_hz=60", "--set", "mission.duration_s=60",
        "--set", "guards.heartbeat_age_s.limit=1.0"]  # fmt: skip
OFFBOARD, HOLD, POSITION, RETURN = 6 << 16, 4 << 16 | 3 << 24, 3 << 16, 4 << 16 | 5 << 24


class Autopilot(threading.Thread):
    """Says what it is told to say at 100 Hz, and keeps what it hears."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(0.0)
        self.port = self.socket.getsockname()[1]
        self.mav = mavlink.MAVLink(None, 1, 1)
        self.parser = mavlink.MAVLink(None)
        self.parser.robust_parsing = True
        self.pose: Callable[[int], list[mavlink.MAVLink_message]] = odometry
        self.heartbeats = self.tells_mode = True
        self.status = mavlink.MAV_STATE_ACTIVE
        self.armed = True
        self.intended: int | None = None  # where it is not the mode
        self.mode = HOLD
        self.switches = True  # its pilot, to OFFBOARD, as soon as there is a stream to fly
        self.obeys = True
        self.pilot_after_hold = False
        self.late_s = 0.0  # of its answers to TIMESYNC
        self.answers_timesync, self.tells_estimator = True, False
        self.timesync: list[tuple[float, mavlink.MAVLink_message]] = []
        self.began_s = time.monotonic()
        self.heard: list[mavlink.MAVLink_message] = []
        self.answers: list[mavlink.MAVLink_message] = []
        self.running = True

    def run(self) -> None:
        peer, began, k = None, self.began_s, 0
        while self.running:
            try:
                while True:
                    data, peer = self.socket.recvfrom(2048)
                    for message in self.parser.parse_buffer(data) or []:
                        self._hear(message)
            except BlockingIOError:
                pass
            if peer is not None:
                for message in self._words(k, round((time.monotonic() - began) * 1e6)):
                    self.socket.sendto(message.pack(self.mav), peer)
            k += 1
            time.sleep(max(0.0, began + 0.01 * k - time.monotonic()))

    def _words(self, k: int, time_us: int) -> list[mavlink.MAVLink_message]:
        now = time.monotonic()
        due = [answer for due_s, answer in self.timesync if due_s <= now]
        self.timesync = [entry for entry in self.timesync if entry[0] > now]
        words = [*self.pose(time_us), *self.answers, *due]
        self.answers.clear()
        if k % 20 == 0 and self.heartbeats:
            armed = mavlink.MAV_MODE_FLAG_SAFETY_ARMED * self.armed | mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
            words.append(mavlink.MAVLink_heartbeat_message(2, 12, armed, self.mode, self.status, 3))
        if k % 20 == 0 and self.tells_estimator:
            words.append(mavlink.MAVLink_estimator_status_message(0, 0b1101111111, *[0.1] * 8))
        if k % 5 == 0 and self.tells_mode:
            words.append(mavlink.MAVLink_current_mode_message(0, self.mode, self.intended or self.mode))
        return words

    def _hear(self, message: mavlink.MAVLink_message) -> None:
        self.heard.append(message)
        if message.get_type() == "SET_ATTITUDE_TARGET" and self.switches:
            self.switches, self.mode = False, OFFBOARD
        if message.get_type() == "TIMESYNC" and self.answers_timesync:
            answer = mavlink.MAVLink_timesync_message(1, message.ts1)
            self.timesync.append((time.monotonic() + self.late_s, answer))
        if message.get_type() == "COMMAND_LONG" and message.command == 176 and self.obeys:
            self.mode = int(message.param2) << 16 | int(message.param3) << 24
            self.answers.append(mavlink.MAVLink_command_ack_message(176, 0))
            if self.pilot_after_hold:
                self.mode = POSITION

    def setpoints(self) -> list[mavlink.MAVLink_message]:
        return [m for m in self.heard if m.get_type() == "SET_ATTITUDE_TARGET"]


def odometry(time_us: int, x: float = 0.0, resets: int = 0, variance: float = 0.01) -> list[mavlink.MAVLink_message]:
    pose, velocity = [variance] * 21, [math.nan] * 21
    q = [1, 0, 0, 0]
    return [mavlink.MAVLink_odometry_message(time_us, 1, 1, x, 0, 0, q, 0, 0, 0, 0, 0, 0, pose, velocity, resets)]


def position_and_attitude(time_us: int) -> list[mavlink.MAVLink_message]:
    ms = time_us // 1000
    return [
        mavlink.MAVLink_attitude_quaternion_message(ms, 1, 0, 0, 0, 0, 0, 0),
        mavlink.MAVLink_local_position_ned_message(ms, 0, 0, 0, 0, 0, 0),
    ]


class Forged(mavlink.MAVLink_heartbeat_message):
    """A heartbeat of another system that claims Hold."""

    def __init__(self, sender: mavlink.MAVLink) -> None:
        super().__init__(2, 12, 0, HOLD, 4, 3)
        self.sender = sender

    def pack(self, _: mavlink.MAVLink) -> bytes:
        return bytes(super().pack(self.sender))


@contextmanager
def flown(tmp_path: Path, *arguments: str) -> Iterator[tuple[Autopilot, "subprocess.Popen[str]"]]:
    autopilot = Autopilot()
    link = f"udpout://127.0.0.1:{autopilot.port}"
    command = [sys.executable, "-u", "-m", "companion", "run", str(RIG), "--link", link, "--out", str(tmp_path), *SLOW]
    process = subprocess.Popen(
        [*command, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT
    )
    try:
        yield autopilot, process
    finally:
        autopilot.running = False
        if autopilot.is_alive():
            autopilot.join()
        autopilot.socket.close()
        process.kill()
        process.communicate()


def until(process: "subprocess.Popen[str]", pattern: str) -> str:
    assert process.stdout is not None
    for line in process.stdout:
        if re.search(pattern, line):
            return line
    pytest.fail(f"ended without {pattern!r}")


def commands(autopilot: Autopilot, number: int) -> list[mavlink.MAVLink_message]:
    return [m for m in autopilot.heard if m.get_type() == "COMMAND_LONG" and m.command == number]


def statuses(autopilot: Autopilot) -> list[int]:
    """The companion's own system statuses, in order of appearance."""
    return list(dict.fromkeys(m.system_status for m in autopilot.heard if m.get_type() == "HEARTBEAT"))
