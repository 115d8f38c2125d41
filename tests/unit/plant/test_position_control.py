"""PX4's own position controller, against what its block diagram says."""

import math

import pytest

from sitl.autopilot.position_control import (
    PositionControlParams,
    PositionControlSetpoint,
    PositionControlState,
    step,
)

PX4 = PositionControlParams()
REST = (0.0, 0.0, 0.0)
HOVER = 0.5
G = 9.80665


def thrust(
    setpoint: PositionControlSetpoint,
    position: tuple[float, float, float] = REST,
    state: PositionControlState | None = None,
) -> tuple[PositionControlState, tuple[float, float, float]]:
    return step(PX4, state or PositionControlState(), position, REST, setpoint, HOVER, 0.01)


def test_where_it_should_be_it_hovers() -> None:
    _, vector = thrust(PositionControlSetpoint(REST))
    assert vector == pytest.approx((0.0, 0.0, -HOVER))


def test_position_error_becomes_speed_becomes_acceleration() -> None:
    _, (tx, ty, tz) = thrust(PositionControlSetpoint((1.0, 0.0, 0.0)))
    assert tx / -tz * G == pytest.approx(0.95 * 1.8, rel=1e-3)  # MPC_XY_P, MPC_XY_VEL_P_ACC
    assert ty == 0.0
    assert tz == pytest.approx(-HOVER)  # the tilt costs no height


def test_it_climbs_no_faster_than_it_may() -> None:
    _, near = thrust(PositionControlSetpoint((0.0, 0.0, -3.0)))
    _, far = thrust(PositionControlSetpoint((0.0, 0.0, -30.0)))
    assert near[2] == pytest.approx(far[2])


def test_tilt_is_limited() -> None:
    _, (tx, _, tz) = thrust(PositionControlSetpoint((100.0, 0.0, 0.0)))
    assert math.degrees(math.atan2(tx, -tz)) <= 45.0 + 1e-6


def test_thrust_stays_within_its_limits_and_keeps_a_horizontal_margin() -> None:
    _, (tx, ty, tz) = step(
        PX4, PositionControlState(), REST, (0.0, 0.0, 3.0), PositionControlSetpoint((50.0, 0.0, -50.0)), HOVER, 0.01
    )
    assert math.hypot(tx, ty, tz) <= 1.0 + 1e-9
    assert math.hypot(tx, ty) >= 0.3 - 1e-9  # MPC_THR_XY_MARG


def test_a_steady_push_is_taken_up_by_the_integral() -> None:
    state, position, velocity = PositionControlState(), 0.0, 0.0
    for _ in range(6000):
        state, (tx, _, tz) = step(
            PX4, state, (position, 0.0, 0.0), (velocity, 0.0, 0.0), PositionControlSetpoint(REST), HOVER, 0.01
        )
        velocity += 0.01 * (tx / -tz * G - 1.0)  # 1 m/s^2 of wind
        position += 0.01 * velocity
    assert position == pytest.approx(0.0, abs=5e-3)
    assert state.integral_m_s2[0] == pytest.approx(1.0, rel=0.02)


def test_feed_forward_beyond_the_limit_is_cut_and_the_way_home_is_not() -> None:
    _, (tx, ty, _) = thrust(PositionControlSetpoint((12.0 / 0.95, 0.0, 0.0), (0.0, 5.0, 0.0)))
    assert ty == pytest.approx(0.0, abs=1e-9)
    assert tx > 0.0
