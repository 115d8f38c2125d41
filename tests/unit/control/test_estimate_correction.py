"""A consistent estimate is left alone; the recorded errors of a real one become a third."""

import math
from pathlib import Path

import numpy as np
import pytest

from companion.control.estimate_correction import CorrectionParams, reseat, start, step
from companion.control.types import Jump, Odometry

PX4 = CorrectionParams(0.3, 0.75, 1.0, 0.6)
RECORDED = np.load(Path(__file__).resolve().parents[2] / "data" / "px4_sih_estimator_errors.npz")["errors"]


def sample(time_s: float, x: float, vx: float, y: float = 0.0, vy: float = 0.0) -> Odometry:
    return Odometry(time_s, x, y, -2.0, vx, vy, 0.0, 1.0, 0.0, 0.0, 0.0)


def test_an_estimate_that_agrees_with_itself_is_left_alone() -> None:
    dt = 0.004
    state = start(sample(0.0, 1.0, 0.5))
    for k in range(1, 3000):
        t = k * dt
        said = sample(t, 1.0 + math.sin(t) * 0.5, 0.5 * math.cos(t))
        state, corrected = step(PX4, state, said, dt)
    assert corrected.x_m == pytest.approx(said.x_m, abs=3e-3)  # the low pass holds the velocity over a step
    assert corrected.vx_m_s == pytest.approx(said.vx_m_s, abs=5e-3)
    assert corrected[3:4] == said[3:4]
    assert corrected[6:] == said[6:]


def test_the_errors_of_a_real_estimator_become_a_third() -> None:
    before: list[float] = []
    after: list[float] = []
    for recorded in RECORDED.astype(float):
        flight = recorded - recorded.mean(axis=0)
        state = start(sample(0.0, flight[0, 0], flight[0, 3], flight[0, 1], flight[0, 4]))
        for k, (x, y, _, vx, vy, _) in enumerate(flight):
            state, corrected = step(PX4, state, sample(0.1 * k, x, vx, y, vy), 0.1)
            if k > 50:
                before += [x, y]
                after += [corrected.x_m, corrected.y_m]
    assert np.std(before) > 0.15
    assert np.std(after) < 0.4 * np.std(before)


def test_a_velocity_that_the_position_does_not_have_is_taken_off() -> None:
    state = start(sample(0.0, 0.0, 0.4))
    for k in range(1, 1000):
        state, corrected = step(PX4, state, sample(0.004 * k, 0.0, 0.4), 0.004)
    assert corrected.vx_m_s == pytest.approx(0.0, abs=1e-6)
    assert corrected.x_m == pytest.approx(-0.3, abs=1e-5)


def test_a_jump_of_the_estimate_is_no_disagreement() -> None:
    state = start(sample(0.0, 0.0, 0.0))
    jump = Jump(1.5, -0.5, 0.0, 0.0, 0.0, 0.0, 0.0)
    state, seen = reseat(PX4, state, jump)
    _, corrected = step(PX4, state, sample(0.004, 1.5, 0.0, -0.5), 0.004)
    assert seen == jump
    assert corrected.x_m == pytest.approx(1.5)
    assert corrected.y_m == pytest.approx(-0.5)


def test_a_reset_of_velocity_does_what_it_is_said_to_do() -> None:
    """The position goes on as before, so does the corrected velocity; and what it does is told, so that none steps."""
    state = start(sample(0.0, 0.0, 0.0))
    state, seen = reseat(PX4, state, Jump(0.1, 0.0, 0.0, 0.4, -0.3, 0.0, 0.0))
    _, corrected = step(PX4, state, sample(0.001, 0.1, 0.4, 0.0, -0.3), 0.001)
    assert (corrected.vx_m_s, corrected.vy_m_s) == pytest.approx((seen.vx_m_s, seen.vy_m_s), abs=1e-6)
    assert (corrected.x_m, corrected.y_m) == pytest.approx((seen.x_m, seen.y_m), abs=1e-6)
    assert seen.vx_m_s == 0.0


def test_gains_of_zero_change_nothing() -> None:
    said = sample(0.1, 1.0, 9.0, -2.0, 3.0)
    _, corrected = step(CorrectionParams(0.3, 0.0, 0.0, 0.6), start(sample(0.0, 0.0, 0.0)), said, 0.1)
    assert corrected == said


def test_a_jump_that_nobody_counts_is_believed_no_further_than_the_limit() -> None:
    state = start(sample(0.0, 0.0, 0.0))
    for k in range(1, 500):
        state, corrected = step(PX4, state, sample(0.004 * k, 5.0, 0.0), 0.004)
        assert abs(corrected.x_m - 5.0) <= 0.75 * 0.6 + 1e-9
        assert abs(corrected.vx_m_s) <= 0.6 + 1e-9
    assert corrected.x_m == pytest.approx(5.0, abs=0.01)
