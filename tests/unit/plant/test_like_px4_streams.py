"""When the plant sends what, beside a real PX4 v1.17: ODOMETRY, its resets, CURRENT_MODE, messages asked for."""

from __future__ import annotations

import statistics
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

PX4: Final = Path(__file__).resolve().parents[3] / "config" / "px4_quadrotor.yaml"
ODOMETRY: Final = mavlink.MAVLINK_MSG_ID_ODOMETRY
CURRENT_MODE: Final = mavlink.MAVLINK_MSG_ID_CURRENT_MODE
SET_INTERVAL: Final = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
REQUEST: Final = mavlink.MAV_CMD_REQUEST_MESSAGE
HOLD: Final = (1.0, 4.0, 3.0)
POSITION: Final = (1.0, 3.0)


def plant(*overrides: str) -> tuple[Autopilot, MemoryClient]:
    pilot = build_world(load_config(PX4, ("plant.telemetry=px4", *overrides))).autopilot
    (companion,) = clients(pilot, (Profile.ONBOARD, 191))
    companion.heartbeat()
    return pilot, companion


def named(heard: list[Any], name: str) -> list[Any]:
    return [message for message in heard if message.get_type() == name]


def odometry_asked(hz: float, seconds: float = 4.0) -> list[Any]:
    _, companion = plant()
    companion.command(SET_INTERVAL, ODOMETRY, 1e6 / hz)
    companion.collect(0.1)
    return named(companion.collect(seconds), "ODOMETRY")


@pytest.mark.parametrize(
    ("asked_hz", "comes_hz", "apart_us"),
    [
        (50, 50, {16_000, 24_000}),
        (100, 100, {8_000, 16_000}),
        (125, 125, {8_000}),
        (200, 125, {8_000}),
        (250, 125, {8_000}),
        (400, 125, {8_000}),
    ],
)
def test_odometry_comes_as_often_as_ekf2_has_samples(asked_hz: float, comes_hz: float, apart_us: set[int]) -> None:
    heard = odometry_asked(asked_hz)
    assert len(heard) == pytest.approx(4 * comes_hz, abs=1)
    stamps = [message.time_usec for message in heard]
    assert {b - a for a, b in pairwise(stamps)} == apart_us


def test_odometry_comes_late() -> None:
    _, companion = plant()
    companion.command(SET_INTERVAL, ODOMETRY, 4_000)
    companion.collect(0.1)
    late_ms: list[float] = []
    for _ in range(500):
        message = companion.wait("ODOMETRY")
        late_ms.append(1e3 * companion.now_s() - 1e-3 * message.time_usec)
    assert statistics.median(late_ms) == pytest.approx(2.5, abs=0.6)
    assert statistics.quantiles(late_ms, n=20)[-1] == pytest.approx(4.9, abs=0.6)


def test_even_telemetry_is_not_late() -> None:
    _, companion = plant("plant.telemetry=even")
    companion.command(SET_INTERVAL, ODOMETRY, 4_000)
    stamps = [message.time_usec for message in named(companion.collect(1.0), "ODOMETRY")][-200:]
    assert {b - a for a, b in pairwise(stamps)} == {4_000}


def test_at_rest_it_is_noisy() -> None:
    _, companion = plant("plant.sensors={preset: gps}")
    companion.command(SET_INTERVAL, ODOMETRY, 8_000)
    companion.collect(0.1)
    poses = [(m.x, m.y, m.z, m.vx, m.vy, m.vz) for m in named(companion.collect(2.0), "ODOMETRY")]
    assert len(poses) > 200
    assert len(set(poses)) == len(poses)


def test_resets_are_counted_from_11_and_once_more_in_the_climb() -> None:
    pilot, companion = plant()
    assert companion.wait("ODOMETRY").reset_counter == 11
    companion.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    companion.command(mavlink.MAV_CMD_NAV_TAKEOFF, *(0.0,) * 6, 500.0)
    climb = named(companion.collect(8.0), "ODOMETRY")
    assert pilot.commander.mode in (FlightMode.TAKEOFF, FlightMode.HOLD)
    assert {m.reset_counter for m in climb if m.z > -1.4} == {11}
    assert {m.reset_counter for m in climb if m.z < -1.6} == {12}


@pytest.mark.parametrize("interval_us", [0, 50_000, 2_000_000], ids=["default", "20 Hz", "0.5 Hz"])
def test_current_mode_comes_twice_a_second_and_at_once(interval_us: int) -> None:
    pilot, companion = plant()
    pilot.commander.manual_control = True
    companion.command(SET_INTERVAL, CURRENT_MODE, interval_us)
    companion.collect(0.5)
    assert len(named(companion.collect(5.0), "CURRENT_MODE")) == pytest.approx(10, abs=1)
    for mode, wanted in ((POSITION, FlightMode.POSCTL), (HOLD, FlightMode.HOLD)):
        companion.command(mavlink.MAV_CMD_DO_SET_MODE, *mode)
        asked_s = companion.now_s()
        companion.wait("CURRENT_MODE", lambda m, mode=wanted: m.custom_mode == custom_mode(mode))
        assert companion.now_s() - asked_s <= 0.03
        companion.collect(0.17)


@pytest.mark.parametrize("message_id", [242, 49, CURRENT_MODE], ids=["HOME_POSITION", "ORIGIN", "CURRENT_MODE"])
def test_what_has_nothing_new_is_denied(message_id: int) -> None:
    _, companion = plant()
    companion.command(SET_INTERVAL, message_id, -1)
    companion.command(REQUEST, message_id)
    first = companion.acknowledged(REQUEST)
    companion.command(REQUEST, message_id)
    assert (first, companion.acknowledged(REQUEST)) == (Result.ACCEPTED, Result.DENIED)


def test_a_new_home_can_be_asked_for_again() -> None:
    _, companion = plant()
    companion.command(REQUEST, 242)
    companion.acknowledged(REQUEST)
    companion.collect(0.1)
    companion.command(mavlink.MAV_CMD_DO_SET_HOME, 1.0)
    companion.command(REQUEST, 242)
    assert companion.acknowledged(REQUEST) == Result.ACCEPTED


def test_it_asks_for_the_time_ten_times_a_second() -> None:
    _, companion = plant()
    asked = [message for message in named(companion.collect(2.0), "TIMESYNC") if message.tc1 == 0]
    assert len(asked) == pytest.approx(20, abs=1)
