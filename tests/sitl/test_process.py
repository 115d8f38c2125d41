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
from itertools import pairwise
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import development as mavlink

from companion.config import load_config
from companion.control.types import AttitudeSetpoint, Odometry
from companion.flight import shared
from companion.flight.authority import Reason
from companion.flight.pilot import Pilot
from companion.flight.process import FlightProcess
from companion.mavlink.link import open_link
from companion.record.folder import open_folder
from companion.record.reader import read_flight

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
        assert "estimator_jump_m" in until(process, "^guard cannot see: estimator_jump")
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
        assert autopilot.mode == HOLD


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
        until_s = time.monotonic() + 30.0
        while not autopilot.setpoints() and time.monotonic() < until_s:
            time.sleep(0.1)
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
        autopilot.tells_mode, autopilot.mode = False, POSITION
        autopilot.start()
        until(process, "^engaged")
        autopilot.pilot_after_hold = True
        process.send_signal(signal.SIGINT)
        until(process, "^released")
        process.wait(5.0)
        assert autopilot.mode == POSITION


def test_a_vehicle_that_is_armed_already_is_left_to_its_pilot(tmp_path: Path) -> None:
    with flown(tmp_path, "--engage") as (autopilot, process):
        autopilot.mode, autopilot.switches = POSITION, False
        autopilot.start()
        assert process.wait(10.0) == 2
        assert process.stderr is not None
        assert "leaves it to its pilot" in process.stderr.read()
        assert autopilot.mode == POSITION
        assert not [m for m in autopilot.heard if m.get_type() == "COMMAND_LONG" and m.command in (176, 400)]


def commands(autopilot: Autopilot, number: int) -> list[mavlink.MAVLink_message]:
    return [m for m in autopilot.heard if m.get_type() == "COMMAND_LONG" and m.command == number]


def statuses(autopilot: Autopilot) -> list[int]:
    """The companion's own system statuses, in order of appearance."""
    return list(dict.fromkeys(m.system_status for m in autopilot.heard if m.get_type() == "HEARTBEAT"))


@pytest.mark.parametrize(("mode", "intended"), [(OFFBOARD, OFFBOARD), (RETURN, OFFBOARD)], ids=["flown", "failsafe"])
def test_after_a_restart_in_flight_it_sends_nothing_until_a_mode_is_chosen(
    mode: int, intended: int, tmp_path: Path
) -> None:
    with flown(tmp_path, "--engage") as (autopilot, process):
        autopilot.mode, autopilot.intended, autopilot.switches = mode, intended, False
        autopilot.start()
        assert "hands off" in until(process, "^standby")
        time.sleep(1.0)
        assert not autopilot.setpoints()
        assert not commands(autopilot, 176)
        assert not commands(autopilot, 400)
        assert process.poll() is None
        autopilot.mode, autopilot.intended = POSITION, None  # the pilot chooses
        until(process, "no longer hands off")
        time.sleep(0.3)
        assert autopilot.setpoints()
        autopilot.mode = OFFBOARD  # and switches
        until(process, "^engaged")
        assert not commands(autopilot, 176)


@pytest.mark.parametrize("mode", [RETURN, HOLD], ids=["return", "hold"])
def test_where_intentions_are_not_told_only_sticks_are_a_pilot(mode: int, tmp_path: Path) -> None:
    """A PX4 before 1.15: Return may be its failsafe, and a stream would put it back into OFFBOARD."""
    with flown(tmp_path) as (autopilot, process):
        autopilot.mode, autopilot.tells_mode = mode, False  # back to OFFBOARD as soon as it is streamed to
        autopilot.start()
        assert "take the sticks or disarm first" in until(process, "^standby")
        time.sleep(1.0)
        assert (autopilot.setpoints(), autopilot.mode) == ([], mode)
        autopilot.switches, autopilot.mode = False, POSITION
        until(process, "no longer hands off")
        time.sleep(0.3)
        assert autopilot.setpoints()


def test_a_vehicle_that_landed_in_offboard_is_not_streamed_to_until_another_mode_is_chosen(tmp_path: Path) -> None:
    with flown(tmp_path) as (autopilot, process):
        autopilot.mode, autopilot.armed, autopilot.switches = OFFBOARD, False, False
        autopilot.start()
        assert "choose another mode first" in until(process, "^standby")
        time.sleep(0.5)
        autopilot.armed = True  # by somebody who does not know
        time.sleep(0.7)
        assert not autopilot.setpoints()
        assert process.poll() is None
        autopilot.mode = POSITION
        until(process, "no longer hands off")
        time.sleep(0.3)
        autopilot.mode = OFFBOARD
        until(process, "^engaged")


def test_engaging_what_reads_offboard_on_the_ground_is_refused(tmp_path: Path) -> None:
    with flown(tmp_path, "--engage") as (autopilot, process):
        autopilot.mode, autopilot.armed, autopilot.switches = OFFBOARD, False, False
        autopilot.start()
        assert process.wait(10.0) == 2
        assert process.stderr is not None
        assert "choose another mode first" in process.stderr.read()
        assert not commands(autopilot, 400)


def test_a_failsafe_of_the_vehicle_is_told_from_a_pilot(tmp_path: Path) -> None:
    with flown(tmp_path) as (autopilot, process):
        autopilot.start()
        until(process, "^engaged")
        autopilot.mode, autopilot.intended = RETURN, OFFBOARD
        line = until(process, "^released")
        assert "mode_changed" in line
        assert "failsafe of the vehicle" in line
        assert "RETURN" in line
        assert process.wait(5.0) == 1
        assert not commands(autopilot, 176)


def test_a_pilot_who_takes_over_is_no_fault(tmp_path: Path) -> None:
    with flown(tmp_path) as (autopilot, process):
        autopilot.start()
        until(process, "^engaged")
        autopilot.mode = POSITION
        assert "the pilot chose POSITION" in until(process, "^released")
        assert process.wait(5.0) == 0
        count = len(autopilot.setpoints())
        time.sleep(0.3)
        assert len(autopilot.setpoints()) == count
        assert not commands(autopilot, 176)


def test_kill_has_its_own_name_though_the_mode_stays(tmp_path: Path) -> None:
    with flown(tmp_path) as (autopilot, process):
        autopilot.start()
        until(process, "^engaged")
        autopilot.status = mavlink.MAV_STATE_FLIGHT_TERMINATION
        assert "killed" in until(process, "^released")
        assert process.wait(5.0) == 1
        assert not commands(autopilot, 176)
        assert any(m.get_type() == "STATUSTEXT" and "killed" in m.text for m in autopilot.heard)


@pytest.mark.parametrize(("name", "mode"), [("land", 4 << 16 | 6 << 24), ("return", RETURN), ("position", POSITION)])
def test_the_release_mode_is_the_configs(name: str, mode: int, tmp_path: Path) -> None:
    with flown(tmp_path, "--set", f"release.mode={name}") as (autopilot, process):
        autopilot.start()
        until(process, "^engaged")
        process.send_signal(signal.SIGINT)
        until(process, "^released")
        assert process.wait(5.0) == 0
        assert autopilot.mode == mode


def test_a_small_reset_is_flown_through_and_a_large_one_ends_control(tmp_path: Path) -> None:
    with flown(tmp_path) as (autopilot, process):
        autopilot.start()
        until(process, "^engaged")
        time.sleep(0.5)
        autopilot.pose = lambda time_us: odometry(time_us, 0.4, resets=1)
        time.sleep(0.5)
        before = autopilot.setpoints()[-80:]
        assert process.poll() is None
        autopilot.pose = lambda time_us: odometry(time_us, 2.0, resets=2)
        assert "estimator_jump" in until(process, "^released")
        assert process.wait(5.0) == 1
    steps = [math.dist(a.q, b.q) for a, b in pairwise(before)]
    assert math.degrees(2.0 * max(steps)) < 1.0
    (folder,) = tmp_path.iterdir()
    assert [e.detail for e in read_flight(folder).events if e.name == "reseated"] == ["the estimator reset, 0.40 m"]


def test_small_resets_that_come_again_and_again_end_control(tmp_path: Path) -> None:
    with flown(tmp_path, "--set", "guards.velocity_consistency_m.enabled=false") as (autopilot, process):
        autopilot.start()
        until(process, "^engaged")
        began_us = round(1e6 * (time.monotonic() - autopilot.began_s))

        def walking(time_us: int) -> list[mavlink.MAVLink_message]:
            resets = max(time_us - began_us, 0) // 300_000
            return odometry(time_us, 0.4 * resets, resets=resets)

        autopilot.pose = walking
        line = until(process, "^released")
        assert "estimator_jump" in line
        assert "add up to 1.20 m, more than 1 m" in line
        assert process.wait(5.0) == 1


def test_a_slide_that_nobody_counts_and_doubt_end_control_with_their_own_reasons(tmp_path: Path) -> None:
    with flown(tmp_path) as (autopilot, process):
        autopilot.start()
        until(process, "^engaged")
        autopilot.pose = lambda time_us: odometry(time_us, variance=0.6)
        assert "position_variance" in (line := until(process, "^released"))
        assert "it was 0.6, the limit 0.5" in line
    with flown(tmp_path) as (autopilot, process):
        autopilot.start()
        until(process, "^engaged")
        began_us = round(1e6 * (time.monotonic() - autopilot.began_s))
        autopilot.pose = lambda time_us: odometry(time_us, 8e-6 * max(time_us - began_us, 0))
        assert "velocity_consistency" in until(process, "^released")


def test_its_own_heartbeat_tells_the_truth(tmp_path: Path) -> None:
    others = ("--set", "guards.attitude_response_deg.enabled=false", "--set", "guards.tilt_error_deg.enabled=false")
    with flown(
        tmp_path, "--set", "guards.tilt_deg={limit: 10, timeout_s: 2}", "--set", "controller.limits.tilt_deg=5", *others
    ) as (autopilot, process):
        autopilot.switches = False
        autopilot.start()
        until(process, "^standby")
        time.sleep(1.2)
        autopilot.mode = OFFBOARD
        until(process, "^engaged")
        time.sleep(1.2)
        autopilot.pose = lambda time_us: tilted(time_us, 0.3)  # above its limit, its timeout running
        assert "tilt" in until(process, "^released")
        process.wait(5.0)
    assert statuses(autopilot) == [
        mavlink.MAV_STATE_BOOT, mavlink.MAV_STATE_CALIBRATING, mavlink.MAV_STATE_STANDBY,
        mavlink.MAV_STATE_ACTIVE, mavlink.MAV_STATE_CRITICAL,
    ]  # fmt: skip


def tilted(time_us: int, angle_rad: float) -> list[mavlink.MAVLink_message]:
    (message,) = odometry(time_us)
    message.q = [math.cos(angle_rad / 2), 0, math.sin(angle_rad / 2), 0]
    return [message]


def test_a_slow_answer_to_timesync_is_a_slow_link(tmp_path: Path) -> None:
    delay = ("--set", "attitude.x.delay_s=0.05", "--set", "guards.link_jitter_s.enabled=false")
    with flown(tmp_path, *delay) as (autopilot, process):
        autopilot.start()
        until(process, "^engaged")
        time.sleep(1.0)
        assert process.poll() is None
        autopilot.late_s = 0.15
        assert "link_delay" in until(process, "^released")


def test_what_a_guard_cannot_see_is_told(tmp_path: Path) -> None:
    with flown(tmp_path) as (autopilot, process):
        autopilot.pose = lambda time_us: odometry(time_us, variance=math.nan)
        autopilot.start()
        assert "estimator_flags" in until(process, "^guard cannot see")
        assert "position_variance_m2" in until(process, "^guard cannot see")


STANDS_STILL = [f"guards.{name}.enabled=false" for name in ("attitude_response_deg", "tilt_error_deg", "hover_thrust")]
LONGER = [word for setting in STANDS_STILL for word in ("--set", setting)]  # than what does not answer may stand there


def test_an_estimator_that_no_longer_answers_ends_control(tmp_path: Path) -> None:
    with flown(tmp_path, *LONGER) as (autopilot, process):
        autopilot.tells_estimator = True
        autopilot.start()
        until(process, "^engaged")
        autopilot.tells_estimator = False
        until(process, "^guard cannot see: estimator_flags")
        assert "estimator_flags (the estimator no longer answers" in until(process, "^released")
        assert process.wait(5.0) == 1


def test_variances_that_are_told_no_longer_end_control(tmp_path: Path) -> None:
    with flown(tmp_path, *LONGER) as (autopilot, process):
        autopilot.start()
        until(process, "^engaged")
        autopilot.pose = lambda time_us: odometry(time_us, variance=math.nan)
        assert "position_variance (the estimator no longer answers" in until(process, "^released")


def test_a_link_whose_delay_is_seen_no_longer_is_told_and_flown_on(tmp_path: Path) -> None:
    with flown(tmp_path, "--set", "attitude.x.delay_s=0.05", *LONGER) as (autopilot, process):
        autopilot.start()
        until(process, "^engaged")
        time.sleep(0.5)
        autopilot.answers_timesync = False
        until(process, "^guard cannot see: link_delay_s")
        time.sleep(0.5)
        assert process.poll() is None
        assert any(m.get_type() == "STATUSTEXT" and "cannot see: link_delay_s" in m.text for m in autopilot.heard)


@pytest.mark.parametrize("when", ["at once", "at stand-by"])
def test_two_companions_are_one_too_many(when: str, tmp_path: Path) -> None:
    twin = mavlink.MAVLink(None, 1, 191)
    with flown(tmp_path) as (autopilot, process):
        autopilot.switches = False
        if when == "at once":
            autopilot.pose = lambda time_us: [*odometry(time_us), Forged(twin)]
        autopilot.start()
        if when == "at stand-by":
            until(process, "^standby")
            autopilot.pose = lambda time_us: [*odometry(time_us), Forged(twin)]
        assert process.wait(10.0) == 2
        assert process.stderr is not None
        assert "another companion is 1/191 too" in process.stderr.read()
        assert bool(autopilot.setpoints()) == (when == "at stand-by")


class Broken(Pilot):
    """A controller that fails after a second in control, in one of three ways."""

    def __init__(self, how: str) -> None:
        super().__init__(load_config(RIG), hedging=True)
        self.how = how

    def step(self, sample: Odometry, dt_s: float) -> AttitudeSetpoint:
        setpoint = super().step(sample, dt_s)
        if self.elapsed_s < 1.0:
            return setpoint
        if self.how == "raises":
            raise ZeroDivisionError("of some kind")
        if self.how == "sleeps":
            time.sleep(0.4)
        return setpoint._replace(qx=math.nan) if self.how == "not a number" else setpoint


@pytest.mark.parametrize(
    ("how", "reason"),
    [
        ("not a number", Reason.SETPOINT_INVALID),
        ("raises", Reason.INTERNAL_ERROR),
        ("sleeps", Reason.TICK_OVERRUN),
    ],
)
def test_a_controller_that_fails_hands_the_vehicle_back(
    how: str, reason: Reason, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shared, "Pilot", lambda *_, **__: Broken(how))
    config = load_config(RIG, ("tick.rate_hz=100", "tick.floor_hz=60", "guards.pose_age_s.limit=1"))
    autopilot = Autopilot()
    recorder = open_folder(tmp_path / "flight", RIG, config, blocking=False)
    link = open_link(f"udpout://127.0.0.1:{autopilot.port}")
    try:
        autopilot.start()
        summary = FlightProcess(config, link, recorder).run()
    finally:
        autopilot.running = False
        autopilot.join()
        autopilot.socket.close()
        link.close()
        recorder.close()
    assert (summary.reason, summary.engaged) == (reason, True)
    assert autopilot.mode == HOLD
    assert all(math.isfinite(v) for m in autopilot.setpoints() for v in (*m.q, m.thrust))
    assert ("traceback" in {event.name for event in read_flight(tmp_path / "flight").events}) == (how == "raises")
