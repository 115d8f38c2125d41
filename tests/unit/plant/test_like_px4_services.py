"""What the plant answers beside a real PX4 v1.17: commands, modes, parameters, logs, files, and whose they are."""

from __future__ import annotations

import math
import struct
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import pytest
from harness.plant_client import MemoryClient, clients
from pymavlink.dialects.v20 import development as mavlink

from companion.config import load_config
from companion.mavlink.px4 import Result
from sitl.autopilot.autopilot import Autopilot
from sitl.autopilot.modes import FlightMode, custom_mode
from sitl.build import build_world
from sitl.messages.streams import Profile
from sitl.vehicles.vehicle import Quadrotor

PX4: Final = Path(__file__).resolve().parents[3] / "config" / "px4_quadrotor.yaml"
ARM: Final = mavlink.MAV_CMD_COMPONENT_ARM_DISARM
SET_MODE: Final = mavlink.MAV_CMD_DO_SET_MODE
SET_STANDARD_MODE: Final = mavlink.MAV_CMD_DO_SET_STANDARD_MODE
REAL32: Final = mavlink.MAV_PARAM_TYPE_REAL32
INT32: Final = mavlink.MAV_PARAM_TYPE_INT32
ACCEPTED, REJECTED = Result.ACCEPTED, Result.TEMPORARILY_REJECTED


def plant() -> tuple[Autopilot, MemoryClient, MemoryClient]:
    """An autopilot in Hold in the air, a companion on its link and a ground station on the other."""
    pilot = build_world(load_config(PX4, ("plant.sensors=null",))).autopilot
    pilot.start_in_air(5.0)
    companion, station = clients(pilot, (Profile.ONBOARD, 191), (Profile.GROUND_STATION, 190))
    companion.heartbeat()
    station.heartbeat(mavlink.MAV_TYPE_GCS)
    return pilot, companion, station


def answers(companion: MemoryClient, number: int, *parameters: float) -> list[int]:
    companion.command(number, *parameters)
    heard = companion.collect(0.2)
    return [m.result for m in heard if m.get_type() == "COMMAND_ACK" and m.command == number]


def named(heard: list[Any], name: str) -> list[Any]:
    return [message for message in heard if message.get_type() == name]


# --- commands -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("number", "parameters", "results"),
    [
        (SET_MODE, (1, 6), [ACCEPTED, REJECTED]),  # OFFBOARD without a stream
        (SET_MODE, (1, 9), [ACCEPTED, ACCEPTED]),  # a main mode that is none
        (SET_MODE, (0, 6), [ACCEPTED, ACCEPTED]),  # no mode is named
        (ARM, (2,), []),
        (mavlink.MAV_CMD_DO_CHANGE_SPEED, (1, 3), [ACCEPTED]),
        (SET_STANDARD_MODE, (7,), [ACCEPTED]),
    ],
)
def test_answers(number: int, parameters: tuple[float, ...], results: list[int]) -> None:
    _, companion, _ = plant()
    assert answers(companion, number, *parameters) == results


def test_a_mode_that_is_none_changes_none() -> None:
    pilot, companion, _ = plant()
    for parameters in ((1, 9), (0, 6)):
        answers(companion, SET_MODE, *parameters)
        assert pilot.commander.mode is FlightMode.HOLD


def test_calibration_is_accepted_on_the_ground() -> None:
    pilot = build_world(load_config(PX4, ("plant.sensors=null",))).autopilot
    (companion,) = clients(pilot, (Profile.ONBOARD, 191))
    assert answers(companion, mavlink.MAV_CMD_PREFLIGHT_CALIBRATION) == [ACCEPTED]


@pytest.mark.parametrize(("standard", "mode"), [(5, FlightMode.RTL), (7, FlightMode.LAND)])
def test_standard_modes_are_flown(standard: int, mode: FlightMode) -> None:
    pilot, companion, _ = plant()
    answers(companion, SET_STANDARD_MODE, standard)
    assert pilot.commander.mode is mode


def test_26_modes_are_available() -> None:
    _, companion, _ = plant()
    companion.command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_AVAILABLE_MODES, 0)
    found = named(companion.collect(0.5), "AVAILABLE_MODES")
    assert [m.mode_index for m in found] == list(range(1, 27))
    assert {m.number_modes for m in found} == {26}
    unlisted = {FlightMode.GUIDED_COURSE}  # from v1.18
    assert {custom_mode(mode) for mode in set(FlightMode) - unlisted} <= {m.custom_mode for m in found}
    assert all((m.mode_name == "") is (m.standard_mode != 0) for m in found)
    companion.command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_AVAILABLE_MODES, 11)
    assert companion.wait("AVAILABLE_MODES").mode_name == "Offboard"


def test_signing_cannot_be_set_up() -> None:
    _, companion, _ = plant()
    companion.collect(0.5)
    companion.send(mavlink.MAVLink_setup_signing_message(1, 1, list(range(32)), 1))
    heard = companion.collect(1.0)
    assert not named(heard, "COMMAND_ACK")
    assert not named(heard, "STATUSTEXT")
    assert len(named(heard, "ATTITUDE")) > 50, "it speaks on, unsigned"


# --- parameters -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("value", [50.0, -3.0, math.nan])
def test_any_number_is_taken_for_a_gain(value: float) -> None:
    pilot, companion, _ = plant()
    companion.send(mavlink.MAVLink_param_set_message(1, 1, b"MC_ROLL_P", value, REAL32))
    assert companion.wait("PARAM_VALUE").param_value == pytest.approx(value, nan_ok=True)
    companion.collect(1.0)
    assert all(map(math.isfinite, pilot.truth().position_ned_m))


def test_a_wrong_type_and_an_unknown_name_are_met_with_silence() -> None:
    pilot, companion, _ = plant()
    companion.send(mavlink.MAVLink_param_set_message(1, 1, b"MC_ROLL_P", 2.0, INT32))
    companion.send(mavlink.MAVLink_param_set_message(1, 1, b"NO_SUCH_THING", 2.0, REAL32))
    companion.send(mavlink.MAVLink_param_request_read_message(1, 1, b"NO_SUCH_THING", -1))
    assert not named(companion.collect(1.0), "PARAM_VALUE")
    assert pilot.parameters["MC_ROLL_P"] == 4.0


def test_hover_thrust_is_never_written_back() -> None:
    pilot = build_world(load_config(PX4, ("plant.mismatch={mass: 1.3}",))).autopilot
    pilot.start_in_air(5.0)
    before = pilot.parameters["MPC_THR_HOVER"]
    (companion,) = clients(pilot, (Profile.ONBOARD, 191))
    for tick in range(200):
        companion.setpoint(thrust=0.64)
        if tick == 1:
            companion.command(SET_MODE, 1, 6)
        companion.collect(0.02)
    assert pilot.commander.mode is FlightMode.OFFBOARD
    assert pilot.parameters["MPC_THR_HOVER"] == before


# --- links ----------------------------------------------------------------------------------------------------------


def test_a_silent_companion_is_told_of_to_the_ground_station() -> None:
    pilot, companion, station = plant()
    companion.heartbeat()
    silent_s = companion.now_s()
    text = station.wait("STATUSTEXT", lambda m: "mission computer" in m.text).text
    assert text == "Connection to mission computer lost"
    assert station.now_s() - silent_s == pytest.approx(6.5, abs=0.1)
    assert pilot.commander.mode is FlightMode.HOLD
    heard = companion.collect(1.0)
    assert not named(heard, "STATUSTEXT"), "of the onboard link nothing is told"


def test_a_position_set_point_is_flown() -> None:
    pilot, companion, _ = plant()
    x, y, z = pilot.truth().position_ned_m
    for tick in range(400):
        place = (0, 1, 1, mavlink.MAV_FRAME_LOCAL_NED, 0xDF8, x + 1.0, y - 2.0, z - 0.5, *(0.0,) * 8)
        companion.send(mavlink.MAVLink_set_position_target_local_ned_message(*place))
        if tick == 1:
            companion.command(SET_MODE, 1, 6)
        companion.collect(0.02)
    assert pilot.commander.mode is FlightMode.OFFBOARD
    assert pilot.truth().position_ned_m == pytest.approx((x + 1.0, y - 2.0, z - 0.5), abs=0.15)


# --- logs and files -------------------------------------------------------------------------------------------------


def listed(companion: MemoryClient) -> list[Any]:
    companion.send(mavlink.MAVLink_log_request_list_message(1, 1, 0, 0xFFFF))
    return named(companion.collect(0.3), "LOG_ENTRY")


def log_data(companion: MemoryClient, number: int, offset: int, count: int) -> list[Any]:
    companion.send(mavlink.MAVLink_log_request_data_message(1, 1, number, offset, count))
    return named(companion.collect(0.3), "LOG_DATA")


def test_the_log_being_written_is_listed_grows_and_moves_the_others() -> None:
    pilot = build_world(load_config(PX4, ("plant.sensors=null",))).autopilot
    assert isinstance(pilot.vehicle, Quadrotor)
    (companion,) = clients(pilot, (Profile.ONBOARD, 191))
    companion.command(ARM, 1)
    companion.collect(2.0)
    companion.command(ARM, 0)
    companion.collect(0.1)
    (first,) = listed(companion)
    companion.command(ARM, 1)
    companion.collect(1.0)
    growing, old = listed(companion)
    assert (first.id, old.id, old.size) == (0, 1, first.size), "arming has moved its id"
    (later, _) = listed(companion)
    assert later.size > growing.size
    companion.collect(1.0)
    beyond = log_data(companion, 0, later.size, 90)
    assert [m.count for m in beyond] == [90]
    assert len(log_data(companion, 0, 0, 0)) == 1, "no bytes asked for give one packet"
    assert log_data(companion, 7, 0, 90) == [], "an unknown log is met with silence"
    sizes = [listed(companion)[0].size for _ in range(3)]
    assert all(a < b for a, b in pairwise(sizes))


def listing(companion: MemoryClient, path: bytes) -> tuple[int, bytes]:
    """(opcode, data) of the answer to a list of a directory."""
    asked = struct.pack("<HBBBBBxI", 1, 0, 3, len(path), 0, 0, 0) + path
    companion.send(mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, list(asked.ljust(251, b"\0"))))
    payload = bytes(companion.wait("FILE_TRANSFER_PROTOCOL").payload)
    return payload[3], payload[12 : 12 + payload[4]]


def test_directories_are_listed_by_ftp() -> None:
    pilot, companion, _ = plant()
    assert pilot.commander.armed
    companion.collect(0.5)
    assert listing(companion, b"/") == (128, b"Dlog\0")
    opcode, data = listing(companion, b"/log")
    assert opcode == 128
    assert data.startswith(b"Flog_000.ulg\t")
    assert listing(companion, b"@MAV_LOG") == (129, bytes([10]))
