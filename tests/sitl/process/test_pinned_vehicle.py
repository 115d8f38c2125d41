"""`companion run` and what the vehicle's attitude response is made of: read, told, pinned, and watched in flight."""

from __future__ import annotations

from pathlib import Path

from harness.virtual_flight import VirtualFlight, flown
from pymavlink.dialects.v20 import development as mavlink

from companion.flight.readiness.parameters import REFERENCE_MODEL
from companion.record.reader import read_flight


def tell(flight: VirtualFlight, name: str, value: float) -> None:
    """Somebody has set a parameter: PX4 tells it to every link."""
    message = mavlink.MAVLink_param_value_message(name.encode(), value, mavlink.MAV_PARAM_TYPE_REAL32, 1, 0)
    flight.autopilot.answers.append(message)


def test_what_is_not_stated_is_pinned_told_and_recorded(tmp_path: Path) -> None:
    with flown(tmp_path) as flight:
        line = flight.until("pinned as read")
        flight.until("^engaged")
    assert line.startswith("PX4 1.17.0; pinned as read: MC_ROLL_P 4, MC_PITCH_P 4, ")
    assert line in [event.detail for event in read_flight(flight.folder).events]


def test_v1_18_has_its_reference_model_pinned_too(tmp_path: Path) -> None:
    with flown(tmp_path) as flight:
        flight.autopilot.version = (1, 18, 0)
        flight.autopilot.parameters |= dict(zip(REFERENCE_MODEL, (50.0, 0.0, 100.0), strict=True))
        line = flight.until("pinned as read")
        assert line.startswith("PX4 1.18.0; ")
        assert line.endswith("MC_REF_W_N 50, MC_REF_FF 0, MC_REF_FF_MAX 100")
        flight.until("^engaged")
        tell(flight, "MC_REF_FF", 1.0)
        told = flight.until("MC_REF_FF is 1, was 0")
        assert "stale" in told
        flight.fly_on(2.0)
        assert flight.running, "in control it is too late but to tell"


def test_a_pinned_gain_that_changes_in_stand_by_ends_it(tmp_path: Path) -> None:
    with flown(tmp_path) as flight:
        flight.autopilot.switches = False
        flight.until("^standby")
        tell(flight, "MC_PITCHRATE_P", 0.3)
        assert "MC_PITCHRATE_P is 0.3, was 0.15" in flight.until("certificate_stale")
        assert flight.exit_code(5.0) == 2


def test_gains_that_are_not_told_are_refused(tmp_path: Path) -> None:
    with flown(tmp_path) as flight:
        flight.autopilot.parameters.clear()
        assert "the vehicle does not tell MC_ROLL_P" in flight.until("certificate_stale", 20.0)
        assert flight.exit_code(5.0) == 2
        assert len(flight.complaint.splitlines()) == 1


def test_another_version_than_the_config_states_is_refused(tmp_path: Path) -> None:
    with flown(tmp_path, 'vehicle.px4_version="1.18"') as flight:
        assert "PX4 is 1.17, was 1.18" in flight.until("certificate_stale", 20.0)
        assert flight.exit_code(5.0) == 2
