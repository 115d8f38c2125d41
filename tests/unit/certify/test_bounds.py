"""The figures: least certified bandwidth by degree, delay, and what is proven unstable."""

from dataclasses import replace
from decimal import Decimal
from functools import partial

import numpy as np
import pytest

from companion.attitude_response.exact import decimal, interval
from companion.attitude_response.kinds import FirstOrder, SecondOrder, TransferFunction
from companion.attitude_response.response import AttitudeResponse
from companion.certify.bandwidth import (
    fastest_reference,
    largest_delay,
    minimum_bandwidth,
    minimum_bandwidth_by_rays,
    tuned_bandwidth,
    with_bandwidth,
    with_delay,
    with_natural_frequency,
)
from companion.certify.closed_loop import axis_channel, axis_vertices
from companion.certify.falsify import simulate, unstable_bandwidth, worst_switching
from companion.certify.piecewise.sector_proof import check_sectors
from companion.certify.polynomial.polynomial_proof import check


def least_bandwidths(axis, degrees):
    found, below = {}, None
    for degree in degrees:
        least = minimum_bandwidth(axis, degree, below=below)
        assert least is not None
        assert check(least.proof, axis_vertices(with_bandwidth(axis, least.value))) == ""
        below = float(least.value)
        found[degree] = below
    return found


@pytest.mark.parametrize(
    ("case", "figures"),
    [
        ("simulation", {2: 5.697, 4: 5.398, 6: 5.262, 8: 5.165}),
        ("rig", {2: 2.904, 4: 2.743, 6: 2.667, 8: 2.614}),
    ],
)
def test_least_bandwidth_by_degree(case, figures, request):
    assert least_bandwidths(request.getfixturevalue(case)(), figures) == pytest.approx(figures, rel=1e-3)


@pytest.mark.parametrize(
    ("case", "delay", "figures"),
    [
        ("rig", "0.02", {0: 3.236, 8: 2.889, 16: 2.844}),
        ("rig", "0.05", {0: 3.880, 8: 3.436, 16: 3.389}),
        ("simulation", "0.02", {0: 6.998, 8: 6.250, 16: 6.179}),
    ],
)
def test_true_delay_costs_bandwidth(case, delay, figures, request):
    axis, below = request.getfixturevalue(case)(delay=delay), None
    for count, figure in figures.items():
        least = minimum_bandwidth_by_rays(axis, count, below=below)
        assert check_sectors(least.proof, axis_channel(with_bandwidth(axis, least.value))) == ""
        below = float(least.value)
        assert below == pytest.approx(figure, rel=3e-3)


@pytest.mark.parametrize(("case", "certified", "figure"), [("simulation", 5.165, 5.02), ("rig", 2.614, 2.525)])
def test_proven_unstable(case, certified, figure, request):
    axis = request.getfixturevalue(case)()
    found = unstable_bandwidth(partial(with_bandwidth, axis), certified)
    assert found is not None
    bandwidth, switching = found
    assert 0.995 * figure < float(bandwidth) < certified
    assert found == unstable_bandwidth(partial(with_bandwidth, axis), certified)  # deterministic

    slower = with_bandwidth(axis, bandwidth * Decimal("0.97"))
    worst = worst_switching(slower, start=switching)
    assert worst.spectral_radius > 1.01
    time_s, state = simulate(slower, worst, periods=12)
    size = np.linalg.norm(state, axis=1)[:: len(time_s) // 12]
    assert np.all(size[1:] > 1.005 * size[:-1])


@pytest.mark.parametrize("factor", [0.9, 0.7, 0.4])
def test_unstable_below_means_below(rig, factor):
    assert worst_switching(rig(f"{2.53 * factor:.3f}")).spectral_radius > 1


def test_equal_responses_need_equal_bandwidth(rig):
    """A second-order response written as a transfer function has the same certificate."""
    second = with_response(rig(), SecondOrder(interval("9.5"), interval("0.92")))
    function = with_response(
        rig(), TransferFunction((interval("90.25"),), (interval("1"), interval("17.48"), interval("90.25")))
    )
    ratios = [float(minimum_bandwidth(axis, 2).value / tuned_bandwidth(axis.response)) for axis in (second, function)]
    assert ratios[0] == pytest.approx(ratios[1], rel=1e-3)
    first = with_response(rig(), TransferFunction((interval("3"),), (interval("1"), interval("3"))))
    assert float(minimum_bandwidth(first, 2).value) == pytest.approx(2.904, rel=1e-3)


def test_an_interval_needs_more_than_its_lower_end(rig):
    axis = with_response(rig(), FirstOrder(interval("3", "3.6")))
    least = minimum_bandwidth(axis, 2)
    assert 2.904 < float(least.value) < 3.0
    assert len(axis_vertices(axis)) == 8


def test_largest_delay_lies_between_the_figures(rig):
    found = largest_delay(rig("3.25"), [0, 8])
    assert 0.02 < float(found.value) < 0.05
    again = with_delay(rig("3.25"), found.value)
    assert check_sectors(found.proof, axis_channel(again)) == ""
    assert largest_delay(rig("2.4"), [0]) is None


def test_fastest_reference_keeps_the_bounds_in_proportion(rig):
    """Time and the first-order bandwidth scale alike: 3 / 2.904 times the configured natural frequency."""
    found = fastest_reference(rig("3"), [0])
    assert float(found.value) == pytest.approx(2.3 * 3 / 2.904, rel=2e-3)
    faster = with_natural_frequency(rig("3"), found.value)
    assert check_sectors(found.proof, axis_channel(faster)) == ""


def with_response(axis, dynamics, delay="0"):
    return replace(axis, response=AttitudeResponse(dynamics, interval(decimal(delay))))
