"""(1)-(2), (7), (27)-(28) and the linear responses: the vehicles of the plant against closed forms."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from companion.attitude_response.kind import LinearResponse
from companion.attitude_response.kinds import FirstOrder, SecondOrder
from sitl.vehicles import quadrotor, rig
from sitl.vehicles.attitude_loop import AngleGains, RateGains, RateState, respond, wanted_rates
from sitl.vehicles.rotation import euler, quaternion

REST = RateState(0.0, 0.0)
RATE = RateGains(40.0, 0.0, 0.0, 1.0, 10.0)


def a_quadrotor(**changes: object) -> quadrotor.QuadrotorParams:
    params = quadrotor.QuadrotorParams(
        0.25, 0.1, 3e-4, 3e-4, 5e-4, False,
        *(LinearResponse(FirstOrder, (bandwidth,)) for bandwidth in (9.0, 5.5, 3.0)),
        AngleGains(9.0, 5.5, 3.0), RATE, RATE, RATE,
    )  # fmt: skip
    return params._replace(**changes)  # type: ignore[arg-type]


def at_rest(**changes: float) -> quadrotor.QuadrotorState:
    state = quadrotor.QuadrotorState(0, 0, -1, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, REST, REST, REST)
    return state._replace(**changes)  # type: ignore[arg-type]


@given(st.floats(0.5, 20.0), st.floats(1e-3, 0.1))
def test_first_order_response_18_is_exact(bandwidth: float, dt: float) -> None:
    angle, *_ = respond(LinearResponse(FirstOrder, (bandwidth,)), 0.0, 0.0, (), 0.1, dt)
    assert angle == pytest.approx(0.1 * (1.0 - math.exp(-bandwidth * dt)))


def test_second_order_response_overshoots_as_its_damping_says() -> None:
    angle, rate, top = 0.0, 0.0, 0.0
    for _ in range(3000):
        angle, rate, _ = respond(LinearResponse(SecondOrder, (9.0, 0.5)), angle, rate, (), 0.1, 1e-3)
        top = max(top, angle)
    assert top / 0.1 - 1.0 == pytest.approx(math.exp(-math.pi * 0.5 / math.sqrt(0.75)), abs=1e-3)
    assert angle == pytest.approx(0.1, abs=1e-5)


def test_rig_28_falls_along_the_guide_with_minus_g_sine_theta() -> None:
    params = rig.RigParams(0.0, 0.0, 0.005, False, LinearResponse(FirstOrder, (1e6,)), 0.0, RATE)
    state = rig.RigState(0.0, 0.0, 0.2, 0.0, REST)
    for _ in range(1000):
        state = rig.Dynamics(params, 1e-3).step(state, 0.2, 1.0)
    assert state.velocity_m_s == pytest.approx(-9.81 * math.sin(0.2))
    assert state.position_m == pytest.approx(-0.5 * 9.81 * math.sin(0.2), rel=1e-6)


def test_rig_friction_stops_it() -> None:
    params = rig.RigParams(1.2, 0.25, 0.005, False, LinearResponse(FirstOrder, (3.0,)), 0.0, RATE)
    state = rig.RigState(0.0, 0.5, 0.0, 0.0, REST)
    for _ in range(3000):
        state = rig.Dynamics(params, 1e-3).step(state, 0.0, 1.0)
    assert abs(state.velocity_m_s) < 1e-3
    assert 0.1 < state.position_m < 0.5 / 1.2


def test_rig_27_cascade_follows_like_its_gain() -> None:
    params = rig.RigParams(0.0, 0.0, 0.005, True, LinearResponse(FirstOrder, (1.0,)), 3.0, RATE)
    state, t63 = rig.RigState(0.0, 0.0, 0.0, 0.0, REST), 0.0
    while state.pitch_rad < 0.1 * (1.0 - math.exp(-1.0)):
        state = rig.Dynamics(params, 1e-3).step(state, 0.1, 1.0)
        t63 += 1e-3
    assert t63 == pytest.approx(1.0 / 3.0, rel=0.15)


def test_quadrotor_2_hovers_at_its_weight_and_falls_at_g() -> None:
    hover, falling = at_rest(), at_rest()
    for _ in range(1000):
        hover = quadrotor.Dynamics(a_quadrotor(), 1e-3).step(hover, (1, 0, 0, 0), 0.25 * 9.81)
        falling = quadrotor.Dynamics(a_quadrotor(drag_n_s2_m2=0.0), 1e-3).step(falling, (1, 0, 0, 0), 0.0)
    assert hover.z_m == pytest.approx(-1.0, abs=1e-12)
    assert falling.z_m - (-1.0) == pytest.approx(0.5 * 9.81, rel=1e-6)


def test_quadrotor_2_drag_gives_its_terminal_velocity() -> None:
    state = at_rest()
    for _ in range(20000):
        state = quadrotor.Dynamics(a_quadrotor(), 1e-3).step(state, (1, 0, 0, 0), 0.0)
    assert state.vz_m_s == pytest.approx(math.sqrt(0.25 * 9.81 / 0.1), rel=1e-4)


@pytest.mark.parametrize("cascade", [False, True])
def test_quadrotor_signs_of_15(cascade: bool) -> None:
    """Nose down goes north, right side down goes east."""
    south = quaternion(0.0, 0.05, 0.0)
    east = quaternion(0.05, 0.0, 0.0)
    for wanted, where in ((south, "x"), (east, "y")):
        state = at_rest()
        for _ in range(500):
            state = quadrotor.Dynamics(a_quadrotor(cascade=cascade), 1e-3).step(state, wanted, 0.25 * 9.81)
        assert (state.vx_m_s < -0.05) if where == "x" else (state.vy_m_s > 0.05)
        assert abs(state.vy_m_s if where == "x" else state.vx_m_s) < 1e-6


def test_rotation_1_turns_like_the_exponential_and_keeps_the_momentum() -> None:
    """No torque: R' = R S(ω) with a steady spin about a principal axis; the quaternion stays one long."""
    off = RateGains(0.0, 0.0, 0.0, 1.0, 0.0)
    params = a_quadrotor(cascade=True, roll_rate=off, pitch_rate=off, yaw_rate=off)
    state = at_rest(r_rad_s=2.0)
    for _ in range(1000):
        state = quadrotor.Dynamics(params, 1e-3).step(state, (1, 0, 0, 0), 0.25 * 9.81)
    assert euler(state.qw, state.qx, state.qy, state.qz)[2] == pytest.approx(2.0, abs=1e-6)
    tumbling = at_rest(p_rad_s=1.0, q_rad_s=2.0, r_rad_s=3.0)
    j = np.array([3e-4, 3e-4, 5e-4])
    for _ in range(1000):
        tumbling = quadrotor.Dynamics(params, 1e-4).step(tumbling, (1, 0, 0, 0), 0.25 * 9.81)
    rates = np.array([tumbling.p_rad_s, tumbling.q_rad_s, tumbling.r_rad_s])
    assert np.linalg.norm(j * rates) == pytest.approx(np.linalg.norm(j * [1.0, 2.0, 3.0]), rel=1e-3)
    assert np.linalg.norm([tumbling.qw, tumbling.qx, tumbling.qy, tumbling.qz]) == pytest.approx(1.0)


def test_attitude_controller_7_is_gain_times_angle_for_small_errors() -> None:
    gains = AngleGains(9.0, 5.5, 3.0)
    for axis, gain in enumerate(gains):
        angles = [0.0, 0.0, 0.0]
        angles[axis] = 1e-3
        rates = wanted_rates(gains, quaternion(*angles), (1.0, 0.0, 0.0, 0.0))
        assert rates[axis] == pytest.approx(gain * 1e-3, rel=1e-4)
        assert max(abs(r) for i, r in enumerate(rates) if i != axis) < 1e-8


@given(*[st.floats(-1.4, 1.4)] * 3)
def test_quaternion_and_euler_agree_with_scipy(roll: float, pitch: float, yaw: float) -> None:
    q = quaternion(roll, pitch, yaw)
    w, x, y, z = q
    reference = Rotation.from_euler("ZYX", [yaw, pitch, roll])
    np.testing.assert_allclose(Rotation.from_quat([x, y, z, w]).as_matrix(), reference.as_matrix(), atol=1e-12)
    assert euler(*q) == pytest.approx((roll, pitch, yaw), abs=1e-9)
