"""Set-points that are none, yaw and gains: the plant beside a real PX4 v1.17, same scripts at both."""

from __future__ import annotations

import math
from typing import Final

import pytest
from harness.plant_client import MemoryClient
from harness.px4_plant import HOVER, LEVEL, in_the_air, stream, tilt_deg
from pymavlink.dialects.v20 import development as mavlink

from sitl.autopilot.autopilot import Autopilot
from sitl.vehicles.rotation import euler, quaternion

NAN: Final = math.nan


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
