"""(4)-(6) and the whole position step: forces become attitudes, the control frame turns, the start is bumpless."""

import inspect
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.control import altitude, attitude, mrac, position, projection, reference_model
from companion.control.types import Command, Odometry

angles = st.floats(-math.pi, math.pi)
ALTITUDE = altitude.AltitudeParams(1.5, 4.0, 1.0, 0.2, 30.0, 3.0, 1.0, 9.81)


def rotation(q: tuple[float, float, float, float]) -> np.ndarray:
    w, x, y, z = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def params(*, one_axis: bool = False, tilt_deg: float = 35.0) -> position.PositionParams:
    _, p12, p22 = mrac.solve_lyapunov(2.3, 0.7, 1.0, 1.0)
    x = mrac.AxisParams(2.3, 0.7, 9.81, 100.0, p12, p22, -0.55, 0.55, -0.35, 0.35, True)
    return position.PositionParams(x, x, ALTITUDE, one_axis, 0.5, 0.05, 0.95, math.radians(tilt_deg))


def level(x: float = 0.0, y: float = 0.0, z: float = -1.0, yaw: float = 0.0) -> Odometry:
    return Odometry(0.0, x, y, z, 0.0, 0.0, 0.0, math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2))


@given(st.floats(-1.5, 1.5), st.floats(-1.5, 1.5), st.floats(-2.0, -0.2), angles)
def test_attitude_extraction_5_6(fx: float, fy: float, fz: float, yaw: float) -> None:
    sp = attitude.extract(fx, fy, fz, yaw)
    r = rotation((sp.qw, sp.qx, sp.qy, sp.qz))
    np.testing.assert_allclose(-sp.thrust * r[:, 2], [fx, fy, fz], atol=1e-9)  # (5): f_d = T R i3, z down
    assert math.hypot(sp.qw, sp.qx, sp.qy, sp.qz) == pytest.approx(1.0)
    heading = np.array([math.cos(yaw), math.sin(yaw), 0.0])
    assert r[:, 1] @ heading == pytest.approx(0.0, abs=1e-9)  # (6): b2 is normal to the heading, b1 along it
    assert r[:, 0] @ heading > 0.0


@given(st.floats(-0.7, 0.7), st.floats(-0.7, 0.7), angles)
def test_thrust_direction_and_yaw_undo_extraction(fx: float, fy: float, yaw: float) -> None:
    sp = attitude.extract(fx, fy, -1.0, yaw)
    direction = attitude.thrust_direction(sp.qw, sp.qx, sp.qy, sp.qz)
    assert np.array(direction) * sp.thrust == pytest.approx([fx, fy, -1.0], abs=1e-9)
    flat = attitude.extract(0.0, 0.0, -1.0, yaw)
    turn = attitude.yaw(flat.qw, flat.qx, flat.qy, flat.qz) - yaw
    assert math.atan2(math.sin(turn), math.cos(turn)) == pytest.approx(0.0, abs=1e-9)


def test_signs_of_15_small_pitch_moves_back_and_small_roll_moves_right() -> None:
    """v̇x = -g θ and v̇y = g φ: w is the specific force over g, so w_x = -θ and w_y = φ."""
    theta, phi = 0.01, 0.02
    pitched = Odometry(0, 0, 0, 0, 0, 0, 0, math.cos(theta / 2), 0.0, math.sin(theta / 2), 0.0)
    rolled = Odometry(0, 0, 0, 0, 0, 0, 0, math.cos(phi / 2), math.sin(phi / 2), 0.0, 0.0)
    assert position.in_control_frame(pitched, 0.0, 0.0, 0.0, 1.0).wx == pytest.approx(-theta, rel=1e-4)
    assert position.in_control_frame(rolled, 0.0, 0.0, 0.0, 1.0).wy == pytest.approx(phi, rel=1e-4)


def test_altitude_4_hover_saturation_and_antiwindup() -> None:
    state = altitude.start(0.0)
    _, up = altitude.step(ALTITUDE, state, -1.0, 0.0, -1.0, 0.01)
    assert up == pytest.approx(1.0)
    for _ in range(5000):
        state, up = altitude.step(ALTITUDE, state, 0.0, 0.0, -10.0, 0.01)
    assert state.integral_m_s2 == 3.0
    assert up == pytest.approx(1.0 + (4.0 * 1.0 + 3.0) / 9.81)


def test_altitude_4_rejects_a_wrong_hover_thrust() -> None:
    z, v, state = -1.0, 0.0, altitude.start(0.0)
    for _ in range(8000):
        state, up = altitude.step(ALTITUDE, state, z, v, -1.5, 0.005)
        v += 0.005 * (9.81 - 0.9 * 9.81 * up)
        z += 0.005 * v
    assert z == pytest.approx(-1.5, abs=1e-3)


@given(angles, st.floats(-20, 20), st.floats(-20, 20))
def test_start_is_bumpless_anywhere_and_at_any_heading(yaw: float, x: float, y: float) -> None:
    here = level(x, y, -1.0, yaw)
    state = position.engage(here, yaw, (0.5, 0.3), (0.5, 0.3))
    _, out = position.step(params(), state, here, Command(x, y, -1.0, yaw), 0.0)
    turned = rotation((out.setpoint.qw, out.setpoint.qx, out.setpoint.qy, out.setpoint.qz))
    np.testing.assert_allclose(turned, rotation((here.qw, here.qx, here.qy, here.qz)), atol=1e-9)
    assert out.setpoint.thrust == pytest.approx(0.5)


@given(angles)
def test_control_frame_turns_with_yaw(yaw: float) -> None:
    """The same motion seen from a turned heading gives the same set-point, turned."""
    c, s = math.cos(yaw), math.sin(yaw)
    plain, turned = level(), level(yaw=yaw)
    a = position.engage(plain, 0.0, (0.5, 0.3), (0.5, 0.3))
    b = position.engage(turned, yaw, (0.5, 0.3), (0.5, 0.3))
    for k in range(1, 20):
        p = (0.01 * k, -0.004 * k)
        a, out_a = position.step(params(), a, plain._replace(x_m=p[0], y_m=p[1]), Command(0.3, 0.1, -1, 0.0), 0.01)
        there = turned._replace(x_m=c * p[0] - s * p[1], y_m=s * p[0] + c * p[1])
        goal = Command(c * 0.3 - s * 0.1, s * 0.3 + c * 0.1, -1, yaw)
        b, out_b = position.step(params(), b, there, goal, 0.01)
    assert out_b.x.control == pytest.approx(out_a.x.control, abs=1e-12)
    assert out_b.y.control == pytest.approx(out_a.y.control, abs=1e-12)
    assert out_b.setpoint.thrust == pytest.approx(out_a.setpoint.thrust, abs=1e-12)


@given(st.floats(-50, 50), st.floats(-50, 50), st.floats(-50, 50))
def test_limits_hold_whatever_is_commanded(x: float, y: float, z: float) -> None:
    state = position.engage(level(), 0.0, (0.5, 0.3), (0.5, 0.3))
    _, out = position.step(params(tilt_deg=20.0), state, level(), Command(x, y, z, 0.0), 0.0)
    sp = out.setpoint
    tilt = math.acos(min(1.0, -attitude.thrust_direction(sp.qw, sp.qx, sp.qy, sp.qz)[2]))
    assert math.degrees(tilt) <= 20.0 + 1e-6
    assert 0.05 - 1e-12 <= sp.thrust <= 0.95


def test_rig_keeps_hover_thrust_and_moves_along_x_alone() -> None:
    state = position.engage(level(z=0.0), 0.0, (0.0, 0.0), (0.0, 0.0))
    _, out = position.step(params(one_axis=True), state, level(z=0.0), Command(0.35, 5.0, -3.0, 0.0), 0.0)
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

    def fly(one_axis: bool) -> list[list[float]]:
        start = level()
        state = position.engage(start, 0.0, (0.1, 0.1), (0.1, 0.1))
        seen = []
        for k in range(1, 200):
            odometry = level(0.01 * math.sin(0.1 * k), 0.02 * math.cos(0.1 * k))._replace(time_s=0.01 * k)
            state, out = position.step(params(one_axis=one_axis), state, odometry, Command(0.2, -0.1, -1.2, 0.0), 0.01)
            seen.append(flat(state) + flat(out))
        return seen

    plain = [fly(False), fly(True)]
    modules = (projection, reference_model, mrac, altitude, attitude, position)
    for module in modules:  # from the bottom up: each function finds those below it compiled
        for name, function in inspect.getmembers(module, inspect.isfunction):
            monkeypatch.setattr(module, name, getattr(inspect.getmodule(function), name))
            if function.__module__ == module.__name__:
                monkeypatch.setattr(module, name, numba.njit(function))
    np.testing.assert_allclose([fly(False), fly(True)], plain, rtol=1e-9, atol=1e-12)
    assert position.step.signatures  # type: ignore[attr-defined]  # it ran compiled
