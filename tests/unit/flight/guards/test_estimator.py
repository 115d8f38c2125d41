"""Resets of the estimator: what they did, and the budget that they share with what nobody counted."""

import math

import pytest
from pymavlink.dialects.v20 import development as mavlink

from companion.control.types import Odometry
from companion.flight.guards import estimator
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


def test_steps_add_up_over_a_minute_whether_counted_or_not() -> None:
    steps = estimator.Steps()
    assert steps.total_m(10.0) == 0.0
    steps.count(10.0, 0.4)
    steps.add(11.0, 0.4)
    assert steps.total_m(11.0) == pytest.approx(0.8)
    steps.add(69.0, 0.3)
    assert steps.total_m(69.0) == pytest.approx(1.1)
    assert steps.total_m(70.5) == pytest.approx(0.7)
    assert steps.total_m(300.0) == 0.0


def test_a_counter_that_runs_uses_the_budget_up_though_nothing_moves() -> None:
    steps = estimator.Steps()
    for n in range(10):
        steps.count(10.0 + 0.008 * n, 1e-4)
    assert steps.total_m(10.1) == pytest.approx(1.0)
