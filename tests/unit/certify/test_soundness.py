"""What is certified does not grow, whatever the weights do; and the sampled adaptation is stable where it says so."""

import math
from dataclasses import replace
from decimal import Decimal

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import assume, given, settings

from companion.attitude_response.exact import decimal, interval
from companion.attitude_response.kinds import FirstOrder, SecondOrder
from companion.attitude_response.response import AttitudeResponse
from companion.certify.bandwidth import with_bandwidth
from companion.certify.certificate import Scaling, floats, prove
from companion.certify.closed_loop import axis_vertices
from companion.certify.falsify import exponentials, worst_switching
from companion.certify.polynomial.lifting import monomials
from companion.certify.problem import AxisProblem
from companion.certify.sampling.sampled import error_dynamics, largest_adaptation_rate, tick_matrix


def lyapunov_of(proof):
    """v(x) = z(y)^T P z(y), x = T y."""
    back = np.linalg.inv(np.array(proof.coordinates, dtype=float))
    basis = np.array(monomials(len(back), proof.degree // 2))
    p = np.zeros((len(basis), len(basis)))
    p[np.tril_indices(len(basis))] = [float(v) for v in proof.lyapunov]
    p = p + np.tril(p, -1).T

    def value(x):
        z = np.prod((back @ x) ** basis, axis=1)
        return z @ p @ z

    def rise(a, x):
        return value(x + 1e-6 * (a @ x)) - value(x)

    return value, rise


@st.composite
def axes(draw):
    wn, zeta = draw(st.floats(1.0, 5.0)), draw(st.floats(0.5, 1.2))
    nominal = (wn * wn / 9.81, 2 * zeta * wn / 9.81)
    upper = tuple(decimal(f"{w * draw(st.floats(1.02, 1.5)):.4f}") for w in nominal)
    lower = tuple(decimal(f"{w * draw(st.floats(-1.2, 0.9)):.4f}") for w in nominal)
    speed = draw(st.floats(1.0, 4.0)) * wn
    second = draw(st.booleans())
    dynamics = (
        SecondOrder(interval(f"{2 * speed:.3f}"), interval(f"{draw(st.floats(0.7, 1.2)):.2f}"))
        if second
        else FirstOrder(interval(f"{speed:.3f}", f"{speed * draw(st.floats(1.0, 1.2)):.3f}"))
    )
    response = AttitudeResponse(dynamics, interval(f"{draw(st.sampled_from([0, 0.01, 0.03]))}"))
    return AxisProblem(decimal(f"{wn:.3f}"), decimal(f"{zeta:.3f}"), lower, upper, response)


@given(axes(), st.sampled_from([2, 2, 4]), st.integers(0, 2**32 - 1))
@settings(max_examples=30)
def test_certified_systems_never_grow(axis, degree, seed):
    generator = np.random.default_rng(seed)
    vertices = axis_vertices(axis)
    assume(len(vertices[0]) <= 4 or degree == 2)
    proof = prove(vertices, degree)
    assume(proof is not None)
    value, rise = lyapunov_of(proof)
    matrices = floats(vertices)
    x = generator.normal(size=matrices.shape[1])
    before = value(x)
    for step in range(60):
        dt = generator.choice([1e-3, 1e-2, 0.1])
        if step % 3 == 0:  # inside the box: any mixture of vertices
            matrix = np.tensordot(generator.dirichlet(np.ones(len(matrices))), matrices, 1)
        elif step % 3 == 1:  # a corner
            matrix = generator.choice(matrices)
        else:  # the corner that is worst just now
            matrix = max(matrices, key=lambda a: rise(a, x))
        x = exponentials(matrix[None], np.array([dt]))[0] @ x
        after = value(x)
        assert after < before * (1 + 1e-12)
        size = np.abs(x).max()
        x, before = x / size, after / size**proof.degree


@pytest.mark.parametrize(("bandwidth", "degree"), [("2.75", 4), ("2.92", 2)])
def test_worst_switching_of_a_certified_system_dies_out(rig, bandwidth, degree):
    axis = rig(bandwidth)
    assert prove(axis_vertices(axis), degree) is not None
    assert worst_switching(axis).spectral_radius < 1


@given(axes())
@settings(max_examples=5)
def test_bounds_never_cross(axis):
    """No counterexample where there is a proof."""
    slowed = with_bandwidth(axis, Decimal(f"{float(axis.natural_frequency_rad_s) * 1.6:.3f}"))
    proven = prove(axis_vertices(slowed), 2) is not None
    assert not (proven and worst_switching(slowed).spectral_radius > 1)


@pytest.mark.parametrize("bandwidth", ["2.7", "3", "30"])
def test_scaling_is_exactly_invertible_and_short(rig, bandwidth):
    scaling = Scaling(axis_vertices(rig(bandwidth, "0.02")))
    diagonal = np.diag(scaling.transform)
    assert np.all(np.log2(diagonal) == np.round(np.log2(diagonal)))
    assert np.allclose(scaling.transform, np.tril(scaling.transform))


@pytest.mark.parametrize("rate_hz", ["50", "250", "1000"])
@pytest.mark.parametrize("case", ["rig", "simulation"])
def test_largest_adaptation_rate(case, rate_hz, sampling, request):
    axis = request.getfixturevalue(case)()
    slower = replace(sampling, tick_rate_hz=Decimal(rate_hz))
    limit = largest_adaptation_rate(axis, slower)
    assert math.isfinite(limit)
    model = error_dynamics(axis, slower)
    envelope = 0.4**2 + 0.5**2
    for share in np.linspace(0.001, 0.999, 60):
        for updated in (False, True):
            matrix = tick_matrix(model, share * limit * envelope, updated)
            assert np.abs(np.linalg.eigvals(matrix)).max() < 1
    beyond = [np.abs(np.linalg.eigvals(tick_matrix(model, 1.001 * limit * envelope, u))).max() for u in (False, True)]
    assert max(beyond) > 1


def test_ten_metres_from_the_origin_no_sample_rate_is_enough(rig, sampling):
    """The law uses absolute position as a regressor: the gain grows with its square."""
    far = replace(sampling, tick_rate_hz=Decimal(250), position_m=Decimal(10))
    assert largest_adaptation_rate(rig(), far) < 1
