"""Sectors and the true delay: how far they reach, and that the exact check refuses everything else."""

import dataclasses
import time
from fractions import Fraction

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings

from companion.attitude_response.exact import interval
from companion.attitude_response.kinds import SecondOrder
from companion.attitude_response.response import AttitudeResponse
from companion.attitude_response.transfer_function import TransferFunction
from companion.certify.closed_loop import axis_channel, joint_channel
from companion.certify.piecewise.inequalities import Forms
from companion.certify.piecewise.sector_proof import check_sectors, sector_proof_json, sector_proof_of
from companion.certify.piecewise.sector_search import (
    Believed,
    natural_scale,
    plan,
    prove_by_sectors,
    rays,
    rounded,
)
from companion.certify.piecewise.sector_solver import solve
from companion.certify.piecewise.sectors import Scale, sectors
from companion.certify.problem import Problem

RIG, SIMULATION = 2.3, 4.0
PROVEN_UNSTABLE = {"rig": "2.53", "simulation": "5.02"}


@pytest.mark.parametrize(
    ("count", "rig_needs", "simulation_needs"),
    [(0, "2.9045", "5.6980"), (8, "2.62", "5.15"), (16, "2.566", "5.10"), (32, "2.546", "5.055")],
)
def test_needed_bandwidth_without_delay(count, rig_needs, simulation_needs, rig, simulation):
    for axis, needs, frequency in ((rig, rig_needs, RIG), (simulation, simulation_needs, SIMULATION)):
        channel = axis_channel(axis(needs))
        proof = prove_by_sectors(channel, count, frequency)
        assert proof is not None
        assert check_sectors(proof, channel) == ""


@pytest.mark.parametrize(
    ("delay", "count", "rig_needs", "simulation_needs"),
    [("0.02", 8, "2.89", "6.25"), ("0.02", 16, "2.85", "6.18"), ("0.05", 8, "3.44", None), ("0.05", 16, "3.39", None)],
)
def test_needed_bandwidth_with_the_true_delay(delay, count, rig_needs, simulation_needs, rig, simulation):
    for axis, needs, frequency in ((rig, rig_needs, RIG), (simulation, simulation_needs, SIMULATION)):
        if needs is None:
            continue
        channel = axis_channel(axis(needs, delay))
        proof = prove_by_sectors(channel, count, frequency)
        assert proof is not None
        begun = time.process_time()
        assert check_sectors(proof, channel) == ""
        assert time.process_time() - begun < 1.0


@pytest.mark.parametrize(("bandwidth", "delay"), [("3", "0.029")])
def test_largest_delay_of_the_rig(bandwidth, delay, rig):
    assert prove_by_sectors(axis_channel(rig(bandwidth, delay)), 16, RIG) is not None


@pytest.mark.parametrize(("bandwidth", "delay"), [("5.5", "0.0084"), ("9", "0.05")])
def test_largest_delay_of_the_simulation(bandwidth, delay, simulation):
    assert prove_by_sectors(axis_channel(simulation(bandwidth, delay)), 16, SIMULATION) is not None


@pytest.mark.parametrize("count", [0, 8, 32])
def test_what_a_counterexample_refutes_is_not_proven(count, rig, simulation):
    assert prove_by_sectors(axis_channel(rig(PROVEN_UNSTABLE["rig"])), count, RIG) is None
    assert prove_by_sectors(axis_channel(simulation(PROVEN_UNSTABLE["simulation"])), count, SIMULATION) is None


def test_a_believed_candidate_of_an_unstable_loop_is_refused(rig):
    channel = axis_channel(rig("2.53"))
    wanted = plan(channel, 8, natural_scale(channel, RIG))
    forms = Forms(wanted)
    candidate = solve(wanted, forms, range(len(wanted.inequalities)))
    assert candidate is not None
    margins, signs = forms.margins(candidate.unknowns)
    assert margins.min() < 0
    for bits in (12, 20, 40):
        believed = Believed(wanted, candidate.unknowns, signs, 1.0)
        assert check_sectors(rounded(believed, bits), channel) != ""


def test_a_long_delay_is_refused_that_a_pade_approximant_would_pass(rig):
    """Bandwidth 60, 0.32 s, bounds close to nominal: the approximant of order one is stable, the true loop grows."""
    axis = dataclasses.replace(
        rig("60", "0.32"),
        weights_lower=(interval("0.53").lower, interval("0.32").lower),
        weights_upper=(interval("0.55").lower, interval("0.336").lower),
    )
    for count in (0, 8, 16):
        assert prove_by_sectors(axis_channel(axis), count, RIG) is None


def test_the_function_is_continuous_and_even(rig):
    channel = axis_channel(rig("2.7"))
    proof = prove_by_sectors(channel, 8, RIG)
    wanted = plan(channel, 8, proof.scale)
    entries = wanted and {place: float(value) for place, value in enumerate(proof.lyapunov)}
    from companion.certify.piecewise.sectors import pattern  # noqa: PLC0415

    places = pattern(wanted.cut)

    def value(sector, state):
        local = np.concatenate([np.linalg.solve(np.array(sector.basis, dtype=float), state[:2]), state[2:]])
        p = np.array(
            [
                [
                    s * t * entries[places[min(i, j), max(i, j)]]
                    for j, t in zip(sector.places, sector.signs, strict=True)
                ]
                for i, s in zip(sector.places, sector.signs, strict=True)
            ]
        )
        return local @ p @ local

    for k, ray in enumerate(wanted.rays):
        state = np.array([float(ray[0]), float(ray[1]), 0.37])
        before, after = wanted.cut[k - 1], wanted.cut[k]
        assert value(before, state) == pytest.approx(value(after, state), rel=1e-12)
        assert value(after, -state) == pytest.approx(value(after, state), rel=1e-12)
        assert value(after, state) > 0


def second_order(rig):
    response = AttitudeResponse(SecondOrder(interval("9", "10.2"), interval("0.9", "1")), interval("0.02", "0.045"))
    return dataclasses.replace(
        rig("3"),
        response=response,
        weights_lower=(interval("0.32").lower, interval("0.195").lower),
        weights_upper=(interval("0.593").lower, interval("0.361").lower),
    )


def test_intervals_of_everything_and_the_verification_is_fast(rig):
    channel = axis_channel(second_order(rig))
    proof = prove_by_sectors(channel, 8, RIG)
    assert proof is not None
    begun = time.process_time()
    assert check_sectors(proof, channel) == ""
    assert time.process_time() - begun < 1.0


def test_a_proof_covers_what_lies_inside_its_box(rig):
    axis = second_order(rig)
    proof = prove_by_sectors(axis_channel(axis), 0, RIG)
    inside = AttitudeResponse(SecondOrder(interval("9.7"), interval("0.94")), interval("0.031"))
    assert check_sectors(proof, axis_channel(dataclasses.replace(axis, response=inside))) == ""


def test_a_free_yaw_is_proven_with_a_delay_that_both_axes_share(rig):
    channel = joint_channel(rig("4", "0.02"), rig("4.1", "0.02"))
    proof = prove_by_sectors(channel, 0, RIG)
    assert proof is not None
    assert check_sectors(proof, channel) == ""
    with pytest.raises(ValueError, match="same delay"):
        Problem({"x": rig("3.4", "0.02"), "y": rig("3.4", "0.03")}, yaw_free=True)
    function = TransferFunction((interval("3", "4"),), (interval("1"), interval("3", "4")))
    with pytest.raises(ValueError, match="use bandwidth_rad_s"):
        dataclasses.replace(rig("3"), response=AttitudeResponse(function, interval("0.02")))


@pytest.fixture(scope="module")
def proven(rig):
    channel = axis_channel(rig("2.9", "0.02"))
    proof = prove_by_sectors(channel, 8, RIG)
    assert proof is not None
    return channel, proof


def test_a_proof_survives_its_text(proven):
    channel, proof = proven
    assert sector_proof_of(sector_proof_json(proof), channel) == proof


@settings(max_examples=80, deadline=None)
@given(data=st.data())
def test_a_changed_sign_of_the_function_is_refused(proven, data):
    channel, proof = proven
    place = data.draw(st.integers(0, 7))  # the diagonal of rays comes early: V would be negative there
    changed = list(proof.lyapunov)
    changed[0 if place == 0 else place] = -abs(changed[place]) - 1
    assert check_sectors(proof._replace(lyapunov=tuple(changed)), channel) != ""


@pytest.mark.parametrize("which", ["krasovskii", "sign_multipliers"])
def test_a_negative_multiplier_is_refused(proven, which):
    channel, proof = proven
    values = list(getattr(proof, which))
    values[0] = Fraction(-1, 8)
    assert "multiplier" in check_sectors(proof._replace(**{which: tuple(values)}), channel)


def test_forged_shapes_are_refused(proven):
    channel, proof = proven
    zero = Fraction(0)
    for forged in (
        proof._replace(lyapunov=proof.lyapunov[:-1]),
        proof._replace(lyapunov=(zero,) * len(proof.lyapunov)),
        proof._replace(sign_multipliers=()),
        proof._replace(krasovskii=()),
        proof._replace(krasovskii=(zero, zero)),
        proof._replace(rays=proof.rays[::-1]),
        proof._replace(rays=proof.rays[:1]),
        proof._replace(rays=proof.rays[:4]),  # a quarter of the plane left out
        proof._replace(rays=proof.rays * 20),
        proof._replace(scale=Scale(-proof.scale.time_s, proof.scale.states)),
        proof._replace(scale=Scale(proof.scale.time_s, (zero, *proof.scale.states[1:]))),
        proof._replace(scale=Scale(proof.scale.time_s, proof.scale.states[:-1])),
    ):
        assert check_sectors(forged, channel) != ""


def test_a_proof_for_another_loop_is_refused(proven, rig):
    _, proof = proven
    for other in (rig("2.4", "0.02"), rig("2.9", "0.06"), rig("2.9")):
        assert check_sectors(proof, axis_channel(other)) != ""


@pytest.mark.parametrize("count", [8, 16, 32, 64])
def test_rays_hold_both_axes_exactly(count, rig):
    cut = sectors(axis_channel(rig()), rays(count))
    assert len(cut) == count
    assert rays(count)[0] == (1, 0)
    assert rays(count)[count // 2][0] == 0


@pytest.mark.parametrize("delay", ["pade", "none", None, 3])
def test_a_proof_that_takes_the_delay_otherwise_is_refused(proven, delay):
    channel, proof = proven
    with pytest.raises(ValueError, match="takes the delay"):
        sector_proof_of(sector_proof_json(proof) | {"delay": delay}, channel)
