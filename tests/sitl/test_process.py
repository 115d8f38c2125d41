"""The flight process against a scripted autopilot: what it must refuse, and what must end control."""

import contextlib
import math
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

from pymavlink.dialects.v20 import development as mavlink
from scripted_autopilot import (
    HOLD,
    POSITION,
    RIG,
    ROOT,
    SLOW,
    Autopilot,
    Forged,
    flown,
    odometry,
    position_and_attitude,
    until,
)

from companion.record.reader import read_flight


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
