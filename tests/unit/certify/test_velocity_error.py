"""Q and bias rate for an estimator: the formula, the model behind the trade-off, and what is chosen for known ones."""

from __future__ import annotations

import math
from dataclasses import replace
from decimal import Decimal
from pathlib import Path

import pytest

from companion.certify.bandwidth import with_bandwidth
from companion.certify.designing.design import _for_estimator, slower
from companion.certify.designing.velocity_error import SAMPLED_SHARE, choose, displacement, ratio_s
from companion.certify.from_config import problem
from companion.certify.problem import Problem
from companion.certify.sampling.sampled import largest_adaptation_rate
from companion.config import load_config
from companion.config.estimator import PRESETS, VelocityError

PX4 = Path(__file__).resolve().parents[3] / "config" / "px4_quadrotor.yaml"


@pytest.fixture(scope="module")
def stated() -> Problem:
    return problem(load_config(PX4))


def test_displacement_by_each_metre_a_second_is_what_the_issue_measured(stated: Problem) -> None:
    axis = stated.axes["x"]
    wn, zeta = 2.3, 0.7
    assert ratio_s(axis, 1.0) == pytest.approx(1.95, abs=0.01)
    assert ratio_s(axis, 0.05) == pytest.approx(0.39, abs=0.01)
    assert ratio_s(axis, 0.3) == pytest.approx(1 / (2 * zeta * wn) + 0.3 * wn / (2 * zeta))


def test_a_lasting_velocity_error_moves_the_vehicle_by_that_ratio(stated: Problem) -> None:
    """With a bias weight by T, with none by W2/W1 = 2 zeta / wn; the deviation of a slow error is a slow deviation."""
    slow = VelocityError(0.2, 1000.0)
    axis = stated.axes["x"]
    assert displacement(axis, 1.0, 3.0, slow).velocity_error_m == pytest.approx(1.95 * 0.2, rel=0.02)
    assert displacement(axis, 0.05, 8.0, slow).velocity_error_m == pytest.approx(0.39 * 0.2, rel=0.02)
    assert displacement(axis, 1.0, 0.0, slow).velocity_error_m == pytest.approx(2 * 0.7 / 2.3 * 0.2, rel=0.02)


def test_gusts_are_taken_up_by_a_fast_bias_weight_and_an_unstable_loop_is_told(stated: Problem) -> None:
    axis, error = stated.axes["x"], VelocityError(0.1, 1.0)
    gusts = [displacement(axis, 0.1, rate, error).gusts_m for rate in (0.0, 1.0, 3.0, 10.0)]
    assert gusts == sorted(gusts, reverse=True)
    assert math.isinf(displacement(with_bandwidth(axis, Decimal(1)), 0.1, 3.0, error).rms_m)


def test_for_gps_velocity_counts_little_and_for_motion_capture_about_as_much_as_position(stated: Problem) -> None:
    gps, seen = (choose(stated.axes, stated.sampling, PRESETS[name]) for name in ("gps", "motion_capture"))
    assert gps.correct
    assert Decimal("0.05") <= gps.q2 <= Decimal("0.1")
    assert 7 <= gps.bias_adaptation_rate <= 13
    assert seen.q2 >= Decimal("0.5")
    assert gps.ratio_s < 0.6 < 1.0 < seen.ratio_s
    assert not choose(stated.axes, stated.sampling, PRESETS["optical_flow"]).correct, "nothing aids its position"


@pytest.mark.parametrize("name", sorted(PRESETS))
def test_sampling_bears_what_is_chosen_with_a_share_in_hand(name: str, stated: Problem) -> None:
    chosen = choose(stated.axes, stated.sampling, PRESETS[name])
    for axis, sampled in stated.sampling.items():
        regressor = float(sampled.position_m) ** 2 + float(sampled.velocity_m_s) ** 2
        with_q = replace(sampled, lyapunov_q=(Decimal(1), chosen.q2), bias_adaptation_rate=Decimal(0))
        bears = largest_adaptation_rate(stated.axes[axis], with_q) * regressor
        strength = float(chosen.adaptation_rate) * regressor + float(chosen.bias_adaptation_rate)
        assert strength <= SAMPLED_SHARE * bears


def test_the_fastest_reference_model_is_not_proposed_where_the_noise_makes_it_worse(stated: Problem) -> None:
    slowed = {name: slower(axis, Decimal("0.1")) for name, axis in stated.axes.items()}
    certified = Decimal("2.4")
    frequency, at_gps = _for_estimator(slowed, stated.sampling, certified, PRESETS["gps"])
    assert frequency == certified
    shaking = VelocityError(0.3, 0.1, position_aided=False)
    frequency, shaken = _for_estimator(slowed, stated.sampling, certified, shaking)
    assert frequency < Decimal("2.2")
    assert shaken.ratio_s > at_gps.ratio_s, "a slow error is integrated, a fast one shakes a fast loop"
