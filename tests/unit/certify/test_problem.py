"""Degenerate input ends in one clear line, and the closed loop is that of the paper."""

import itertools
from dataclasses import replace
from decimal import Decimal
from fractions import Fraction

import numpy as np
import pytest
from scipy import signal

from companion.attitude_response.exact import decimal, interval
from companion.attitude_response.kinds import FirstOrder, SecondOrder, TransferFunction
from companion.attitude_response.realisation import companion_form, delay_line, is_hurwitz
from companion.attitude_response.response import AttitudeResponse, corners
from companion.certify.closed_loop import axis_vertices, joint_channel
from companion.certify.polynomial.lifting import gram_null_space, lift, monomials
from companion.certify.problem import Problem, Sampling
from companion.certify.proof import channel_vertices
from companion.certify.statement import problem_of, statement


def response(dynamics, delay=("0",), order=1):
    return AttitudeResponse(dynamics, interval(*delay), order)


def function(numerator, denominator):
    return TransferFunction(tuple(map(interval, numerator)), tuple(map(interval, denominator)))


FIRST = FirstOrder(interval("3"))


@pytest.mark.parametrize(
    ("make", "reason"),
    [
        (lambda: response(FirstOrder(interval("0"))), "bandwidth must be positive, not 0"),
        (lambda: response(FirstOrder(interval("-3"))), "bandwidth must be positive, not -3"),
        (lambda: response(FirstOrder(interval("4", "3"))), "bandwidth interval is upside down: 4 to 3"),
        (lambda: response(SecondOrder(interval("9"), interval("-0.1"))), "damping ratio must be positive"),
        (lambda: response(SecondOrder(interval("0"), interval("1"))), "natural frequency must be positive"),
        (lambda: response(function(["4"], ["1", "-1", "4"])), "transfer function is unstable"),
        (lambda: response(function(["3"], ["1", "4"])), "dc gain is not 1"),
        (lambda: response(function(["1", "4"], ["1", "4"])), "strictly proper"),
        (lambda: response(function(["4"], ["0", "1", "4"])), "leading denominator coefficient"),
        (lambda: response(FIRST, ("-0.01",)), "delay must be zero or"),
        (lambda: response(FIRST, ("0", "0.01")), "delay must be zero or an interval above zero"),
        (lambda: response(FIRST, ("0.02",), 0), "pade_order must be 1 to 4"),
        (lambda: decimal("three"), "is not a decimal number"),
        (lambda: decimal("inf"), "is not a finite number"),
        (lambda: decimal("1e99999"), "digits"),
        (lambda: Problem({}), "at least one axis"),
        (lambda: Sampling(Decimal(0), Decimal(1), Decimal(1), Decimal(1)), "tick_rate_hz must be positive"),
    ],
)
def test_degenerate_parts(make, reason):
    with pytest.raises(ValueError, match=reason) as caught:
        make()
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"weights_upper": (Decimal("0.5"), Decimal("0.35"))}, "do not contain the nominal position weight 0.5392"),
        ({"weights_lower": (Decimal("0"), Decimal("0.34"))}, "do not contain the nominal velocity weight 0.3282"),
        ({"response": response(FIRST, ("2.8",))}, "delay 2.8 s is not below the reference period 2.73 s"),
        ({"damping_ratio": Decimal(0)}, "damping_ratio must be positive, not 0"),
        ({"natural_frequency_rad_s": Decimal(-2)}, "natural_frequency_rad_s must be positive"),
    ],
)
def test_degenerate_axes(rig, changes, reason):
    with pytest.raises(ValueError, match=reason) as caught:
        replace(rig(), **changes)
    assert "\n" not in str(caught.value)


def test_a_free_yaw_needs_two_axes_of_one_order(rig):
    with pytest.raises(ValueError, match="give both"):
        Problem({"x": rig()}, yaw_free=True)
    with pytest.raises(ValueError, match="same order"):
        joint_channel(rig(), replace(rig(), response=response(SecondOrder(interval("9"), interval("1")))))


def test_vertices_are_equation_24(rig):
    """With x_c = w / M, eq. (18), the matrix is similar to the one printed in the paper."""
    reference, inlet, m = np.array([[0, 1], [-5.29, -3.22]]), np.array([[0], [9.81]]), 3.0
    found = np.array(axis_vertices(rig("3")), dtype=float)
    for matrix, signs in zip(found, itertools.product((-1, 1), repeat=2), strict=True):
        weights = np.array([[0.55 * signs[0]], [0.35 * signs[1]]])
        paper = np.block([[reference + inlet @ weights.T, inlet * m], [-weights.T, np.array([[-m]])]])
        to_paper = np.diag([1, 1, 1 / m])
        np.testing.assert_allclose(to_paper @ matrix @ np.linalg.inv(to_paper), paper, atol=1e-12)


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_pade_delays(order):
    line = delay_line(Fraction(1, 20), order)
    a, b, c = (np.array(part, dtype=float) for part in line[:3])
    for frequency in (1.0, 5.0, 10.0):
        reached = c @ np.linalg.solve(1j * frequency * np.eye(order) - a, b) + float(line.d)
        assert abs(reached) == pytest.approx(1.0)
        assert reached == pytest.approx(np.exp(-0.05j * frequency), abs=0.012)


@pytest.mark.parametrize(
    "dynamics", [FIRST, SecondOrder(interval("9"), interval("0.9")), function(["2", "30"], ["1", "6", "20", "30"])]
)
@pytest.mark.parametrize("delay", ["0", "0.03"])
def test_responses_have_unit_gain_and_are_stable(dynamics, delay):
    (system,) = corners(response(dynamics, (delay,), 2))
    a, b, c = (np.array(part, dtype=float) for part in system[:3])
    assert system.d == 0
    assert -c @ np.linalg.solve(a, b) == pytest.approx(1.0)
    assert np.linalg.eigvals(a).real.max() < 0


def test_companion_form_is_the_transfer_function():
    system = companion_form([Fraction(2), Fraction(30)], [Fraction(1), Fraction(6), Fraction(20), Fraction(30)])
    a, b, c = (np.array(part, dtype=float) for part in system[:3])
    numerator, denominator = signal.ss2tf(a, b[:, None], c[None], [[0]])
    np.testing.assert_allclose(numerator[0], [0, 0, 2, 30], atol=1e-9)
    np.testing.assert_allclose(denominator, [1, 6, 20, 30])


def test_vertices_enclose_the_box(rig):
    """Any admissible parameters give a matrix in the hull: each entry is affine in each parameter by itself."""
    dynamics = SecondOrder(interval("9", "10"), interval("0.8", "1"))
    axis = replace(rig(), response=response(dynamics, ("0.02", "0.03")))
    centre = replace(rig(), response=response(SecondOrder(interval("9.5"), interval("0.9")), ("0.024",)))
    hull, middle = (np.array(axis_vertices(a)) for a in (axis, centre))  # 0.024: the middle of 1/delay
    assert len(hull) == 32
    assert np.array_equal(hull.mean(axis=0), middle.mean(axis=0))  # exact rationals


def test_yaw_corners_hold_every_yaw(rig):
    """At yaw 0 and 90 degrees the joint loop is that of each axis; the octagon holds the circle."""
    matrices = np.array(channel_vertices(joint_channel(rig("3"), rig("4"))), dtype=float)
    assert matrices.shape == (128, 6, 6)
    cosine, sine = (2 * matrices[:, 4, 4] + 7), 2 * matrices[:, 4, 5]  # -(3.5 - 0.5 cos), 0.5 sin
    assert np.all(np.abs(cosine) <= 1 + 1e-12)
    for yaw in np.linspace(0, np.pi, 40):
        direction = np.array([np.cos(2 * yaw), np.sin(2 * yaw)])
        assert np.max(direction[0] * cosine + direction[1] * sine) >= 1


def test_statement_round_trip(quadrotor, rig):
    assert problem_of(statement(quadrotor)) == quadrotor
    dynamics = function(["90.250"], ["1", "17.48", "90.25"])
    problem = Problem({"x": replace(rig(), response=response(dynamics, ("0.010", "2e-2"), 2))})
    assert problem_of(statement(problem)) == problem
    assert statement(problem)["axes"]["x"]["response"]["delay_s"] == ["0.01", "0.02"]


def test_routh_agrees_with_the_roots():
    generator = np.random.default_rng(1)
    for _ in range(200):
        polynomial = generator.integers(-2, 9, generator.integers(2, 6))
        polynomial[0] = 1
        largest = np.roots(polynomial).real.max()
        if abs(largest) > 1e-6:
            assert is_hurwitz([Fraction(int(c)) for c in polynomial]) == (largest < 0)


@pytest.mark.parametrize(("n", "degree"), [(3, 1), (3, 4), (4, 3), (5, 2)])
def test_lifting(n, degree):
    generator = np.random.default_rng(n)
    a = generator.integers(-5, 6, (n, n))
    x = generator.normal(size=n)
    basis = np.array(monomials(n, degree))
    z = np.prod(x**basis, axis=1)
    slope = np.prod((x + 1e-6 * a @ x) ** basis, axis=1) - np.prod((x - 1e-6 * a @ x) ** basis, axis=1)
    lifted = [sum(entry * z[column] for column, entry in row.items()) for row in lift(a.tolist(), degree)]
    np.testing.assert_allclose(lifted, slope / 2e-6, rtol=1e-5, atol=1e-5)
    for i, j, k, l in gram_null_space(n, degree):  # noqa: E741
        assert z[i] * z[j] == pytest.approx(z[k] * z[l])
