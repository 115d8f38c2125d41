"""The design on the response of the recorded PX4 (MC_ROLL_P 4): fast enough, certified, and honest about its limits."""

from __future__ import annotations

import math
from dataclasses import replace
from decimal import Decimal
from pathlib import Path

import pytest

import companion.certify.designing.design as module
from companion.attitude_response.exact import interval
from companion.attitude_response.kinds import FirstOrder, SecondOrder
from companion.attitude_response.response import AttitudeResponse
from companion.certify import proof
from companion.certify.certificate import certify
from companion.certify.designing.design import SAMPLED_SHARE, Design, design, rates, slower
from companion.certify.from_config import problem
from companion.certify.problem import AxisProblem, Problem
from companion.certify.sampling.sampled import largest_adaptation_rate
from companion.certify.statement import statement
from companion.config import load_config

PX4 = Path(__file__).resolve().parents[3] / "config" / "px4_quadrotor.yaml"
MARGIN = Decimal("0.1")
ROLL = AttitudeResponse(SecondOrder(interval("9.96"), interval("0.963")), interval("0.0608"))
PITCH = AttitudeResponse(SecondOrder(interval("9.52"), interval("0.935")), interval("0.0465"))


def stated(**responses: AttitudeResponse) -> Problem:
    """The shipped template with these responses by axis; the other axes are left out."""
    template = problem(load_config(PX4))
    axes = {name: replace(template.axes[name], response=response) for name, response in responses.items()}
    return replace(template, axes=axes, sampling={name: template.sampling[name] for name in axes})


def as_designed(template: Problem, chosen: Design) -> Problem:
    """The problem of the config that is written, all axes alike."""
    lower, upper = zip(chosen.position_bound, chosen.velocity_bound, strict=True)
    model = {"natural_frequency_rad_s": chosen.natural_frequency_rad_s, "weights_lower": lower, "weights_upper": upper}
    gamma = {"adaptation_rate": chosen.adaptation_rate, "bias_adaptation_rate": chosen.bias_adaptation_rate}
    return replace(
        template,
        axes={name: replace(axis, **model) for name, axis in template.axes.items()},
        sampling={name: replace(sampled, **gamma) for name, sampled in template.sampling.items()},
    )


@pytest.fixture(scope="module")
def px4() -> tuple[Problem, Design]:
    template = stated(x=PITCH, y=ROLL)
    chosen = design(template, MARGIN, (0,))
    assert chosen is not None
    return template, chosen


def test_the_recorded_px4_bears_2_4_rad_s_and_the_result_is_certified(px4: tuple[Problem, Design]) -> None:
    template, chosen = px4
    assert Decimal("2.4") <= chosen.natural_frequency_rad_s <= min(chosen.fastest_rad_s.values())
    assert chosen.natural_frequency_rad_s.as_tuple().exponent == -2
    designed = as_designed(template, chosen)
    for found in (designed, replace(designed, axes={n: slower(a, MARGIN) for n, a in designed.axes.items()})):
        certificate = certify(found, 2)  # as it is, and with the margin taken away
        assert certificate is not None
        verdict = proof.verify(certificate, statement(found))
        assert verdict.ok, verdict.reason


def test_bounds_keep_the_templates_proportion_to_the_nominal_weights(px4: tuple[Problem, Design]) -> None:
    template, chosen = px4
    axis = template.axes["x"]
    growth = float(chosen.natural_frequency_rad_s / axis.natural_frequency_rad_s)
    assert [float(end) for end in chosen.position_bound] == pytest.approx(
        [growth**2 * float(bounds[0]) for bounds in (axis.weights_lower, axis.weights_upper)], abs=1e-3
    )
    assert [float(end) for end in chosen.velocity_bound] == pytest.approx(
        [growth * float(bounds[1]) for bounds in (axis.weights_lower, axis.weights_upper)], abs=1e-3
    )


def test_it_says_which_axis_decides_and_what_limits_it(px4: tuple[Problem, Design]) -> None:
    _, chosen = px4
    assert set(chosen.fastest_rad_s) == {"x", "y"}
    assert chosen.slowest == "y", "roll has the longer delay"
    assert chosen.fastest_rad_s["y"] < chosen.fastest_rad_s["x"]
    assert chosen.limited_by in {"attitude bandwidth", "delay"}
    assert not chosen.sampled
    assert chosen.adaptation is None, "nothing is known of the estimator"
    assert (chosen.adaptation_rate, chosen.bias_adaptation_rate) == (Decimal(1), Decimal("9.9")), "the template's"
    assert Decimal("0.02") < chosen.cost_of_10_ms_rad_s < Decimal("0.3")


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without asking what limits it, which costs three times as much as the answer."""
    monkeypatch.setattr(module, "_limit", lambda _axis: "not asked")
    monkeypatch.setattr(module, "_with_10_ms_more", lambda _axis, _counts: Decimal(0))


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize(
    ("response", "margin"),
    [(ROLL, Decimal("0.3")), (replace(ROLL, delay_s=interval("0.0808")), MARGIN)],
    ids=["more margin", "longer delay"],
)
def test_more_margin_or_a_longer_delay_is_slower(
    response: AttitudeResponse, margin: Decimal, px4: tuple[Problem, Design]
) -> None:
    chosen = design(stated(y=response), margin, (0,))
    assert chosen is not None
    assert 1 < chosen.natural_frequency_rad_s < px4[1].natural_frequency_rad_s - Decimal("0.1")


def axis(bandwidth: str, delay: str) -> AxisProblem:
    return stated(x=AttitudeResponse(FirstOrder(interval(bandwidth)), interval(delay))).axes["x"]


def test_what_limits_it_is_the_delay_where_the_delay_is_long() -> None:
    assert module._limit(axis("6.6", "0.12")) == "delay"
    assert module._limit(axis("6.6", "0")) == "attitude bandwidth"


def test_slower_is_slower_and_later() -> None:
    response = slower(stated(y=ROLL).axes["y"], Decimal("0.25")).response
    assert isinstance(response.dynamics, SecondOrder)
    assert float(response.dynamics.natural_frequency_rad_s.lower) == pytest.approx(9.96 / 1.25)
    assert response.dynamics.damping_ratio == interval("0.963")
    assert response.delay_s == interval("0.076")


@pytest.mark.usefixtures("quick")
def test_without_a_reference_model_to_certify_there_is_no_design() -> None:
    assert design(stated(y=AttitudeResponse(FirstOrder(interval("0.01")))), MARGIN, (0,)) is None


# -- sampling --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("gamma", "bias"), [("20", "3"), ("1", "300"), ("40", "0")])
def test_rates_beyond_sampling_come_down_alike(gamma: str, bias: str) -> None:
    template = stated(x=PITCH, y=ROLL)
    asked = {
        name: replace(sampled, adaptation_rate=Decimal(gamma), bias_adaptation_rate=Decimal(bias))
        for name, sampled in template.sampling.items()
    }
    found_gamma, found_bias, lowered = rates(template.axes, asked)
    assert lowered
    assert 0 < found_gamma < Decimal(gamma)
    assert float(found_bias) == pytest.approx(float(bias) * float(found_gamma) / float(gamma), rel=0.1)
    for name, sampled in asked.items():
        flown = replace(sampled, adaptation_rate=found_gamma, bias_adaptation_rate=found_bias)
        assert float(found_gamma) < largest_adaptation_rate(template.axes[name], flown)
        regressor = float(sampled.position_m) ** 2 + float(sampled.velocity_m_s) ** 2
        bearable = regressor * largest_adaptation_rate(
            template.axes[name], replace(sampled, bias_adaptation_rate=Decimal(0))
        )
        strength = float(found_gamma) * regressor + float(found_bias)
        assert 0.85 * SAMPLED_SHARE < strength / bearable <= SAMPLED_SHARE


def test_rates_are_for_the_first_axis_on_all_of_them() -> None:
    """The other axis is given the first one's rates, so that its own in the template say nothing."""
    template = stated(x=PITCH, y=ROLL)
    other = replace(template.sampling["y"], adaptation_rate=Decimal("0.01"), position_m=Decimal(15))
    found, bias, lowered = rates(template.axes, {**template.sampling, "y": other})
    assert lowered
    assert float(found) < largest_adaptation_rate(template.axes["y"], replace(other, bias_adaptation_rate=bias))


def test_a_slower_tick_bears_less() -> None:
    template = stated(x=PITCH)
    slow = {"x": replace(template.sampling["x"], tick_rate_hz=Decimal(20))}
    gamma, _, lowered = rates(template.axes, slow)
    assert lowered
    assert gamma < template.sampling["x"].adaptation_rate
    assert math.isfinite(gamma)
