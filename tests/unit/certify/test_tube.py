"""The tube around a trajectory: what is proven is above what a search finds, and a false proof is refused."""

from __future__ import annotations

from dataclasses import replace
from decimal import Decimal
from fractions import Fraction

import numpy as np
import pytest

from companion.attitude_response.exact import NO_DELAY, Interval, interval
from companion.attitude_response.kinds import SecondOrder
from companion.attitude_response.response import AttitudeResponse
from companion.certify.problem import AxisProblem
from companion.certify.tube.feed_forward import STEP_S, Asked, left_over
from companion.certify.tube.loop import Bias, moving_channel
from companion.certify.tube.tube import tube
from companion.certify.tube.tube_proof import TubeProof, check_tube
from companion.certify.tube.tube_search import search
from companion.certify.tube.worst_case import held_growth, worst_case

BIAS = Bias(Fraction(3), Fraction(3, 10), (Fraction(1), Fraction(1)))


def axis(
    frequency: Interval | None = None, delay: Interval = NO_DELAY, lower: tuple[str, str] = ("0.32", "0.195")
) -> AxisProblem:
    """The shipped quadrotor's, with less of its response's interval."""
    response = AttitudeResponse(SecondOrder(frequency or interval(10.2), interval(Decimal("0.9"))), delay)
    upper = (Decimal("0.593"), Decimal("0.361"))
    return AxisProblem(Decimal("2.3"), Decimal("0.7"), (Decimal(lower[0]), Decimal(lower[1])), upper, response)


@pytest.fixture(scope="module")
def proven() -> tuple[TubeProof, AxisProblem]:
    problem = axis(interval(10, Decimal("10.2")))
    found = search(moving_channel(problem, None), 8, 2.3)
    assert found is not None
    return found[0], problem


def test_the_bound_is_above_the_search_and_within_the_factor(proven: tuple[TubeProof, AxisProblem]) -> None:
    proof, problem = proven
    searched = float(worst_case(moving_channel(problem, None, hull=False), rounds=15).max())
    assert searched < proof.gain < 1.6 * searched


def test_a_proof_holds_of_its_own_loop_alone(proven: tuple[TubeProof, AxisProblem]) -> None:
    proof, problem = proven
    assert check_tube(proof, moving_channel(problem, None)) == ""
    wider = replace(problem, weights_lower=(Decimal("0.1"), Decimal("0.05")))
    assert "does not fall" in check_tube(proof, moving_channel(wider, None))


def test_a_proof_that_was_touched_is_refused(proven: tuple[TubeProof, AxisProblem]) -> None:
    proof, problem = proven
    channel = moving_channel(problem, None)
    assert check_tube(proof._replace(squared_gain=proof.squared_gain * Fraction(9, 10)), channel)
    assert check_tube(proof._replace(squared_gain=-proof.squared_gain), channel)
    assert check_tube(proof._replace(rates=(-proof.rates[0], *proof.rates[1:])), channel)
    assert check_tube(proof._replace(rates=proof.rates[1:]), channel)
    assert check_tube(proof._replace(sign_multipliers=(Fraction(-1), *proof.sign_multipliers[1:])), channel)
    assert check_tube(proof._replace(lyapunov=tuple(x / 2 for x in proof.lyapunov)), channel)
    assert check_tube(proof._replace(state=1), channel)
    stretched = proof.scale._replace(states=(Fraction(2), *proof.scale.states[1:]))
    assert check_tube(proof._replace(scale=stretched), channel)


def test_one_held_loop_comes_to_its_l1_norm() -> None:
    """Of a loop that does not switch the worst is the integral of the impulse response's magnitude."""
    channel = moving_channel(axis(lower=("0.53", "0.32")), None, hull=False)
    loop = channel.corners[0][0]
    a, e, c, d = (np.array(part, dtype=float) for part in (loop.a, loop.e, loop.c, loop.d))
    a = a + e @ c
    values, vectors = np.linalg.eig(a)
    times = np.arange(0.0, 20.0, 1e-3)
    modes = np.exp(np.outer(times, values)) * np.linalg.solve(vectors, d[:, 0])
    norm = 1e-3 * float(np.abs((modes @ vectors[0]).real).sum())
    assert float(worst_case(channel, weights=(0,)).max()) == pytest.approx(norm, rel=0.02)


def test_a_delay_is_counted() -> None:
    problem = axis(delay=interval(Decimal("0.02"), Decimal("0.025")))
    found = search(moving_channel(problem, None), 8, 2.3)
    assert found is not None
    searched = float(worst_case(moving_channel(problem, None, hull=False), rounds=10).max())
    assert searched < found[0].gain < 1.6 * searched
    later = replace(problem, response=replace(problem.response, delay_s=interval(Decimal("0.02"), Decimal("0.3"))))
    assert check_tube(found[0], moving_channel(later, None))


def test_the_bias_weight_takes_up_most() -> None:
    problem = axis()
    channel = moving_channel(problem, BIAS)
    found = search(channel, 8, 2.3)
    assert found is not None
    searched = float(worst_case(moving_channel(problem, BIAS, hull=False), rounds=10).max())
    assert searched < found[0].gain < 1.6 * searched
    without = float(worst_case(moving_channel(problem, None, hull=False), rounds=10).max())
    assert found[0].gain < 0.7 * without


@pytest.mark.slow
def test_the_bias_weight_is_bounded_too() -> None:
    channel = moving_channel(axis(), BIAS)
    found = search(channel, 8, 2.3, state=6)
    assert found is not None
    assert check_tube(found[0], channel) == ""
    assert found[0].gain > 1 / 9.81  # a steady disturbance is taken up, all of it


def test_a_loop_that_grows_in_a_corner_says_so() -> None:
    fast = Bias(Fraction(14), Fraction(3, 10), (Fraction(1), Fraction(3, 100)), Fraction(23, 100))
    assert held_growth(moving_channel(axis(), fast, hull=False)) > 0.0
    found = tube(axis(), fast)
    assert found.proof["weights"].startswith("not proven: with weights that stand in a corner")
    assert not found.proofs
    assert found.m_per_m_s2 > 0.0


def test_what_the_feed_forward_leaves_is_less_with_a_lead() -> None:
    times = np.arange(0.0, 10.0, STEP_S)
    ramp = np.minimum(times, 1.0)
    asked = ramp * np.sin(2.0 * times)
    lag = 2 * 0.9 / 10.2
    led = asked + lag * np.gradient(asked, STEP_S)
    plain = left_over(axis(), [Asked(float(a), float(a)) for a in asked])
    assert left_over(axis(), [Asked(float(a), float(f)) for a, f in zip(asked, led, strict=True)]) < 0.3 * plain
    assert left_over(axis(), [Asked(0.0, 0.0)] * 100) == 0.0
