"""Resets of the estimator: what they did, and slides that nobody counted."""

import math

import pytest
from pymavlink.dialects.v20 import development as mavlink

from companion.control.types import Odometry
from companion.flight.guards import estimator
from companion.flight.guards.estimator import Consistency, consistency
from companion.flight.vehicle_link.estimator_health import missing_flags

GOOD = 0b1101111111  # what a PX4 with GPS says in flight
AT_REST = Odometry(10.0, 1.0, 2.0, -3.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("flags", "missing"),
    [
        (GOOD, 0),
        (0b1101100101, 2),  # as recorded 5.6 s after GPS was lost: no horizontal position, no horizontal velocity
        (0b0001100101, 2),
        (GOOD & ~mavlink.ESTIMATOR_POS_HORIZ_ABS, 0),  # relative position is all that a local flight needs
        (GOOD & ~mavlink.ESTIMATOR_POS_HORIZ_REL, 0),
        (GOOD & ~mavlink.ESTIMATOR_ATTITUDE, 1),
        (0, 5),
    ],
)
def test_flags_that_a_position_controller_needs(flags: int, missing: int) -> None:
    assert missing_flags(flags) == missing


def test_a_jump_is_what_velocity_does_not_explain() -> None:
    before = AT_REST._replace(vx_m_s=1.0, vz_m_s=-0.5)
    after = before._replace(time_s=10.1, x_m=1.1 + 0.3, y_m=2.0 - 0.4, z_m=-3.05 + 1.2, vy_m_s=0.2)
    jump = estimator.jump(before, after)
    assert jump[:3] == pytest.approx((0.3, -0.4, 1.2))
    assert jump[3:6] == pytest.approx((0.0, 0.2, 0.0))
    assert jump.yaw_rad == 0.0
    assert estimator.length_m(jump) == pytest.approx(1.3)


@pytest.mark.parametrize(("turned_deg", "expected_deg"), [(1.0, 0.0), (20.0, 20.0), (-170.0, -170.0), (350.0, -10.0)])
def test_the_heading_jumps_too_but_turning_is_no_jump(turned_deg: float, expected_deg: float) -> None:
    half = math.radians(turned_deg) / 2.0
    after = AT_REST._replace(time_s=10.01, qw=math.cos(half), qz=math.sin(half))
    assert math.degrees(estimator.jump(AT_REST, after).yaw_rad) == pytest.approx(expected_deg)


def test_resets_add_up_over_a_minute() -> None:
    resets = estimator.Resets()
    assert resets.add(10.0, 0.4) == pytest.approx(0.4)
    assert resets.add(11.0, 0.4) == pytest.approx(0.8)
    assert resets.add(69.0, 0.3) == pytest.approx(1.1)
    assert resets.add(70.5, 0.1) == pytest.approx(0.8)
    assert resets.add(300.0, 0.2) == pytest.approx(0.2)


def slid(speed_m_s: float, said_m_s: float, seconds: float, period_s: float = 0.02) -> float:
    """How far position and velocity are apart after moving at one speed and telling another."""
    state, drift_m = Consistency(AT_REST._replace(vx_m_s=said_m_s)), 0.0
    for k in range(1, round(seconds / period_s) + 1):
        t = k * period_s
        sample = AT_REST._replace(time_s=10.0 + t, x_m=1.0 + speed_m_s * t, vx_m_s=said_m_s)
        state, drift_m = consistency(state, sample)
    return drift_m


def test_a_steady_difference_of_real_estimators_stays_far_below_the_limit() -> None:
    assert slid(2.0, 2.0, 10.0) < 1e-9
    assert slid(0.2, 0.0, 10.0) == pytest.approx(0.1, abs=0.01)


def test_a_slide_of_five_metres_in_0_6_s_shows_within_a_quarter_of_a_second() -> None:
    assert slid(5.0 / 0.6, 0.0, 0.1) < 1.0
    assert slid(5.0 / 0.6, 0.0, 0.25) > 1.0


def test_it_does_not_depend_on_how_often_it_is_looked_at() -> None:
    assert slid(8.0, 0.0, 0.4, 0.004) == pytest.approx(slid(8.0, 0.0, 0.4, 0.02), rel=0.05)


def test_a_counted_jump_is_no_slide() -> None:
    before = AT_REST._replace(vx_m_s=0.5)
    after = before._replace(time_s=10.02, x_m=1.01 + 4.0, vx_m_s=0.1, vz_m_s=0.3)
    state, drift_m = consistency(Consistency(before), after)
    assert drift_m > 3.5
    state, drift_m = consistency(Consistency(before), after, estimator.jump(before, after))
    assert drift_m < 0.02
    _, drift_m = consistency(state, after._replace(time_s=10.04, x_m=after.x_m + 0.002, z_m=-3.0 + 0.006))
    assert drift_m < 0.02
