"""Hover thrust estimated in flight: found, bounded, slewed, and taken into use without a bump."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.control import altitude, hover

G = 9.81
PARAMS = hover.HoverParams(0.5, 5.0, 0.3, 0.8, 0.05, G)
GAINS = altitude.AltitudeParams(1.5, 4.0, 2.0, 0.0, 30.0, 3.0, 1.5, G)


@settings(max_examples=20)
@given(st.floats(0.35, 0.75), st.floats(0.0, 0.4))
def test_it_finds_the_hover_thrust_whatever_is_flown(true: float, tilt: float) -> None:
    state, v, dt = hover.start(0.5, 0.0), 0.0, 0.004
    for k in range(5000):
        thrust = true / math.cos(tilt) * (1.0 + 0.3 * math.sin(0.01 * k) + (0.2 if k % 700 < 100 else 0.0))
        v += dt * G * (1.0 - thrust * math.cos(tilt) / true)
        before = state.hover_thrust
        state = hover.step(PARAMS, state, v, thrust * math.cos(tilt), dt)
        assert abs(state.hover_thrust / before - 1.0) <= 0.05 * dt * 1.0001
    assert 1.0 / state.inverse == pytest.approx(true, rel=0.02)
    assert state.hover_thrust == pytest.approx(true, rel=0.02)


@given(st.lists(st.tuples(st.floats(-1e6, 1e6), st.floats(-10.0, 10.0), st.floats(0.0, 0.5)), max_size=30))
def test_it_stays_in_its_range_and_finite_whatever_it_sees(seen: list[tuple[float, float, float]]) -> None:
    state = hover.start(0.5, 0.0)
    for velocity, lift, dt in seen:
        state = hover.step(PARAMS, state, velocity, lift, dt)
        assert all(map(math.isfinite, state))
        assert 0.3 - 1e-12 <= state.hover_thrust <= 0.8 + 1e-12


def test_free_fall_teaches_nothing() -> None:
    state = hover.start(0.5, 0.0)
    for k in range(500):
        state = hover.step(PARAMS, state, 0.004 * k * G, 0.0, 0.004)
    settled = state.inverse
    assert settled == pytest.approx(2.0, rel=0.2)  # until the low-pass has seen that there is no thrust
    for k in range(500, 1000):
        state = hover.step(PARAMS, state, 0.004 * k * G, 0.0, 0.004)
    assert state.inverse == settled


def test_the_integrator_takes_up_the_difference_and_the_thrust_does_not_step() -> None:
    """A vehicle 20 % too heavy: the thrust is the same as without the estimator's swaps, tick by tick, to the slew."""
    z, v, dt, true = -3.0, 0.0, 0.004, 0.588
    state, lift, thrust = altitude.start(z, 0.0), hover.start(0.49, 0.0), 0.49
    integrals = []
    for _ in range(5000):
        before = lift.hover_thrust
        lift = hover.step(PARAMS, lift, v, thrust, dt)
        ratio = before / lift.hover_thrust
        swapped, up = altitude.step(GAINS, state, z, v, -3.0, dt, state.up, 0.1, 1.8, ratio)
        _, kept_up = altitude.step(GAINS, state, z, v, -3.0, dt, state.up, 0.1, 1.8, 1.0)
        # the thrust is that of the old hover thrust and the old integrator, but for the small proportional part
        assert up * lift.hover_thrust == pytest.approx(kept_up * before, abs=2e-4)
        state, thrust = swapped, up * lift.hover_thrust
        integrals.append(state.integral_m_s2)
        v += dt * G * (1.0 - thrust / true)
        z += dt * v
    assert max(integrals) > 0.2  # it held some of the weight at first
    assert integrals[-1] == pytest.approx(0.0, abs=0.05)  # and was relieved of it
    assert lift.hover_thrust == pytest.approx(true, rel=0.01)
    assert z == pytest.approx(-3.0, abs=0.01)
