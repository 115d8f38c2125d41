"""The flight process against a scripted autopilot: what it must refuse, and what must end control."""

import contextlib
import math
import os
import re
import signal
from pathlib import Path

import pytest
from harness.fake_autopilot import HOLD, OFFBOARD, POSITION, Forged, odometry, position_and_attitude
from harness.process_flight import run_against
from harness.processes import PATIENT, end_of, eventually, line_with
from harness.virtual_flight import flown
from pymavlink.dialects.v20 import development as mavlink

from companion.record.reader import read_flight


def test_position_and_attitude_serve_where_odometry_is_absent(tmp_path: Path) -> None:
    with flown(tmp_path) as flight:
        autopilot = flight.autopilot
        autopilot.pose = position_and_attitude
        assert "estimator_jump_m" in flight.until("^guard cannot see: estimator_jump")
        assert "LOCAL_POSITION_NED" in flight.until("^engaged")


def test_not_a_number_ends_control_and_is_never_sent(tmp_path: Path) -> None:
    with flown(tmp_path) as flight:
        autopilot = flight.autopilot
        flight.until("^engaged")
        autopilot.pose = lambda time_us: odometry(time_us, math.nan)
        assert "pose_invalid" in flight.until("^released")
        assert flight.exit_code(5.0) == 1
        assert autopilot.mode == HOLD
        assert all(math.isfinite(v) for m in autopilot.setpoints() for v in (*m.q, m.thrust))


def test_silent_odometry_ends_control_then_hold_then_silence(tmp_path: Path) -> None:
    with flown(tmp_path) as flight:
        autopilot = flight.autopilot
        flight.until("^engaged")
        autopilot.pose = lambda _: []
        stopped_s = autopilot.now_s
        assert "pose_stale" in flight.until("^released")
        assert 0.2 < autopilot.now_s - stopped_s < 2.5
        assert flight.exit_code(5.0) == 1
        last = [m.get_type() for m in autopilot.heard[-3:]]
        assert "SET_ATTITUDE_TARGET" not in last[-1:]
        assert any(m.get_type() == "STATUSTEXT" and "pose_stale" in m.text for m in autopilot.heard)


def test_odometry_that_stops_in_disarmed_stand_by_is_waited_for(tmp_path: Path) -> None:
    with flown(tmp_path) as flight:
        autopilot = flight.autopilot
        autopilot.armed = autopilot.switches = False
        flight.until("^standby")
        pose, autopilot.pose = autopilot.pose, lambda _: []
        flight.until("no odometry any more")
        sent = len(autopilot.setpoints())
        flight.fly_on(5.0)
        assert flight.running
        assert len(autopilot.setpoints()) == sent, "nothing is sent without it"
        autopilot.pose = pose
        flight.until("odometry comes again")
        autopilot.armed, autopilot.mode = True, OFFBOARD
        flight.until("^engaged", 3.0)


def test_armed_without_odometry_it_never_begins(tmp_path: Path) -> None:
    with flown(tmp_path) as flight:
        autopilot = flight.autopilot
        autopilot.armed = autopilot.switches = False
        flight.until("^standby")
        autopilot.pose = lambda _: []
        flight.until("no odometry any more")
        autopilot.armed, autopilot.mode = True, OFFBOARD
        assert "pose_stale" in flight.until("^released", 3.0)
        assert flight.summary is None or not flight.summary.engaged


def test_lost_heartbeat_ends_control(tmp_path: Path) -> None:
    with flown(tmp_path) as flight:
        autopilot = flight.autopilot
        flight.until("^engaged")
        autopilot.heartbeats = False
        assert "heartbeat_lost" in flight.until("^released")
        assert flight.exit_code(5.0) == 1


def test_a_vehicle_that_does_not_obey_is_met_with_silence(tmp_path: Path) -> None:
    with flown(tmp_path) as flight:
        autopilot = flight.autopilot
        autopilot.obeys = False
        flight.until("^engaged")
        autopilot.pose = lambda _: []
        flight.until("^released")
        assert flight.exit_code(5.0) == 1
        asked = [m for m in autopilot.heard if m.get_type() == "COMMAND_LONG" and m.command == 176]
        assert len(asked) > 3
        assert {m.param2 for m in asked} == {4.0}


def test_odometry_below_the_floor_is_refused_with_the_rate_measured(tmp_path: Path) -> None:
    with flown(tmp_path, "tick.floor_hz=99.9", "tick.rate_hz=200") as flight:
        autopilot = flight.autopilot
        autopilot.pose = lambda time_us: odometry(time_us) if time_us // 10_000 % 2 else []
        assert flight.exit_code(20.0) == 2
        assert re.fullmatch(r"ODOMETRY arrives at [\d.]+ Hz, tick\.floor_hz is 99\.9: .*", flight.complaint)
        assert not autopilot.setpoints()  # nothing was streamed to a vehicle that was refused, nothing asked of it
        assert autopilot.mode == HOLD


def test_others_on_the_link_are_not_believed(tmp_path: Path) -> None:
    with flown(tmp_path) as flight:
        autopilot = flight.autopilot
        flight.until("^engaged")
        forger = mavlink.MAVLink(None, 7, 1)
        autopilot.pose = lambda time_us: [*odometry(time_us), Forged(forger)]
        flight.fly_on(1.0)
        assert flight.running
        autopilot.mode = HOLD
        assert "mode_changed" in flight.until("^released")
    (folder,) = tmp_path.iterdir()
    assert read_flight(folder).events[-1].name == "released_mode_changed"


@pytest.mark.realtime
def test_a_blocked_terminal_does_not_hold_up_the_loop(tmp_path: Path) -> None:
    """A pipe that nobody reads fills up; Ctrl-S does the same to a terminal."""
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    with contextlib.suppress(BlockingIOError):
        while True:
            os.write(writing, b"x" * 4096)
    os.set_blocking(writing, True)
    try:
        with run_against(tmp_path, *PATIENT, stdout=writing) as (autopilot, _):
            autopilot.start()
            assert eventually(autopilot.setpoints)
            before = len(autopilot.setpoints())
            assert eventually(lambda: len(autopilot.setpoints()) - before > 60)
    finally:
        os.close(reading)
        os.close(writing)


def test_a_jump_of_the_odometry_clock_ends_control_with_its_own_reason(tmp_path: Path) -> None:
    with flown(tmp_path) as flight:
        autopilot = flight.autopilot
        flight.until("^engaged")
        autopilot.pose = lambda time_us: odometry(time_us + 3_600_000_000)
        assert "clock_jump" in flight.until("^released")
        assert flight.exit_code(5.0) == 1


@pytest.mark.realtime
def test_hang_up_hands_over_too(tmp_path: Path) -> None:
    with run_against(tmp_path, *PATIENT) as (autopilot, process):
        autopilot.start()
        line_with(process, "^engaged")
        process.send_signal(signal.SIGHUP)
        assert "operator" in line_with(process, "^released")
        end_of(process)
        assert process.returncode == 0
        assert autopilot.mode == HOLD


def test_a_pilot_who_chose_another_mode_after_hold_is_not_overruled(tmp_path: Path) -> None:
    """Without CURRENT_MODE the release sees the change up to a heartbeat late; meanwhile it must not ask again."""
    with flown(tmp_path) as flight:
        autopilot = flight.autopilot
        autopilot.tells_mode, autopilot.mode = False, POSITION
        flight.until("^engaged")
        autopilot.pilot_after_hold = True
        flight.process.stop()
        flight.until("^released")
        flight.exit_code(5.0)
        assert autopilot.mode == POSITION


def test_a_vehicle_that_is_armed_already_is_left_to_its_pilot(tmp_path: Path) -> None:
    with flown(tmp_path, engage=True) as flight:
        autopilot = flight.autopilot
        autopilot.mode, autopilot.switches = POSITION, False
        assert flight.exit_code(10.0) == 2
        assert "leaves it to its pilot" in flight.complaint
        assert autopilot.mode == POSITION
        assert not [m for m in autopilot.heard if m.get_type() == "COMMAND_LONG" and m.command in (176, 400)]
