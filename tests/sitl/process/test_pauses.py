"""What was queued while the companion did not run is old: it may end control, begins nothing and asks for nothing."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from harness.fake_autopilot import HOLD, OFFBOARD, RETURN, ScriptedAutopilot, odometry
from harness.process_flight import AutopilotOnSocket, run_against
from harness.processes import PATIENT, RIG, ROOT, end_of, eventually, line_with, stop
from harness.virtual_flight import SLOW, VirtualFlight, flown
from pymavlink.dialects.v20 import development as mavlink

from companion.record.reader import read_flight

RARELY = ("guards.heartbeat_age_s.limit=3",)
OLD_S = 0.06  # of a sample that is answered: more than jitter, less than any pause here


def like_px4(autopilot: ScriptedAutopilot) -> None:
    """It tells its mode as rarely as a real one, acts on silence, and fills a socket's queue before it does."""
    autopilot.loss_s = 1.0
    autopilot.heartbeat_every, autopilot.mode_every = 100, 40
    autopilot.pose = lambda time_us: [*odometry(time_us), *[mavlink.MAVLink_ping_message(time_us, 0, 255, 255)] * 2]


def answered_late(vehicle: AutopilotOnSocket | VirtualFlight, older_s: float) -> list[tuple[float, float]]:
    """The set-points that answer a sample older than that."""
    autopilot = vehicle.autopilot if isinstance(vehicle, VirtualFlight) else vehicle
    return [(at_s, sample_s) for at_s, sample_s in autopilot.answered if at_s - sample_s > older_s]


# --- in virtual time --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("asleep", [False, True], ids=["stopped", "suspended"])
def test_a_short_pause_is_flown_through_without_answers_to_what_was_queued(tmp_path: Path, asleep: bool) -> None:
    with flown(tmp_path) as flight:
        flight.until("^engaged")
        flight.fly_on(1.0)
        for _ in range(3):
            flight.stop_for(0.2, asleep=asleep)
            before = len(flight.autopilot.answered)
            flight.fly_on(1.0)
            assert len(flight.autopilot.answered) - before > 90
        assert flight.running
        assert answered_late(flight, OLD_S) == []
        flight.process.stop()
        flight.exit_code(5.0)
    events = [event.detail for event in read_flight(flight.folder).events if event.name == "paused"]
    assert events == ["this process did not run for 0.20 s"] * 3


@pytest.mark.parametrize("asleep", [False, True], ids=["stopped", "suspended"])
def test_after_a_long_pause_nothing_is_sent_and_nothing_asked_for(tmp_path: Path, asleep: bool) -> None:
    """PX4 has gone to Return after a second of silence, and stays there."""
    with flown(tmp_path, *RARELY) as flight:
        autopilot = flight.autopilot
        like_px4(autopilot)
        flight.until("^engaged")
        flight.fly_on(1.0)
        flight.stop_for(5.0, asleep=asleep)
        sent = len(autopilot.answered)
        assert autopilot.mode == RETURN
        assert "pose_stale" in flight.until("^released")
        assert flight.exit_code(5.0) == 1
        flight.fly_on(1.0)
        assert len(autopilot.answered) == sent
        assert autopilot.commands(176) == []
        assert autopilot.mode == RETURN


def test_where_the_vehicle_still_flies_offboard_after_a_pause_hold_is_asked_for(tmp_path: Path) -> None:
    """As soon as it says so itself, after what was queued."""
    with flown(tmp_path, *RARELY) as flight:
        autopilot = flight.autopilot
        like_px4(autopilot)
        flight.until("^engaged")
        flight.fly_on(1.0)
        flight.stop_for(0.6)
        assert "pose_stale" in flight.until("^released")
        flight.exit_code(5.0)
        assert autopilot.mode == HOLD
        assert answered_late(flight, OLD_S) == []


def test_a_pause_while_the_vehicle_is_handed_back_is_one_too(tmp_path: Path) -> None:
    with flown(tmp_path, *RARELY) as flight:
        autopilot = flight.autopilot
        like_px4(autopilot)
        flight.until("^engaged")
        flight.fly_on(1.0)
        flight.process.stop()
        flight.fly_on(0.05)  # it still listens
        flight.stop_for(1.5)
        flight.exit_code(5.0)
        assert autopilot.commands(176) == []
        assert autopilot.mode == RETURN


@pytest.mark.parametrize("pause_s", [0.2, 5.0])
def test_control_does_not_begin_with_what_was_queued(tmp_path: Path, pause_s: float) -> None:
    """Meanwhile a pilot armed, chose OFFBOARD and another mode again; the queue tells the first, or all of it."""
    with flown(tmp_path) as flight:
        autopilot = flight.autopilot
        autopilot.armed = autopilot.switches = False
        flight.until("^standby")
        flight.fly_on(1.0)
        autopilot.armed, autopilot.mode = True, OFFBOARD
        flight.stop_for(0.5 * pause_s)
        autopilot.mode = RETURN
        flight.stop_for(0.5 * pause_s)
        flight.fly_on(3.0)
        assert not flight.process._flight.engaged
        assert answered_late(flight, OLD_S) == []


def test_in_stand_by_the_stream_goes_on_with_what_is_new(tmp_path: Path) -> None:
    with flown(tmp_path) as flight:
        autopilot = flight.autopilot
        autopilot.armed = autopilot.switches = False
        flight.until("^standby")
        flight.fly_on(1.0)
        flight.stop_for(0.8)
        before = len(autopilot.answered)
        flight.fly_on(1.0)
        assert flight.running
        assert len(autopilot.answered) - before > 50
        assert answered_late(flight, OLD_S) == []
        autopilot.armed, autopilot.mode = True, OFFBOARD
        flight.until("^engaged", 3.0)


# --- by the wall clock ------------------------------------------------------------------------------------------------


@pytest.mark.realtime
def test_stopped_for_five_seconds_in_offboard_it_leaves_px4_in_its_failsafe(tmp_path: Path) -> None:
    with run_against(tmp_path, *PATIENT, "--set", "guards.pose_age_s.limit=0.25", "--set", *RARELY) as (vehicle, run):
        like_px4(vehicle)
        vehicle.start()
        line_with(run, "^engaged")
        time.sleep(0.5)
        run.send_signal(signal.SIGSTOP)
        assert eventually(lambda: vehicle.mode == RETURN)
        time.sleep(4.0)
        sent = len(vehicle.answered)
        run.send_signal(signal.SIGCONT)
        line_with(run, "^released: pose_stale")
        end_of(run)
        assert vehicle.mode == RETURN
        assert vehicle.commands(176) == []
        assert len(vehicle.answered) - sent <= 1  # one, where it was stopped between looking and sending


ASLEEP = """
import os, runpy, sys, time
asleep_s, monotonic = 0.0, time.monotonic
told = sys.argv.pop(1)

def awake_s():
    global asleep_s
    if not asleep_s and os.path.exists(told):
        asleep_s = 2.0
    return monotonic() - asleep_s

time.monotonic = awake_s
runpy.run_module("companion", run_name="__main__")
"""


@pytest.mark.realtime
def test_after_a_suspend_no_old_set_point_goes_out(tmp_path: Path) -> None:
    """A suspended computer as a stopped process whose CLOCK_MONOTONIC has stood still."""
    vehicle, told = AutopilotOnSocket(), tmp_path / "asleep"
    settings = [part for setting in SLOW for part in ("--set", setting)]
    command = [sys.executable, "-u", "-c", ASLEEP, str(told), "run", str(RIG), "--out", str(tmp_path), "--uncertified"]
    command += ["--link", f"udpout://127.0.0.1:{vehicle.port}", *settings, *PATIENT]
    run = subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    try:
        vehicle.start()
        line_with(run, "^engaged")
        time.sleep(0.5)
        run.send_signal(signal.SIGSTOP)
        time.sleep(2.0)
        told.touch()
        sent = len(vehicle.answered)
        run.send_signal(signal.SIGCONT)
        line_with(run, "^released: pose_stale")
        end_of(run)
        assert len(vehicle.answered) - sent <= 1
    finally:
        vehicle.close()
        stop(run)
