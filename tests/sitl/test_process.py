"""The flight process against a scripted autopilot on a real socket: what it must refuse, and what must end control."""

import contextlib
import math
import os
import re
import signal
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

from companion.record.reader import read_flight

ROOT = Path(__file__).resolve().parents[2]
RIG = ROOT / "config" / "antx_rig.yaml"
SLOW = ["--uncertified", "--set", "tick.rate_hz=100", "--set", "tick.floor_hz=60", "--set", "mission.duration_s=60",
        "--set", "guards.heartbeat_age_s.limit=1.0"]  # fmt: skip
OFFBOARD, HOLD, POSITION = 6 << 16, 4 << 16 | 3 << 24, 3 << 16


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
        self.heartbeats = True
        self.mode = OFFBOARD
        self.obeys = True
        self.pilot_after_hold = False
        self.heard: list[mavlink.MAVLink_message] = []
        self.answers: list[mavlink.MAVLink_message] = []
        self.running = True

    def run(self) -> None:
        peer, began, k = None, time.monotonic(), 0
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
        words = [*self.pose(time_us), *self.answers]
        self.answers.clear()
        if k % 20 == 0 and self.heartbeats:
            armed = mavlink.MAV_MODE_FLAG_SAFETY_ARMED | mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
            words.append(mavlink.MAVLink_heartbeat_message(2, 12, armed, self.mode, 4, 3))
        return words

    def _hear(self, message: mavlink.MAVLink_message) -> None:
        self.heard.append(message)
        if message.get_type() == "COMMAND_LONG" and message.command == 176 and self.obeys:
            self.mode = int(message.param2) << 16 | int(message.param3) << 24
            self.answers.append(mavlink.MAVLink_command_ack_message(176, 0))
            if self.pilot_after_hold:
                self.mode = POSITION

    def setpoints(self) -> list[mavlink.MAVLink_message]:
        return [m for m in self.heard if m.get_type() == "SET_ATTITUDE_TARGET"]


def odometry(time_us: int, x: float = 0.0) -> list[mavlink.MAVLink_message]:
    none = [math.nan] * 21
    return [mavlink.MAVLink_odometry_message(time_us, 1, 1, x, 0, 0, [1, 0, 0, 0], 0, 0, 0, 0, 0, 0, none, none)]


def position_and_attitude(time_us: int) -> list[mavlink.MAVLink_message]:
    ms = time_us // 1000
    return [
        mavlink.MAVLink_attitude_quaternion_message(ms, 1, 0, 0, 0, 0, 0, 0),
        mavlink.MAVLink_local_position_ned_message(ms, 0, 0, 0, 0, 0, 0),
    ]


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


def test_position_and_attitude_serve_where_odometry_is_absent(tmp_path: Path) -> None:
    with flown(tmp_path) as (autopilot, process):
        autopilot.pose = position_and_attitude
        autopilot.start()
        assert "LOCAL_POSITION_NED" in until(process, "^engaged")


def test_not_a_number_ends_control_and_is_never_sent(tmp_path: Path) -> None:
    with flown(tmp_path) as (autopilot, process):
        autopilot.start()
        until(process, "^engaged")
        autopilot.pose = lambda time_us: odometry(time_us, math.nan)
        assert "pose_invalid" in until(process, "^released")
        assert process.wait(5.0) == 1
        assert autopilot.mode == HOLD
        assert all(math.isfinite(v) for m in autopilot.setpoints() for v in (*m.q, m.thrust))


def test_silent_odometry_ends_control_then_hold_then_silence(tmp_path: Path) -> None:
    with flown(tmp_path) as (autopilot, process):
        autopilot.start()
        until(process, "^engaged")
        autopilot.pose = lambda _: []
        stopped_s = time.monotonic()
        assert "pose_stale" in until(process, "^released")
        assert 0.2 < time.monotonic() - stopped_s < 2.5
        assert process.wait(5.0) == 1
        last = [m.get_type() for m in autopilot.heard[-3:]]
        assert "SET_ATTITUDE_TARGET" not in last[-1:]
        assert any(m.get_type() == "STATUSTEXT" and "pose_stale" in m.text for m in autopilot.heard)


def test_lost_heartbeat_ends_control(tmp_path: Path) -> None:
    with flown(tmp_path) as (autopilot, process):
        autopilot.start()
        until(process, "^engaged")
        autopilot.heartbeats = False
        assert "heartbeat_lost" in until(process, "^released")
        assert process.wait(5.0) == 1


def test_a_vehicle_that_does_not_obey_is_met_with_silence(tmp_path: Path) -> None:
    with flown(tmp_path) as (autopilot, process):
        autopilot.obeys = False
        autopilot.start()
        until(process, "^engaged")
        autopilot.pose = lambda _: []
        until(process, "^released")
        assert process.wait(5.0) == 1
        asked = [m for m in autopilot.heard if m.get_type() == "COMMAND_LONG" and m.command == 176]
        assert len(asked) > 3
        assert {m.param2 for m in asked} == {4.0}


def test_odometry_below_the_floor_is_refused_with_the_rate_measured(tmp_path: Path) -> None:
    with flown(tmp_path, "--set", "tick.floor_hz=99.9", "--set", "tick.rate_hz=200") as (autopilot, process):
        autopilot.pose = lambda time_us: odometry(time_us) if time_us // 10_000 % 2 else []
        autopilot.start()
        assert process.wait(20.0) == 2
        assert process.stderr is not None
        _, complaint = process.stderr.read().splitlines()  # the first says that the flight is uncertified
        assert re.fullmatch(r"companion: ODOMETRY arrives at [\d.]+ Hz, tick\.floor_hz is 99\.9: .*", complaint)
        assert not autopilot.setpoints()  # nothing was streamed to a vehicle that was refused, nothing asked of it
        assert autopilot.mode == OFFBOARD


def test_others_on_the_link_are_not_believed(tmp_path: Path) -> None:
    with flown(tmp_path) as (autopilot, process):
        autopilot.start()
        until(process, "^engaged")
        forger = mavlink.MAVLink(None, 7, 1)
        autopilot.pose = lambda time_us: [*odometry(time_us), Forged(forger)]
        time.sleep(1.0)
        assert process.poll() is None
        autopilot.mode = HOLD
        assert "mode_changed" in until(process, "^released")
    (folder,) = tmp_path.iterdir()
    assert read_flight(folder).events[-1].name == "released_mode_changed"


class Forged(mavlink.MAVLink_heartbeat_message):
    """A heartbeat of another system that claims Hold."""

    def __init__(self, sender: mavlink.MAVLink) -> None:
        super().__init__(2, 12, 0, HOLD, 4, 3)
        self.sender = sender

    def pack(self, _: mavlink.MAVLink) -> bytes:
        return bytes(super().pack(self.sender))


def test_a_blocked_terminal_does_not_hold_up_the_loop(tmp_path: Path) -> None:
    """A pipe that nobody reads fills up; Ctrl-S does the same to a terminal."""
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    with contextlib.suppress(BlockingIOError):
        while True:
            os.write(writing, b"x" * 4096)
    os.set_blocking(writing, True)
    autopilot = Autopilot()
    link = f"udpout://127.0.0.1:{autopilot.port}"
    command = [sys.executable, "-m", "companion", "run", str(RIG), "--link", link, "--out", str(tmp_path), *SLOW]
    process = subprocess.Popen(command, stdout=writing, stderr=subprocess.DEVNULL, cwd=ROOT)
    try:
        autopilot.start()
        time.sleep(4.0)
        before = len(autopilot.setpoints())
        time.sleep(1.0)
        assert len(autopilot.setpoints()) - before > 60
    finally:
        autopilot.running = False
        process.kill()
        process.wait()
        autopilot.join()
        autopilot.socket.close()
        os.close(reading)
        os.close(writing)


def test_a_jump_of_the_odometry_clock_ends_control_with_its_own_reason(tmp_path: Path) -> None:
    with flown(tmp_path) as (autopilot, process):
        autopilot.start()
        until(process, "^engaged")
        autopilot.pose = lambda time_us: odometry(time_us + 3_600_000_000)
        assert "clock_jump" in until(process, "^released")
        assert process.wait(5.0) == 1


def test_hang_up_hands_over_too(tmp_path: Path) -> None:
    with flown(tmp_path) as (autopilot, process):
        autopilot.start()
        until(process, "^engaged")
        process.send_signal(signal.SIGHUP)
        assert "operator" in until(process, "^released")
        assert process.wait(5.0) == 0
        assert autopilot.mode == HOLD


def test_a_pilot_who_chose_another_mode_after_hold_is_not_overruled(tmp_path: Path) -> None:
    """Without CURRENT_MODE the release sees the change up to a heartbeat late; meanwhile it must not ask again."""
    with flown(tmp_path) as (autopilot, process):
        autopilot.start()
        until(process, "^engaged")
        autopilot.pilot_after_hold = True
        process.send_signal(signal.SIGINT)
        until(process, "^released")
        process.wait(5.0)
        assert autopilot.mode == POSITION


def test_a_vehicle_that_is_armed_already_is_left_to_its_pilot(tmp_path: Path) -> None:
    with flown(tmp_path, "--engage") as (autopilot, process):
        autopilot.mode = POSITION
        autopilot.start()
        assert process.wait(10.0) == 2
        assert process.stderr is not None
        assert "leaves it to its pilot" in process.stderr.read()
        assert autopilot.mode == POSITION
        assert not [m for m in autopilot.heard if m.get_type() == "COMMAND_LONG" and m.command in (176, 400)]
