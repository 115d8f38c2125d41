"""The bias weight in the check of the sampled adaptation, in the statement, and in what older certificates say."""

from collections.abc import Callable
from dataclasses import replace
from decimal import Decimal

import numpy as np
import pytest

from companion.certify import proof
from companion.certify.certificate import certify
from companion.certify.problem import AxisProblem, Problem, Sampling
from companion.certify.sampling.sampled import error_dynamics, largest_adaptation_rate
from companion.certify.statement import digest, problem_of, statement

ENVELOPE_SQUARED = 0.4**2 + 0.5**2


def test_the_bias_rate_counts_as_strength(quadrotor: Problem, sampling: Sampling) -> None:
    axis = quadrotor.axes["x"]
    plain = largest_adaptation_rate(axis, sampling)
    with_bias = largest_adaptation_rate(axis, replace(sampling, bias_adaptation_rate=Decimal(10)))
    assert with_bias == pytest.approx(plain - 10 / ENVELOPE_SQUARED)
    assert largest_adaptation_rate(axis, replace(sampling, bias_adaptation_rate=Decimal(100_000))) < 0


def test_at_the_limit_the_five_states_of_an_axis_with_bias_lose_stability(
    quadrotor: Problem, sampling: Sampling
) -> None:
    """The whole error dynamics [e, three weights] for the largest regressor, discretised without the shortcut to s."""
    axis = quadrotor.axes["x"]
    biased = replace(sampling, bias_adaptation_rate=Decimal(50))
    limit = largest_adaptation_rate(axis, biased)
    model = error_dynamics(axis, biased)
    x = np.array([0.4, 0.5, 1.0])

    def radius(gamma: float) -> float:
        gains = np.array([gamma, gamma, 50.0]) * x
        learns = np.outer(gains, model.gain)  # (3, 2): what a tick adds to the weights
        m = np.block([[np.array(model.transition), -np.outer(model.input, x)], [learns, np.eye(3)]])
        updated = m.copy()
        updated[:2, :2] -= np.outer(model.input, x) @ learns
        # Two directions of the weights are not seen by this regressor and stay where they are: eigenvalue one.
        return max(float(abs(np.linalg.eigvals(matrix)).max()) for matrix in (m, updated))

    assert radius(0.99 * limit) <= 1.0 + 1e-9
    assert radius(1.02 * limit) > 1.0 + 1e-5


def test_statement_of_a_bias_comes_back_and_is_silent_without_one(quadrotor: Problem, sampling: Sampling) -> None:
    biased = replace(
        quadrotor, sampling=dict.fromkeys(quadrotor.axes, replace(sampling, bias_adaptation_rate=Decimal(3)))
    )
    assert problem_of(statement(biased)) == biased
    assert digest(statement(biased)) != digest(statement(quadrotor))
    assert "bias_adaptation_rate" not in str(statement(quadrotor))  # as certificates from before the bias have it
    stated = statement(biased)
    stated["sampling"]["x"]["bias_adaptation_rate"] = "0"  # type: ignore[index, call-overload]
    with pytest.raises(ValueError, match="not stated where it is zero"):
        problem_of(stated)


def test_verification_refuses_a_bias_rate_that_leaves_too_little(
    rig: Callable[..., AxisProblem], sampling: Sampling
) -> None:
    axis = rig()
    limit = largest_adaptation_rate(axis, sampling)
    room = (limit - float(sampling.adaptation_rate)) * ENVELOPE_SQUARED  # for the bias
    for share, ok in ((0.9, True), (1.1, False)):
        rate = Decimal(str(round(share * room, 2)))
        problem = Problem({"x": axis}, False, {"x": replace(sampling, bias_adaptation_rate=rate)})
        certificate = certify(problem)
        assert certificate is not None
        verdict = proof.verify(certificate, statement(problem))
        assert verdict.ok is ok, verdict.reason
        assert ok or "adaptation rate" in verdict.reason


def test_a_negative_bias_rate_is_refused(sampling: Sampling) -> None:
    with pytest.raises(ValueError, match="bias_adaptation_rate must not be negative"):
        replace(sampling, bias_adaptation_rate=Decimal(-1))
