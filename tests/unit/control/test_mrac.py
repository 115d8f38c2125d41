"""(15), (17)-(23): Lyapunov equation, projection, control law, and what hedging is for."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import solve_continuous_lyapunov

from companion.control import mrac
from companion.control.projection import adapt
from companion.control.reference_model import transition

G = 9.81


def axis(
    *,
    hedging: bool,
    gamma: float = 100.0,
    omega: float = 2.3,
    zeta: float = 0.7,
    bounds: tuple[float, float] = (0.55, 0.35),
) -> mrac.AxisParams:
    _, p12, p22 = mrac.solve_lyapunov(omega, zeta, 1.0, 1.0)
    return mrac.AxisParams(omega, zeta, G, gamma, p12, p22, -bounds[0], bounds[0], -bounds[1], bounds[1], hedging)


def step(
    params: mrac.AxisParams, state: mrac.AxisState, *inputs: float, shift: float = 0.0
) -> tuple[mrac.AxisState, mrac.AxisOutput]:
    """One tick; `inputs` are position, velocity, actuator, command and dt."""
    over = transition(params.natural_frequency_rad_s, params.damping_ratio, inputs[-1])
    return mrac.step(params, state, over, shift, *inputs)


@given(st.floats(0.2, 10.0), st.floats(0.1, 2.0), st.floats(0.01, 10.0), st.floats(0.01, 10.0))
def test_lyapunov_equation_23(omega: float, zeta: float, q1: float, q2: float) -> None:
    p11, p12, p22 = mrac.solve_lyapunov(omega, zeta, q1, q2)
    a = np.array([[0.0, 1.0], [-(omega**2), -2 * zeta * omega]])
    p = np.array([[p11, p12], [p12, p22]])
    np.testing.assert_allclose(a.T @ p + p @ a, -np.diag([q1, q2]), atol=1e-9 * (1 + abs(p).max()) * omega**2)
    np.testing.assert_allclose(p, solve_continuous_lyapunov(a.T, -np.diag([q1, q2])), rtol=1e-6)
    assert np.all(np.linalg.eigvalsh(p) > 0)


@given(st.floats(-2, 2), st.floats(-1e4, 1e4), st.floats(-2, 0.0), st.floats(0.01, 2), st.floats(1e-4, 0.1))
def test_projection_22_keeps_the_box_and_asymmetric_bounds(
    value: float, rate: float, lower: float, upper: float, dt: float
) -> None:
    start = min(max(value, lower), upper)
    after = adapt(start, rate, lower, upper, dt)
    assert lower <= after <= upper
    if lower < start + dt * rate < upper:
        assert after == start + dt * rate
    if (start == upper and rate > 0) or (start == lower and rate < 0):
        assert after == start


@given(st.floats(-1, 1), st.floats(-10, 10), st.floats(-1, 1), st.floats(1e-3, 1.0))
def test_projection_never_hurts_the_lyapunov_function(value: float, rate: float, true: float, dt: float) -> None:
    """For every W in the box the projected step ends no farther from W: what makes projection harmless in the proof."""
    assert abs(adapt(value, rate, -1.0, 1.0, dt) - true) <= abs(value + dt * rate - true) + 1e-12


def test_control_law_21_and_matching_condition() -> None:
    """With the nominal weights and an ideal actuator the plant is the reference model: A - B Wᵀ = A_r, B K_r = B_r."""
    params = axis(hedging=False, gamma=0.0)
    state = mrac.start(0.2, -0.1, *mrac.nominal_weights(params), 0.0)
    _, out = step(params, state, 0.2, -0.1, 0.0, 0.5, 0.0)
    wanted = params.natural_frequency_rad_s**2 * (0.5 - 0.2) - 2 * 0.7 * params.natural_frequency_rad_s * -0.1
    assert G * out.control == pytest.approx(wanted, rel=1e-12)


def test_adaptation_22_is_gamma_x_e_pb() -> None:
    params = axis(hedging=False)
    state = mrac.start(0.1, 0.05, 0.0, 0.0, 0.0)
    x, dt = (0.11, 0.07), 0.01
    after, out = step(params, state, *x, 0.0, 0.1, dt)
    over, input_ = transition(2.3, 0.7, dt), 2.3**2 * 0.1
    ref = (
        over.phi11 * 0.1 + over.phi12 * 0.05 + over.gamma1 * input_,
        over.phi21 * 0.1 + over.phi22 * 0.05 + over.gamma2 * input_,
    )
    e = (x[0] - ref[0], x[1] - ref[1])
    assert (out.error_position_m, out.error_velocity_m_s) == pytest.approx(e)
    epb = G * (params.lyapunov_12 * e[0] + params.lyapunov_22 * e[1])
    assert after.position_weight == pytest.approx(dt * 100.0 * x[0] * epb)
    assert after.velocity_weight == pytest.approx(dt * 100.0 * x[1] * epb)


def fly(
    params: mrac.AxisParams,
    bandwidth: float,
    dt: float = 1e-3,
    seconds: float = 6.0,
    weights: tuple[float, float] = (0.2, 0.1),
) -> np.ndarray:
    """Exact double integrator behind a first-order actuator; the hedged system error over time."""
    p, v, w = 0.0, 0.0, 0.0
    state, errors = mrac.start(p, v, *weights, w), []
    for k in range(int(seconds / dt)):
        state, out = step(params, state, p, v, w, 0.3 if k else 0.0, dt if k else 0.0)
        errors.append((out.error_position_m, out.error_velocity_m_s))
        for _ in range(10):
            h = dt / 10
            decay = math.exp(-bandwidth * h)
            mean = out.control + (w - out.control) * (1 - decay) / (bandwidth * h)
            w = out.control + (w - out.control) * decay
            p, v = p + h * v + 0.5 * h * h * G * mean, v + h * G * mean
    return np.array(errors)


def test_hedged_error_dynamics_do_not_see_the_actuator() -> None:
    """(20): with the weights right and still, e stays zero whatever the actuator does; unhedged it does not."""
    hedged = axis(hedging=True, gamma=0.0)
    standard = axis(hedging=False, gamma=0.0)
    nominal = mrac.nominal_weights(hedged)
    for bandwidth in (3.0, 6.0, 30.0):
        errors = [np.abs(fly(hedged, bandwidth, dt, weights=nominal)).max() for dt in (2e-3, 1e-3)]
        assert errors[1] < 6e-4
        assert errors[1] == pytest.approx(0.5 * errors[0], rel=0.1)  # what is left is the sampling of u, of order dt
    assert np.abs(fly(standard, 3.0, weights=nominal)).max() > 0.05


def test_hedging_off_follows_the_ideal_reference() -> None:
    params = axis(hedging=False)
    state = mrac.start(0.0, 0.0, 0.0, 0.0, 0.0)
    for _ in range(50):
        state, _ = step(params, state, 0.01, 0.0, 0.3, 0.2, 0.01)
    assert (state.reference_position_m, state.reference_velocity_m_s) == (
        state.ideal_position_m, state.ideal_velocity_m_s,
    )  # fmt: skip


def test_deficit_is_actuator_minus_command() -> None:
    params = axis(hedging=True)
    state = mrac.start(0.0, 0.0, 0.0, 0.0, 0.1)._replace(control=0.3)
    _, out = step(params, state, 0.0, 0.0, 0.2, 0.0, 0.01)
    assert out.deficit == pytest.approx(0.5 * (0.1 + 0.2) - 0.3)


def test_bias_weight_has_its_own_rate_and_bound_and_comes_off_the_command() -> None:
    plain = axis(hedging=False)
    params = plain._replace(bias_adaptation_rate=2.0, bias_bound=0.01)
    state = mrac.start(0.1, 0.05, 0.5, 0.3, 0.0)
    without, out_without = step(plain, state, 0.11, 0.07, 0.0, 0.1, 0.01)
    after, out = step(params, state, 0.11, 0.07, 0.0, 0.1, 0.01)
    e = (out.error_position_m, out.error_velocity_m_s)
    epb = G * (params.lyapunov_12 * e[0] + params.lyapunov_22 * e[1])
    assert after.bias_weight == pytest.approx(0.01 * 2.0 * epb)  # (22) for the regressor 1
    assert out.control == pytest.approx(out_without.control - after.bias_weight)
    assert after._replace(bias_weight=0.0, control=0.0) == without._replace(control=0.0)  # the others do not see it
    for _ in range(100):
        after, _ = step(params, after, 0.11, 0.07, 0.0, 0.1, 0.01)
    assert after.bias_weight == 0.01


def test_bias_weight_takes_up_a_constant_force() -> None:
    """Without it a steady push of 1 m/s² moves the vehicle off by about push / ωn²; with it the error goes to zero."""

    def rest(bias_rate: float) -> float:
        params = axis(hedging=True, gamma=1.0)._replace(bias_adaptation_rate=bias_rate, bias_bound=0.3)
        p, v, w, dt = 0.0, 0.0, 0.0, 0.004
        state = mrac.start(p, v, *mrac.nominal_weights(params), w)
        for _ in range(4000):
            state, out = step(params, state, p, v, w, 0.0, dt)
            w += (1.0 - math.exp(-9.0 * dt)) * (out.control - w)
            v += dt * (G * w + 1.0)
            p += dt * v
        return p

    assert rest(0.0) > 0.1
    assert abs(rest(2.0)) < 1e-3


def test_hedge_takes_the_unsaturated_command_and_the_measured_output() -> None:
    """A saturated actuator shows as a deficit, reaches the reference, and leaves error and weights alone (4.3)."""
    params = axis(hedging=True, gamma=100.0)
    nominal = mrac.nominal_weights(params)
    p, v, w, dt = 0.0, 0.0, 0.0, 0.001
    state, worst, felt = mrac.start(p, v, *nominal, w), 0.0, 0.0
    for k in range(3000):
        state, out = step(params, state, p, v, w, 1.0 if k else 0.0, dt if k else 0.0)
        assert state.control == out.control
        worst = max(worst, abs(out.error_position_m))
        felt = max(felt, abs(state.reference_position_m - state.ideal_position_m))
        flown = min(max(out.control, -0.1), 0.1)  # nominal would be 0.54 at first
        p, v, w = p + dt * v + 0.5 * dt * dt * G * flown, v + dt * G * flown, flown
    assert worst < 2e-3
    assert (state.position_weight, state.velocity_weight) == pytest.approx(nominal, abs=0.01)
    assert felt > 0.1


@given(st.floats(-50.0, 50.0))
def test_a_moved_anchor_changes_nothing_but_the_numbers(by: float) -> None:
    """The same motion seen from an anchor `by` farther: same errors, and with nominal weights the same command."""
    params = axis(hedging=True, gamma=0.0)
    nominal = mrac.nominal_weights(params)
    a = b = mrac.start(0.0, 0.0, *nominal, 0.0)
    for k in range(1, 40):
        p, v, w = 0.01 * math.sin(0.3 * k), 0.03 * math.cos(0.3 * k), 0.02 * math.sin(0.2 * k)
        a, out_a = step(params, a, p, v, w, 0.1, 0.01)
        moved = by if k >= 20 else 0.0
        b, out_b = step(params, b, p - moved, v, w, 0.1 - moved, 0.01, shift=by if k == 20 else 0.0)
        assert out_b == pytest.approx(out_a, abs=1e-11)
        assert b.reference_position_m + moved == pytest.approx(a.reference_position_m, abs=1e-11)
        assert b.ideal_velocity_m_s == pytest.approx(a.ideal_velocity_m_s, abs=1e-11)


def test_weights_on_a_bound_are_counted() -> None:
    params = axis(hedging=True)._replace(bias_adaptation_rate=1.0, bias_bound=0.2)
    state = mrac.start(0.0, 0.0, 0.1, 0.1, 0.0)
    assert mrac.on_bound(params, state) == 0
    assert mrac.on_bound(params, state._replace(position_weight=0.55, velocity_weight=-0.35)) == 2
    assert mrac.on_bound(params, state._replace(bias_weight=-0.2)) == 1
    assert mrac.on_bound(params._replace(bias_adaptation_rate=0.0, bias_bound=0.0), state) == 0
