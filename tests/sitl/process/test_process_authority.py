"""The flight process against a scripted autopilot: restarts, failsafes, pilots, and the mode it asks for at the end."""

from pathlib import Path

import pytest
from harness.fake_autopilot import HOLD, LAND, OFFBOARD, POSITION, RETURN
from harness.virtual_flight import flown
from pymavlink.dialects.v20 import development as mavlink


@pytest.mark.parametrize(("mode", "intended"), [(OFFBOARD, OFFBOARD), (RETURN, OFFBOARD)], ids=["flown", "failsafe"])
def test_after_a_restart_in_flight_it_sends_nothing_until_a_mode_is_chosen(
    mode: int, intended: int, tmp_path: Path
) -> None:
    with flown(tmp_path, engage=True) as flight:
        autopilot = flight.autopilot
        autopilot.mode, autopilot.intended, autopilot.switches = mode, intended, False
        assert "hands off" in flight.until("^standby")
        flight.fly_on(1.0)
        assert not autopilot.setpoints()
        assert not autopilot.commands(176)
        assert not autopilot.commands(400)
        assert flight.running
        autopilot.mode, autopilot.intended = POSITION, None  # the pilot chooses
        flight.until("no longer hands off")
        flight.fly_on(0.3)
        assert autopilot.setpoints()
        autopilot.mode = OFFBOARD  # and switches
        flight.until("^engaged")
        assert not autopilot.commands(176)


@pytest.mark.parametrize("mode", [RETURN, HOLD], ids=["return", "hold"])
def test_where_intentions_are_not_told_only_sticks_are_a_pilot(mode: int, tmp_path: Path) -> None:
    """A PX4 before 1.15: Return may be its failsafe, and a stream would put it back into OFFBOARD."""
    with flown(tmp_path) as flight:
        autopilot = flight.autopilot
        autopilot.mode, autopilot.tells_mode = mode, False  # back to OFFBOARD as soon as it is streamed to
        assert "take the sticks or disarm first" in flight.until("^standby")
        flight.fly_on(1.0)
        assert (autopilot.setpoints(), autopilot.mode) == ([], mode)
        autopilot.switches, autopilot.mode = False, POSITION
        flight.until("no longer hands off")
        flight.fly_on(0.3)
        assert autopilot.setpoints()


def test_a_vehicle_that_landed_in_offboard_is_not_streamed_to_until_another_mode_is_chosen(tmp_path: Path) -> None:
    with flown(tmp_path) as flight:
        autopilot = flight.autopilot
        autopilot.mode, autopilot.armed, autopilot.switches = OFFBOARD, False, False
        assert "choose another mode first" in flight.until("^standby")
        flight.fly_on(0.5)
        autopilot.armed = True  # by somebody who does not know
        flight.fly_on(0.7)
        assert not autopilot.setpoints()
        assert flight.running
        autopilot.mode = POSITION
        flight.until("no longer hands off")
        flight.fly_on(0.3)
        autopilot.mode = OFFBOARD
        flight.until("^engaged")


def test_engaging_what_reads_offboard_on_the_ground_is_refused(tmp_path: Path) -> None:
    with flown(tmp_path, engage=True) as flight:
        autopilot = flight.autopilot
        autopilot.mode, autopilot.armed, autopilot.switches = OFFBOARD, False, False
        assert flight.exit_code(10.0) == 2
        assert "choose another mode first" in flight.complaint
        assert not autopilot.commands(400)


def test_a_failsafe_of_the_vehicle_is_told_from_a_pilot(tmp_path: Path) -> None:
    with flown(tmp_path) as flight:
        autopilot = flight.autopilot
        flight.until("^engaged")
        autopilot.mode, autopilot.intended = RETURN, OFFBOARD
        line = flight.until("^released")
        assert "mode_changed" in line
        assert "failsafe of the vehicle" in line
        assert "RETURN" in line
        assert flight.exit_code(5.0) == 1
        assert not autopilot.commands(176)


def test_a_pilot_who_takes_over_is_no_fault(tmp_path: Path) -> None:
    with flown(tmp_path) as flight:
        autopilot = flight.autopilot
        flight.until("^engaged")
        autopilot.mode = POSITION
        assert "the pilot chose POSITION" in flight.until("^released")
        assert flight.exit_code(5.0) == 0
        count = len(autopilot.setpoints())
        flight.fly_on(0.3)
        assert len(autopilot.setpoints()) == count
        assert not autopilot.commands(176)


def test_kill_has_its_own_name_though_the_mode_stays(tmp_path: Path) -> None:
    with flown(tmp_path) as flight:
        autopilot = flight.autopilot
        flight.until("^engaged")
        autopilot.status = mavlink.MAV_STATE_FLIGHT_TERMINATION
        assert "killed" in flight.until("^released")
        assert flight.exit_code(5.0) == 1
        assert not autopilot.commands(176)
        assert any(m.get_type() == "STATUSTEXT" and "killed" in m.text for m in autopilot.heard)


@pytest.mark.parametrize(("name", "mode"), [("land", LAND), ("return", RETURN), ("position", POSITION)])
def test_the_release_mode_is_the_configs(name: str, mode: int, tmp_path: Path) -> None:
    with flown(tmp_path, f"release.mode={name}") as flight:
        autopilot = flight.autopilot
        flight.until("^engaged")
        flight.process.stop()
        flight.until("^released")
        assert flight.exit_code(5.0) == 0
        assert autopilot.mode == mode
