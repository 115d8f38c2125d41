"""(19)-(20): the reference model is discretised exactly, for every damping ratio."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm

from companion.control.reference_model import Transition, transition

frequencies = st.floats(0.1, 20.0)
dampings = st.one_of(st.floats(0.05, 3.0), st.just(1.0))
steps = st.floats(1e-4, 0.5)


def propagate(over: Transition, position: float, velocity: float, acceleration: float) -> tuple[float, float]:
    return (
        over.phi11 * position + over.phi12 * velocity + over.gamma1 * acceleration,
        over.phi21 * position + over.phi22 * velocity + over.gamma2 * acceleration,
    )


def exact(omega: float, zeta: float, dt: float) -> np.ndarray:
    """exp of the augmented matrix [A_r, B; 0, 0]: its upper rows are [Φ, Γ]."""
    a = np.zeros((3, 3))
    a[:2, :2] = [[0.0, 1.0], [-(omega**2), -2.0 * zeta * omega]]
    a[1, 2] = 1.0
    return expm(a * dt)[:2]


@given(frequencies, dampings, steps)
def test_transition_is_the_matrix_exponential(omega: float, zeta: float, dt: float) -> None:
    over = transition(omega, zeta, dt)
    ours = np.array([[over.phi11, over.phi12, over.gamma1], [over.phi21, over.phi22, over.gamma2]])
    np.testing.assert_allclose(ours, exact(omega, zeta, dt), rtol=1e-6, atol=1e-9)


@given(frequencies, dampings, st.floats(1e-3, 0.2))
def test_two_half_steps_make_a_whole_one(omega: float, zeta: float, dt: float) -> None:
    half, whole = transition(omega, zeta, dt / 2), transition(omega, zeta, dt)
    twice = propagate(half, *propagate(half, 0.3, -0.2, 1.5), 1.5)
    assert twice == pytest.approx(propagate(whole, 0.3, -0.2, 1.5), rel=1e-7, abs=1e-9)


def test_no_time_changes_nothing() -> None:
    assert propagate(transition(4.0, 0.7, 0.0), 0.1, -0.2, 9.0) == (0.1, -0.2)


def test_step_settles_on_the_command_with_the_overshoot_of_its_damping() -> None:
    omega, zeta, dt = 4.0, 0.7, 0.01
    over, x, v, top = transition(omega, zeta, dt), 0.0, 0.0, 0.0
    for _ in range(1000):
        x, v = propagate(over, x, v, omega**2 * 1.0)
        top = max(top, x)
    assert x == pytest.approx(1.0, abs=1e-9)
    assert top - 1.0 == pytest.approx(math.exp(-math.pi * zeta / math.sqrt(1 - zeta**2)), abs=1e-4)
