"""The flight process against a scripted autopilot: restarts, failsafes, pilots, and the mode it asks for at the end."""

import signal
import time
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import development as mavlink
from scripted_autopilot import HOLD, OFFBOARD, POSITION, RETURN, commands, flown, until


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
