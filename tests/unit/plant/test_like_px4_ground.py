"""On the ground in OFFBOARD, and without a stream: the plant beside a real PX4 v1.17, same scripts at both."""

from __future__ import annotations

import pytest
from harness.plant_client import clients
from harness.px4_plant import (
    ARM,
    HOVER,
    LEVEL,
    OFFBOARD,
    PX4,
    SET_MODE,
    armed_in_offboard,
    in_the_air,
    landed_states,
    stream,
)
from pymavlink.dialects.v20 import development as mavlink

from companion.config import load_config
from companion.mavlink.px4 import Result
from sitl.autopilot.modes import FlightMode, LandedState, custom_mode
from sitl.build import build_world
from sitl.messages.streams import Profile

# --- on the ground in OFFBOARD --------------------------------------------------------------------------------------


@pytest.mark.parametrize("thrust", [0.12, 0.2])
def test_on_the_ground_in_offboard_a_little_thrust_is_in_the_air(thrust: float) -> None:
    pilot, companion = armed_in_offboard(thrust)
    heard = stream(companion, 0.1, thrust)
    assert landed_states(heard)[-1] == LandedState.IN_AIR
    companion.command(ARM, 0)
    assert companion.acknowledged(ARM) == Result.TEMPORARILY_REJECTED
    stream(companion, 15.0, thrust)
    assert pilot.commander.armed, "nothing disarms what is in the air"
    assert pilot.truth().position_ned_m == (0.0, 0.0, 0.0)


def test_take_off_is_told_to_the_ground_station() -> None:
    pilot = build_world(load_config(PX4)).autopilot
    companion, station = clients(pilot, (Profile.ONBOARD, 191), (Profile.GROUND_STATION, 190))
    station.heartbeat(mavlink.MAV_TYPE_GCS)
    stream(companion, 0.2, 0.2)
    companion.command(SET_MODE, *OFFBOARD)
    companion.command(ARM, 1)
    stream(companion, 0.1, 0.2)
    assert station.wait("STATUSTEXT", lambda m: "Takeoff" in m.text).text == "Takeoff detected"


def test_thrust_0_10_never_lands_and_0_05_does() -> None:
    pilot, companion = armed_in_offboard(0.10)
    assert set(landed_states(stream(companion, 8.0, 0.10))[5:]) == {LandedState.IN_AIR}
    stream(companion, 2.0, 0.05)
    assert not pilot.commander.landed
    stream(companion, 0.2, 0.05)
    assert pilot.commander.landed
    stream(companion, 1.9, 0.05)
    assert pilot.commander.armed
    stream(companion, 0.7, 0.05)
    assert not pilot.commander.armed


def test_hold_after_offboard_on_the_ground_stays_armed_and_in_the_air() -> None:
    pilot, companion = armed_in_offboard(0.2)
    stream(companion, 0.5, 0.2)
    companion.command(SET_MODE, 1.0, 4.0, 3.0)
    companion.collect(15.0)
    assert pilot.commander.mode is FlightMode.HOLD
    assert (pilot.commander.armed, pilot.commander.landed) == (True, False)


def test_a_forced_disarm_in_the_air_reads_landed_at_once_and_arming_is_accepted_again() -> None:
    pilot, companion = in_the_air()
    companion.command(ARM, 0, 21196)
    assert companion.acknowledged(ARM) == Result.ACCEPTED
    assert landed_states(stream(companion, 0.8, HOVER))[-1] == LandedState.ON_GROUND
    assert not pilot.vehicle.on_ground()
    companion.command(ARM, 1)
    assert companion.acknowledged(ARM) == Result.ACCEPTED
    assert landed_states(stream(companion, 0.1, HOVER))[-1] == LandedState.IN_AIR


# --- the stream -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("action", "mode"), [(3, FlightMode.RTL), (4, FlightMode.LAND), (5, FlightMode.HOLD)], ids=["rtl", "land", "hold"]
)
def test_without_a_stream_it_leaves_offboard_after_1_1_s(action: int, mode: FlightMode) -> None:
    pilot, companion = in_the_air()
    pilot.parameters.set("COM_OBL_RC_ACT", action)
    companion.collect(0.95)
    assert pilot.commander.mode is FlightMode.OFFBOARD
    companion.collect(0.15)
    assert pilot.commander.mode is mode
    intended = companion.wait("CURRENT_MODE", lambda m: m.custom_mode == custom_mode(mode)).intended_custom_mode
    assert intended == custom_mode(FlightMode.OFFBOARD)


@pytest.mark.parametrize(("period_s", "modes"), [(1.0, 1), (1.053, 2)], ids=["1.0 Hz", "0.95 Hz"])
def test_one_set_point_a_second_keeps_offboard_and_fewer_flap(period_s: float, modes: int) -> None:
    pilot, companion = in_the_air()
    seen: set[FlightMode] = set()
    pilot.on_control = lambda _: seen.add(pilot.commander.mode)
    for _ in range(5):
        companion.setpoint(LEVEL, HOVER)
        companion.collect(period_s)
    assert len(seen) == modes


@pytest.mark.parametrize("target", [(1, 1), (0, 0), (1, 0), (0, 1), (1, 191), (2, 1)])
def test_whose_set_points_keep_offboard(target: tuple[int, int]) -> None:
    pilot, companion = in_the_air()
    for _ in range(15):
        companion.send(mavlink.MAVLink_set_attitude_target_message(0, *target, 7, list(LEVEL), 0, 0, 0, HOVER))
        companion.collect(0.1)
    kept = pilot.commander.mode is FlightMode.OFFBOARD
    assert kept is (target not in {(1, 191), (2, 1)})


def test_of_two_streams_neither_is_preferred_whoever_sends() -> None:
    pilot, companion = in_the_air()
    other = mavlink.MAVLink(None, srcSystem=42, srcComponent=7)
    flown = []
    for tick in range(60):
        message = mavlink.MAVLink_set_attitude_target_message(
            0, 1, 1, 7, list(LEVEL), 0, 0, 0, 0.3 if tick % 2 else 0.6
        )
        companion.send_raw(bytes(message.pack(other if tick % 2 else companion.mav)))
        companion.collect(0.02)
        flown.append(pilot.setpoint.thrust)
    assert flown[::2] == pytest.approx([0.6] * 30)
    assert flown[1::2] == pytest.approx([0.3] * 30)
