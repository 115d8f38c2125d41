"""How the plant flies beside a real PX4 v1.17, same scripts at both: on the ground, bad set-points, gains, yaw."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, Final

import pytest
from harness.plant_client import MemoryClient, clients
from pymavlink.dialects.v20 import development as mavlink

from companion.config import load_config
from companion.mavlink.px4 import Result
from sitl.autopilot.autopilot import Autopilot
from sitl.autopilot.modes import FlightMode, LandedState, custom_mode
from sitl.build import build_world
from sitl.messages.streams import Profile
from sitl.vehicles.rotation import euler, quaternion

PX4: Final = Path(__file__).resolve().parents[3] / "config" / "px4_quadrotor.yaml"
ARM: Final = mavlink.MAV_CMD_COMPONENT_ARM_DISARM
SET_MODE: Final = mavlink.MAV_CMD_DO_SET_MODE
OFFBOARD: Final = (1.0, 6.0)
HOVER: Final = 0.49
NAN: Final = math.nan
LEVEL: Final = (1.0, 0.0, 0.0, 0.0)


def plant() -> tuple[Autopilot, MemoryClient]:
    """The shipped quadrotor on the ground, and a companion on its link, which has said something."""
    pilot = build_world(load_config(PX4)).autopilot
    (companion,) = clients(pilot, (Profile.ONBOARD, 191))
    companion.heartbeat()
    companion.command(511, mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE, 20_000)
    return pilot, companion


def stream(companion: MemoryClient, seconds: float, thrust: float, q_wxyz: tuple[float, ...] = LEVEL) -> list[Any]:
    """Set-points at 50 Hz; everything that came meanwhile."""
    heard: list[Any] = []
    for _ in range(round(50 * seconds)):
        companion.setpoint(q_wxyz, thrust)
        heard += companion.collect(0.02)
    return heard


def armed_in_offboard(thrust: float) -> tuple[Autopilot, MemoryClient]:
    pilot, companion = plant()
    stream(companion, 0.2, thrust)
    companion.command(SET_MODE, *OFFBOARD)
    stream(companion, 0.2, thrust)
    companion.command(ARM, 1)
    assert companion.acknowledged(ARM) == Result.ACCEPTED
    return pilot, companion


def in_the_air(height_m: float = 60.0) -> tuple[Autopilot, MemoryClient]:
    pilot, companion = plant()
    pilot.start_in_air(height_m)
    stream(companion, 0.1, HOVER)
    companion.command(SET_MODE, *OFFBOARD)
    stream(companion, 0.2, HOVER)
    assert pilot.commander.mode is FlightMode.OFFBOARD
    return pilot, companion


def landed_states(heard: list[Any]) -> list[int]:
    return [m.landed_state for m in heard if m.get_type() == "EXTENDED_SYS_STATE"]


def tilt_deg(pilot: Autopilot) -> float:
    _, x, y, _ = pilot.truth().q_wxyz
    return math.degrees(math.acos(1.0 - 2.0 * (x * x + y * y)))


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


# --- set-points that are none ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("q_wxyz", [(NAN, 0.0, 0.0, 0.0), (NAN,) * 4, (0.0,) * 4, (math.inf, 0.0, 0.0, 0.0)])
def test_without_an_attitude_the_thrust_stays_and_it_drifts(q_wxyz: tuple[float, ...]) -> None:
    pilot, companion = in_the_air()
    stream(companion, 2.0, 0.6, q_wxyz)
    assert tilt_deg(pilot) == pytest.approx(9.0, abs=1.5)
    assert pilot.truth().velocity_ned_m_s[2] < -2.0, "it climbs under the thrust that it was told"


def test_rolling_without_an_attitude_it_rolls_on() -> None:
    pilot, companion = in_the_air()
    stream(companion, 0.16, HOVER, quaternion(math.radians(30.0), 0.0, 0.0))
    rolling = pilot.truth().rates_frd_rad_s[0]
    began = tilt_deg(pilot)
    stream(companion, 1.0, HOVER, (NAN,) * 4)
    assert rolling > 0.5
    assert tilt_deg(pilot) - began > 30.0
    stream(companion, 3.0, HOVER)
    assert tilt_deg(pilot) < 1.0, "told an attitude again, it takes it"


@pytest.mark.parametrize("thrust", [math.inf, -math.inf, -0.3])
def test_with_a_thrust_that_is_none_it_falls(thrust: float) -> None:
    pilot, companion = in_the_air()
    stream(companion, 1.0, thrust)
    assert pilot.truth().velocity_ned_m_s[2] > 8.0


def test_attitude_target_tells_what_was_sent() -> None:
    _, companion = in_the_air()
    companion.command(511, mavlink.MAVLINK_MSG_ID_ATTITUDE_TARGET, 20_000)
    for q_wxyz, thrust, told in (
        ((0.5, 0.0, 0.0, 0.0), 0.4, 0.4),
        (LEVEL, 1.5, 1.5),
        (LEVEL, -0.3, 0.3),
        ((NAN, 0.0, 0.0, 0.0), 0.5, 0.5),
    ):
        (*_, last) = (m for m in stream(companion, 0.1, thrust, q_wxyz) if m.get_type() == "ATTITUDE_TARGET")
        assert last.q == pytest.approx(q_wxyz, nan_ok=True)
        assert last.thrust == pytest.approx(told)


# --- yaw and gains --------------------------------------------------------------------------------------------------


def test_a_yaw_rate_that_is_not_ignored_is_an_offset() -> None:
    pilot, companion = in_the_air()
    for _ in range(200):
        message = mavlink.MAVLink_set_attitude_target_message(0, 1, 1, 3, list(LEVEL), 0.0, 0.0, 0.5, HOVER)
        companion.send(message)
        companion.collect(0.02)
    assert math.degrees(euler(*pilot.truth().q_wxyz)[2]) == pytest.approx(10.3, abs=0.3)


def test_a_large_yaw_step_overshoots() -> None:
    pilot, companion = in_the_air(200.0)
    turned, last, largest, settled_s = 0.0, 0.0, 0.0, 0.0
    for tick in range(400):
        stream(companion, 0.02, HOVER, quaternion(0.0, 0.0, math.radians(171.0)))
        yaw = math.degrees(euler(*pilot.truth().q_wxyz)[2])
        turned, last = turned + (yaw - last + 180.0) % 360.0 - 180.0, yaw
        largest = max(largest, turned)
        settled_s = settled_s if abs(turned - 171.0) < 5.0 else 0.02 * (tick + 1)
    assert largest - 171.0 == pytest.approx(18.0, abs=3.0)
    assert settled_s == pytest.approx(3.0, abs=0.5)


def rise_s(pilot: Autopilot, companion: MemoryClient) -> float:
    """Time to 63 % of a roll step of 8 degrees, from level."""
    stream(companion, 2.0, HOVER)
    for tick in range(1000):
        if tick % 10 == 0:
            companion.setpoint(quaternion(math.radians(8.0), 0.0, 0.0), HOVER)
        companion.collect(0.002)
        if euler(*pilot.truth().q_wxyz)[0] > 0.63 * math.radians(8.0):
            return 0.002 * (tick + 1)
    pytest.fail("it never got there")


def test_a_gain_set_in_flight_acts_in_flight() -> None:
    pilot, companion = in_the_air(200.0)
    before_s = rise_s(pilot, companion)
    companion.send(mavlink.MAVLink_param_set_message(1, 1, b"MC_ROLL_P", 2.0, mavlink.MAV_PARAM_TYPE_REAL32))
    after_s = rise_s(pilot, companion)
    assert after_s / before_s == pytest.approx(0.56 / 0.32, rel=0.15)
    companion.send(mavlink.MAVLink_param_set_message(1, 1, b"MC_ROLL_P", 4.0, mavlink.MAV_PARAM_TYPE_REAL32))
    assert rise_s(pilot, companion) == pytest.approx(before_s, abs=0.003)


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
