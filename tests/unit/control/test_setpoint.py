"""The flown set-point: a straight line at its speed, the short way round at its rate, and it arrives."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.control.setpoint import SetpointParams, advance, turn
from companion.control.types import PositionSetpoint

places = st.floats(-100.0, 100.0)
angles = st.floats(-20.0, 20.0)
commands = st.builds(PositionSetpoint, places, places, places, angles)


@given(commands, commands, st.floats(0.1, 10.0), st.floats(0.1, 10.0), st.floats(0.0, 0.1))
def test_it_travels_straight_and_no_faster(
    flown: PositionSetpoint, target: PositionSetpoint, speed: float, rate: float, dt: float
) -> None:
    after = advance(SetpointParams(speed, rate), flown, target, dt)
    step, way = math.dist(after[:3], flown[:3]), math.dist(target[:3], flown[:3])
    assert step == pytest.approx(min(speed * dt, way), abs=1e-9)
    assert step + math.dist(after[:3], target[:3]) == pytest.approx(way, abs=1e-9)  # on the line between them
    turned, around = turn(flown.yaw_rad, after.yaw_rad), turn(flown.yaw_rad, target.yaw_rad)
    assert abs(turned) == pytest.approx(min(rate * dt, abs(around)), abs=1e-9)
    assert turned * around >= 0.0


def test_it_arrives_exactly() -> None:
    params, flown, target = (
        SetpointParams(2.0, 1.0),
        PositionSetpoint(0.0, 0.0, 0.0, 3.0),
        PositionSetpoint(1.0, 2.0, -2.0, -3.0),
    )
    ticks = 0
    while flown != target:
        flown = advance(params, flown, target, 0.01)
        ticks += 1
        assert ticks < 1000
    assert ticks == pytest.approx(150, abs=2)  # 3 m at 2 m/s; 0.28 rad the short way is done before


def test_without_a_speed_it_jumps_and_still_turns_slowly() -> None:
    after = advance(SetpointParams(math.inf, 1.0), PositionSetpoint(0, 0, 0, 0), PositionSetpoint(9, 9, 9, 1.0), 0.01)
    assert after == (9, 9, 9, pytest.approx(0.01))
    assert advance(SetpointParams(math.inf, 1.0), PositionSetpoint(0, 0, 0, 0), PositionSetpoint(9, 9, 9, 0), 0.0) == (
        9,
        9,
        9,
        0,
    )


@given(st.floats(allow_nan=False, allow_infinity=False), st.floats(-1e6, 1e6))
def test_it_stays_finite(far: float, yaw: float) -> None:
    after = advance(SetpointParams(1.0, 1.0), PositionSetpoint(0, 0, 0, 0), PositionSetpoint(far, -far, far, yaw), 0.01)
    assert all(map(math.isfinite, after))
