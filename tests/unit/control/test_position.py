"""(4)-(6) and the whole position step: forces become attitudes, the control frame turns, the start is bumpless."""

import inspect
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.control import (
    altitude,
    attitude,
    ease,
    frame,
    hover,
    limits,
    mrac,
    position,
    projection,
    reference_model,
    setpoint,
    tracking,
)
from companion.control.ease import EaseState
from companion.control.types import AttitudeSetpoint, Jump, Odometry, PositionSetpoint, Reference
from sitl.vehicles.rotation import quaternion

angles = st.floats(-math.pi, math.pi)
ALTITUDE = altitude.AltitudeParams(1.5, 4.0, 1.0, 0.2, 30.0, 3.0, 1.0, 9.81)


def extract(force_x: float, force_y: float, force_z: float, yaw_rad: float) -> AttitudeSetpoint:
    return AttitudeSetpoint(*attitude.orient(force_x, force_y, force_z, math.cos(yaw_rad), math.sin(yaw_rad)))


def rotation(q: tuple[float, float, float, float]) -> np.ndarray:
    w, x, y, z = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


STILL = hover.HoverParams(0.0, 5.0, 0.3, 0.8, 0.05, 9.81)


def params(
    *, one_axis: bool = False, tilt_deg: float = 35.0, at_setpoint: bool = False, free: bool = False
) -> position.PositionParams:
    """`free` adds everything that flight has and the paper has not."""
    _, p12, p22 = mrac.solve_lyapunov(2.3, 0.7, 1.0, 1.0)
    x = mrac.AxisParams(2.3, 0.7, 9.81, 100.0, p12, p22, -0.55, 0.55, -0.35, 0.35, True)
    y = x
    if free:
        x = x._replace(adaptation_rate=1.0, bias_adaptation_rate=2.0, bias_bound=0.3)
        y = x._replace(natural_frequency_rad_s=2.2)
    return position.PositionParams(
        x,
        y,
        ALTITUDE,
        one_axis,
        at_setpoint or free,
        limits.LimitParams(math.radians(tilt_deg), 0.05, 0.95, 5.0 if free else math.inf, 9.81),
        setpoint.SetpointParams(1.0 if free else math.inf, math.radians(45.0)),
        STILL._replace(rate_1_s=0.5) if free else STILL,
    )


SETTLED = EaseState(0.0, 0.0, 0.0, 0.0, False)  # long after engagement


def engage(
    odometry: Odometry, yaw: float, weights_x: tuple[float, float], weights_y: tuple[float, float]
) -> position.PositionState:
    return position.engage(params(), odometry, yaw, weights_x, weights_y, 0.5)


def level(x: float = 0.0, y: float = 0.0, z: float = -1.0, yaw: float = 0.0) -> Odometry:
    return Odometry(0.0, x, y, z, 0.0, 0.0, 0.0, math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2))


@given(st.floats(-1.5, 1.5), st.floats(-1.5, 1.5), st.floats(-2.0, -0.2), angles)
def test_attitude_extraction_5_6(fx: float, fy: float, fz: float, yaw: float) -> None:
    sp = extract(fx, fy, fz, yaw)
    r = rotation((sp.qw, sp.qx, sp.qy, sp.qz))
    np.testing.assert_allclose(-sp.thrust * r[:, 2], [fx, fy, fz], atol=1e-9)  # (5): f_d = T R i3, z down
    assert math.hypot(sp.qw, sp.qx, sp.qy, sp.qz) == pytest.approx(1.0)
    heading = np.array([math.cos(yaw), math.sin(yaw), 0.0])
    assert r[:, 1] @ heading == pytest.approx(0.0, abs=1e-9)  # (6): b2 is normal to the heading, b1 along it
    assert r[:, 0] @ heading > 0.0


@given(st.floats(-0.7, 0.7), st.floats(-0.7, 0.7), angles)
def test_thrust_direction_and_yaw_undo_extraction(fx: float, fy: float, yaw: float) -> None:
    sp = extract(fx, fy, -1.0, yaw)
    direction = attitude.thrust_direction(sp.qw, sp.qx, sp.qy, sp.qz)
    assert np.array(direction) * sp.thrust == pytest.approx([fx, fy, -1.0], abs=1e-9)
    flat = extract(0.0, 0.0, -1.0, yaw)
    turn = attitude.yaw(flat.qw, flat.qx, flat.qy, flat.qz) - yaw
    assert math.atan2(math.sin(turn), math.cos(turn)) == pytest.approx(0.0, abs=1e-9)


def test_signs_of_15_small_pitch_moves_back_and_small_roll_moves_right() -> None:
    """v̇x = -g θ and v̇y = g φ: w is the specific force over g, so w_x = -θ and w_y = φ."""
    theta, phi = 0.01, 0.02
    pitched = Odometry(0, 0, 0, 0, 0, 0, 0, math.cos(theta / 2), 0.0, math.sin(theta / 2), 0.0)
    rolled = Odometry(0, 0, 0, 0, 0, 0, 0, math.cos(phi / 2), math.sin(phi / 2), 0.0, 0.0)
    assert frame.in_control_frame(pitched, 0.0, 0.0, 1.0, 0.0, 1.0).wx == pytest.approx(-theta, rel=1e-4)
    assert frame.in_control_frame(rolled, 0.0, 0.0, 1.0, 0.0, 1.0).wy == pytest.approx(phi, rel=1e-4)


def climb(
    state: altitude.AltitudeState, z: float, v: float, to_z: float, dt: float, *, highest: float = 5.0
) -> tuple[altitude.AltitudeState, float]:
    """One tick whose thrust is flown as it was wanted, up to `highest`."""
    return altitude.step(ALTITUDE, state, z, v, to_z, dt, min(state.up, highest), 0.1, highest, 1.0)


def test_altitude_4_hover_and_integrator_limit() -> None:
    state = altitude.start(-1.0, 0.0)
    _, up = climb(state, -1.0, 0.0, -1.0, 0.01)
    assert up == pytest.approx(1.0)
    for _ in range(5000):
        state, up = climb(state, 0.0, 0.0, -10.0, 0.01)
    assert state.integral_m_s2 == 3.0
    assert up == pytest.approx(1.0 + (4.0 * 1.0 + 3.0) / 9.81)


def test_altitude_does_not_integrate_into_a_saturated_thrust() -> None:
    """Held back below its set-point by a thrust limit, it does not wind up, and unwinds at once."""
    state = altitude.start(0.0, 0.0)
    for _ in range(1000):
        state, up = climb(state, 0.0, 0.0, -10.0, 0.01, highest=1.5)
        assert up <= 1.5
    assert up > 1.49  # it integrates up to the limit, and no farther
    state = altitude.start(0.0, 0.0)
    for _ in range(1000):
        state, up = climb(state, 0.0, 0.0, -10.0, 0.01, highest=1.2)
    assert up > 1.2
    assert state.integral_m_s2 == 0.0
    state, _ = climb(state, 0.0, -1.5, -10.0, 0.01, highest=1.2)  # climbing too fast: away from the limit
    assert state.integral_m_s2 < 0.0


def test_altitude_4_rejects_a_wrong_hover_thrust() -> None:
    z, v, state = -1.0, 0.0, altitude.start(-1.0, 0.0)
    for _ in range(8000):
        state, up = climb(state, z, v, -1.5, 0.005)
        v += 0.005 * (9.81 - 0.9 * 9.81 * up)
        z += 0.005 * v
    assert z == pytest.approx(-1.5, abs=1e-3)
    assert state.reference_z_m == pytest.approx(-1.5, abs=1e-3)


def test_altitude_reference_is_what_an_undisturbed_vehicle_does() -> None:
    """Saturated or not: the reference knows the thrust that was flown."""
    for highest in (5.0, 1.1):
        z, v, state, up = -1.0, 0.0, altitude.start(-1.0, 0.0), 1.0
        no_derivative = ALTITUDE._replace(derivative_gain=0.0)
        for _ in range(3000):
            state, up = altitude.step(
                no_derivative, state, z, v, -3.0, 0.002, min(state.up, highest), 0.1, highest, 1.0
            )
            v += 0.002 * 9.81 * (1.0 - min(up, highest))
            z += 0.002 * v
            assert z == pytest.approx(state.reference_z_m, abs=0.02)
        assert z == pytest.approx(-3.0, abs=0.2)


@given(angles, st.floats(-20, 20), st.floats(-20, 20))
def test_start_is_bumpless_anywhere_and_at_any_heading(yaw: float, x: float, y: float) -> None:
    here = level(x, y, -1.0, yaw)
    state = engage(here, yaw, (0.5, 0.3), (0.5, 0.3))
    _, out = position.step(params(), state, here, PositionSetpoint(x, y, -1.0, yaw), 0.0)
    turned = rotation((out.setpoint.qw, out.setpoint.qx, out.setpoint.qy, out.setpoint.qz))
    np.testing.assert_allclose(turned, rotation((here.qw, here.qx, here.qy, here.qz)), atol=1e-9)
    assert out.setpoint.thrust == pytest.approx(0.5)


@given(angles)
def test_control_frame_turns_with_yaw(yaw: float) -> None:
    """The same motion seen from a turned heading gives the same set-point, turned."""
    c, s = math.cos(yaw), math.sin(yaw)
    plain, turned = level(), level(yaw=yaw)
    a = engage(plain, 0.0, (0.5, 0.3), (0.5, 0.3))
    b = engage(turned, yaw, (0.5, 0.3), (0.5, 0.3))
    for k in range(1, 20):
        p = (0.01 * k, -0.004 * k)
        a, out_a = position.step(
            params(), a, plain._replace(x_m=p[0], y_m=p[1]), PositionSetpoint(0.3, 0.1, -1, 0.0), 0.01
        )
        there = turned._replace(x_m=c * p[0] - s * p[1], y_m=s * p[0] + c * p[1])
        goal = PositionSetpoint(c * 0.3 - s * 0.1, s * 0.3 + c * 0.1, -1, yaw)
        b, out_b = position.step(params(), b, there, goal, 0.01)
    assert out_b.x.control == pytest.approx(out_a.x.control, abs=1e-12)
    assert out_b.y.control == pytest.approx(out_a.y.control, abs=1e-12)
    assert out_b.setpoint.thrust == pytest.approx(out_a.setpoint.thrust, abs=1e-12)


def rotated(q: tuple[float, float, float, float], yaw: float) -> np.ndarray:
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ rotation(q)


def angle_deg(a: np.ndarray, b: np.ndarray) -> float:
    return math.degrees(math.acos(min(1.0, max(-1.0, (np.trace(a.T @ b) - 1.0) / 2.0))))


def attitude_of(sp: AttitudeSetpoint) -> tuple[float, float, float, float]:
    return sp.qw, sp.qx, sp.qy, sp.qz


def calm(*, at_setpoint: bool = True) -> position.PositionParams:
    """Wide limits and slow weights: what is looked at is the law itself."""
    axis = params().x._replace(adaptation_rate=1.0, bias_adaptation_rate=1.0, bias_bound=0.3)
    return params(tilt_deg=60.0, at_setpoint=at_setpoint)._replace(x=axis, y=axis)


@settings(max_examples=30)
@given(angles, st.floats(-0.3, 0.3), st.floats(-0.3, 0.3), st.floats(-2, 2), st.floats(-2, 2))
def test_start_is_bumpless_leaning_and_moving(yaw: float, fx: float, fy: float, vx: float, vy: float) -> None:
    """In wind or in a manoeuvre: the first set-point is the attitude as it is; a second later it is the law's."""
    lean = extract(fx, fy, -1.0, yaw)
    unit = 1.0 / lean.thrust
    here = Odometry(0.0, 3.0, 4.0, -5.0, vx, vy, 0.0, lean.qw, lean.qx, lean.qy, lean.qz)
    state = engage(here, yaw, (0.5, 0.3), (0.5, 0.3))
    state, out = position.step(calm(), state, here, PositionSetpoint(3.0, 4.0, -5.0, yaw), 0.0)
    wx, wy, _ = attitude.thrust_direction(*attitude_of(out.setpoint))
    assert (wx / unit, wy / unit) == pytest.approx((fx, fy), abs=0.05)
    before = rotation(attitude_of(out.setpoint))
    for _ in range(300):
        state, out = position.step(calm(), state, here, PositionSetpoint(3.0, 4.0, -5.0, yaw), 0.004)
        now = rotation(attitude_of(out.setpoint))
        assert angle_deg(before, now) < 1.0
        before = now
    assert state.ease.left_s == 0.0
    flown = math.hypot(state.force[0] - out.x.control, state.force[1] - out.y.control)
    assert flown == pytest.approx(0.0, abs=1e-12) or out.limited


@settings(max_examples=30)
@given(
    st.floats(-1.4, 1.4), st.floats(-1.4, 1.4), st.floats(-1.4, 1.4),
    st.floats(-1, 1), st.floats(-1, 1), st.floats(-1, 1), st.floats(-0.5, 0.5), angles, st.booleans(),
)  # fmt: skip
def test_reseat_makes_no_attitude_step_at_any_jump(
    x: float, y: float, z: float, vx: float, vy: float, vz: float, turn: float, yaw: float, at_setpoint: bool
) -> None:
    """The estimate jumps, the vehicle does not: seen from the body, neither attitude nor thrust steps."""
    jump = Jump(x, y, z, vx, vy, vz, turn)
    free = calm(at_setpoint=at_setpoint)
    at, velocity, tilt = np.array([1.0, -2.0, -3.0]), np.array([0.2, -0.1, 0.05]), (0.03, -0.05)
    target = PositionSetpoint(1.2, -2.1, -3.1, yaw)

    def sample(k: int, jumped: Jump) -> Odometry:
        heading = yaw + jumped.yaw_rad
        c, s = math.cos(heading), math.sin(heading)
        q = extract(c * tilt[0] - s * tilt[1], s * tilt[0] + c * tilt[1], -1.0, heading)
        p = at + 0.004 * k * velocity + jumped[:3]
        return Odometry(0.004 * k, *p, *(velocity + jumped[3:6]), *attitude_of(q))

    none = Jump(0, 0, 0, 0, 0, 0, 0)
    state = engage(sample(0, none), yaw, (0.5, 0.3), (0.5, 0.3))
    for k in range(300):
        state, out = position.step(free, state, sample(k, none), target, 0.004 if k else 0.0)
    before, thrust = rotation(attitude_of(out.setpoint)), out.setpoint.thrust
    errors = (out.x.error_position_m, out.y.error_position_m, out.x.error_velocity_m_s, out.y.error_velocity_m_s)

    state = position.reseat(state, jump)
    target = PositionSetpoint(target.x_m + x, target.y_m + y, target.z_m + z, target.yaw_rad + turn)
    for k in range(300, 600):
        state, out = position.step(free, state, sample(k, jump), target, 0.004)
        body = rotated(
            attitude_of(out.setpoint), -turn
        )  # as the vehicle sees it, whose attitude jumped by the turn too
        assert angle_deg(before, body) < (0.2 if k == 300 else 0.5)
        assert out.setpoint.thrust == pytest.approx(thrust, abs=0.01)
        before, thrust = body, out.setpoint.thrust
        if k == 300:  # the size of the tracking error is what it was; only a turn of the heading turns it
            after = (out.x.error_position_m, out.y.error_position_m, out.x.error_velocity_m_s, out.y.error_velocity_m_s)
            assert math.hypot(*after[:2]) == pytest.approx(math.hypot(*errors[:2]), abs=0.01)
            assert math.hypot(*after[2:]) == pytest.approx(math.hypot(*errors[2:]), abs=0.02)
    assert state.ease.left_s == 0.0


def test_anchor_goes_along_with_the_setpoint_and_weights_stay() -> None:
    """A second step far away is flown as the first one at home."""
    flown = []
    for home in (0.0, 500.0):
        here = level(home, 2 * home)
        state = engage(here, 0.0, (0.5, 0.3), (0.5, 0.3))
        seen = []
        for k in range(1, 60):
            there = here._replace(x_m=home + 0.3 * math.sin(0.05 * k), y_m=2 * home - 0.1 * math.sin(0.1 * k))
            goal = PositionSetpoint(home + (0.5 if k > 20 else 0.0), 2 * home, -1.0, 0.0)
            weights = state.x.position_weight, state.y.velocity_weight
            if k == 21:  # the anchor has jumped: what the weights learn in one tick is all that changes them
                _, out = position.step(params(at_setpoint=True), state, there, goal, 1e-9)
                after, _ = position.step(params(at_setpoint=True), state, there, goal, 1e-9)
                assert (after.x.position_weight, after.y.velocity_weight) == pytest.approx(weights, abs=1e-6)
                assert (after.anchor_x_m, after.anchor_y_m) == (goal.x_m, goal.y_m)
            state, out = position.step(params(at_setpoint=True), state, there, goal, 0.01)
            seen.append((out.x.control, out.y.control, out.x.error_position_m, out.measured.x_m))
        flown.append(seen)
    np.testing.assert_allclose(flown[1], flown[0], atol=1e-9)


@given(angles, st.floats(-3, 3))
def test_heading_is_slewed_and_what_is_remembered_turns_with_the_frame(yaw: float, turn: float) -> None:
    """A frame that turns while the vehicle stands still in NED: references, u, w and bias stay put in NED."""
    here = level(0.3, -0.2, yaw=yaw)._replace(vx_m_s=0.1, vy_m_s=0.2)
    state = engage(here, yaw, (0.5, 0.3), (0.5, 0.3))
    still = params(at_setpoint=True)._replace(
        x=params().x._replace(adaptation_rate=0.0), y=params().y._replace(adaptation_rate=0.0)
    )
    state = state._replace(
        x=state.x._replace(bias_weight=0.1, control=0.2, reference_position_m=0.5, reference_velocity_m_s=-0.1),
        y=state.y._replace(bias_weight=-0.05, actuator=0.1, ideal_velocity_m_s=0.3),
    )

    def in_ned(s: position.PositionState) -> list[float]:
        c, sine = math.cos(s.flown.yaw_rad), math.sin(s.flown.yaw_rad)
        pairs = [
            (getattr(s.x, name), getattr(s.y, name))
            for name in mrac.AxisState._fields
            if name not in ("position_weight", "velocity_weight")
        ]
        return [v for a, b in pairs for v in (c * a - sine * b, sine * a + c * b)]

    x, y = frame.turn(state.x, state.y, turn)
    turned = state._replace(x=x, y=y, flown=state.flown._replace(yaw_rad=yaw + turn))
    assert in_ned(turned) == pytest.approx(in_ned(state), abs=1e-12)
    heading = yaw
    for _ in range(100):
        state, out = position.step(still, state, here, PositionSetpoint(0.3, -0.2, -1.0, yaw + turn), 0.01)
        assert abs(setpoint.turn(heading, state.flown.yaw_rad)) <= math.radians(45.0) * 0.01 + 1e-12
        heading = state.flown.yaw_rad
        assert math.hypot(state.x.bias_weight, state.y.bias_weight) == pytest.approx(math.hypot(0.1, 0.05))
    wanted = yaw + math.copysign(min(abs(turn), math.radians(45.0)), turn)
    assert setpoint.turn(heading, wanted) == pytest.approx(0.0, abs=1e-9)
    q = attitude_of(out.setpoint)
    assert setpoint.turn(attitude.yaw(*q), heading) == pytest.approx(0.0, abs=0.2)  # tilt bends the heading a little


def test_a_far_command_at_limited_speed_stays_near_the_vehicle() -> None:
    """20 m away: the anchor travels at 1 m/s, so the regressor is the lag of the reference model and no more."""
    free, here = params(free=True), level()
    state = engage(here, 0.0, (0.53, 0.32), (0.53, 0.32))
    p, v, farthest = np.array([0.0, 0.0, -1.0]), np.zeros(3), 0.0
    q = (1.0, 0.0, 0.0, 0.0)
    for k in range(2600):
        sample = here._replace(x_m=p[0], y_m=p[1], z_m=p[2], vx_m_s=v[0], vy_m_s=v[1], vz_m_s=v[2])
        sample = sample._replace(qw=q[0], qx=q[1], qy=q[2], qz=q[3])
        state, out = position.step(free, state, sample, PositionSetpoint(16.0, 12.0, -1.0, 0.0), 0.01 if k else 0.0)
        q = attitude_of(out.setpoint)  # reached at once
        force = np.array(attitude.thrust_direction(*q)) * out.setpoint.thrust / 0.5
        v = v + 0.01 * 9.81 * (force + np.array([0.0, 0.0, 1.0]))
        p = p + 0.01 * v
        farthest = max(farthest, math.hypot(out.measured.x_m, out.measured.y_m))
    assert farthest < 1.1 * 2 * 0.7 / 2.2  # 2 zeta / wn at 1 m/s
    assert p == pytest.approx([16.0, 12.0, -1.0], abs=0.02)


@given(st.floats(-50, 50), st.floats(-50, 50), st.floats(-50, 50))
def test_limits_hold_whatever_is_commanded(x: float, y: float, z: float) -> None:
    state = engage(level(), 0.0, (0.5, 0.3), (0.5, 0.3))._replace(ease=SETTLED)
    _, out = position.step(params(tilt_deg=20.0), state, level(), PositionSetpoint(x, y, z, 0.0), 0.0)
    sp = out.setpoint
    tilt = math.acos(min(1.0, -attitude.thrust_direction(sp.qw, sp.qx, sp.qy, sp.qz)[2]))
    assert math.degrees(tilt) <= 20.0 + 1e-6
    assert 0.05 - 1e-12 <= sp.thrust <= 0.95


def test_rig_keeps_hover_thrust_and_moves_along_x_alone() -> None:
    state = engage(level(z=0.0), 0.0, (0.0, 0.0), (0.0, 0.0))._replace(ease=SETTLED)
    _, out = position.step(params(one_axis=True), state, level(z=0.0), PositionSetpoint(0.35, 5.0, -3.0, 0.0), 0.0)
    assert out.setpoint.thrust == pytest.approx(0.5)
    assert out.y.control == 0.0
    wx, wy, _ = attitude.thrust_direction(out.setpoint.qw, out.setpoint.qx, out.setpoint.qy, out.setpoint.qz)
    assert wx == pytest.approx(out.x.control)  # sin θ is exactly the command, as (28) wants
    assert wy == 0.0


def flat(values: Any) -> list[float]:
    """Every number of a nested record."""
    return [x for v in values for x in flat(v)] if isinstance(values, tuple) else [float(values)]


def test_numba_compiles_the_steps_unchanged_and_agrees(monkeypatch: pytest.MonkeyPatch) -> None:
    numba = pytest.importorskip("numba")

    def fly(*, one_axis: bool, free: bool) -> list[list[float]]:
        start = level()
        state = engage(start, 0.0, (0.1, 0.1), (0.1, 0.1))
        seen = []
        for k in range(1, 200):
            odometry = level(0.01 * math.sin(0.1 * k), 0.02 * math.cos(0.1 * k))._replace(time_s=0.01 * k)
            command = PositionSetpoint(0.2, -0.1, -1.2, 0.7 if free and k > 50 else 0.0)
            if free and k == 100:
                state = position.reseat(state, Jump(0.1, 0.2, -0.3, 0.1, 0.0, 0.2, 0.3))
            flown = params(one_axis=one_axis, free=free)
            if free and not one_axis and 120 <= k < 140:  # along a trajectory, and off it again
                moving = Reference(0.2, 0.01 * k, -1.2, 0.0, 1.0, 0.1, 0.5, 0.2, 0.1, 0.3, 0.2, 0.1, 1.0, 1.0, 1.0, 0.8)
                state, out = position.step(flown, state, odometry, command, 0.01, moving)
            else:
                state, out = position.step(flown, state, odometry, command, 0.01)
            seen.append(flat(state) + flat(out))
        return seen

    def fly_all() -> list[list[list[float]]]:
        return [fly(one_axis=one_axis, free=free) for one_axis in (False, True) for free in (False, True)]

    plain = fly_all()
    modules = (
        projection, reference_model, mrac, altitude, attitude, setpoint, limits, hover, ease, frame, tracking, position,
    )  # fmt: skip
    for module in modules:  # from the bottom up: each function finds those below it compiled
        for name, function in inspect.getmembers(module, inspect.isfunction):
            monkeypatch.setattr(module, name, getattr(inspect.getmodule(function), name))
            if function.__module__ == module.__name__:
                monkeypatch.setattr(module, name, numba.njit(function))
    np.testing.assert_allclose(fly_all(), plain, rtol=1e-9, atol=1e-12)
    assert position.step.signatures  # type: ignore[attr-defined]  # it ran compiled
    assert position.reseat.signatures  # type: ignore[attr-defined]


@pytest.mark.parametrize("one_axis", [False, True])
@given(
    st.floats(-25, 25), st.floats(-25, 25), st.floats(-2, 2), st.floats(-2, 2), st.floats(-1.5, 1.5), st.floats(-3, 3)
)
def test_control_begins_with_the_attitude_that_the_vehicle_has(
    one_axis: bool, roll_deg: float, pitch_deg: float, vx: float, vy: float, vz: float, yaw: float
) -> None:
    if one_axis:
        roll_deg = yaw = 0.0
    q = quaternion(math.radians(roll_deg), math.radians(pitch_deg), yaw)
    here = Odometry(0.0, 1.0, 2.0, -3.0, vx, vy, vz, *q)
    flown = params(one_axis=one_axis)
    state = position.engage(flown, here, yaw, (0.5, 0.3), (0.5, 0.3), 0.5)
    _, out = position.step(flown, state, here, PositionSetpoint(1.0, 2.0, -3.0, yaw), 0.0)
    was, now = attitude.thrust_direction(*q), attitude.thrust_direction(*out.setpoint[:4])
    between = math.degrees(math.acos(min(1.0, sum(a * b for a, b in zip(was, now, strict=True)))))
    assert between < 0.2
    assert out.setpoint.thrust == pytest.approx(0.5 if one_axis else 0.5 / -was[2], rel=1e-6)
