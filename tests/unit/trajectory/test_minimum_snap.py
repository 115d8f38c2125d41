"""Minimum snap against a quadratic programme solved by cvxpy; the time it takes; and waypoints within their limits."""

import math
import random
import time
from itertools import pairwise

import cvxpy
import numpy as np
import pytest

from companion.trajectory.feasibility import Limits, excess, samples
from companion.trajectory.minimum_snap import minimum_snap
from companion.trajectory.waypoints import piecewise, through

LIMITS = Limits(3.0, 4.0, 15.0, math.radians(25.0), 0.3, 1.6, math.radians(60.0))


def row(at: float, order: int) -> np.ndarray:
    """Derivative of the powers 0 to 7."""
    return np.array([math.perm(i, order) * at ** (i - order) if i >= order else 0.0 for i in range(8)])


def reference(places: np.ndarray, durations: np.ndarray) -> list[np.ndarray]:
    """Coefficients in the share of each piece's time, (8,) each, of one axis: the programme as it is stated."""
    pieces = [cvxpy.Variable(8) for _ in durations]
    cost, kept = 0.0, []
    for i, (piece, duration) in enumerate(zip(pieces, durations, strict=True)):
        snap = np.array([[math.perm(a, 4) * math.perm(b, 4) / (a + b - 7) for b in range(4, 8)] for a in range(4, 8)])
        cost += cvxpy.sum_squares(np.linalg.cholesky(snap).T @ piece[4:]) / duration**7
        kept += [row(0, 0) @ piece == places[i], row(1, 0) @ piece == places[i + 1]]
    for order in (1, 2, 3):
        kept += [row(0, order) @ pieces[0] == 0.0, row(1, order) @ pieces[-1] == 0.0]
        for (one, other), (t, u) in zip(pairwise(pieces), pairwise(durations), strict=True):
            kept += [row(1, order) @ one / t**order == row(0, order) @ other / u**order]
    problem = cvxpy.Problem(cvxpy.Minimize(cost), kept)
    problem.solve(solver=cvxpy.CLARABEL, tol_gap_abs=1e-11, tol_gap_rel=1e-11, tol_feas=1e-11)
    return [piece.value for piece in pieces]


@pytest.mark.parametrize("count", [2, 3, 8])
def test_it_agrees_with_a_quadratic_programme(count: int) -> None:
    generator = np.random.default_rng(count)
    places, durations = generator.uniform(-5, 5, (count, 1)), generator.uniform(1.0, 3.0, count - 1)
    ours = minimum_snap(places, durations)[:, :, 0]
    shares = np.linspace(0.0, 1.0, 11)
    for piece, theirs, duration in zip(ours, reference(places[:, 0], durations), durations, strict=True):
        flown = np.polynomial.polynomial.polyval(shares * duration, piece)
        np.testing.assert_allclose(flown, np.polynomial.polynomial.polyval(shares, theirs), atol=1e-6)


def test_derivatives_up_to_the_sixth_are_continuous() -> None:
    generator = np.random.default_rng(1)
    places, durations = generator.uniform(-5, 5, (6, 3)), generator.uniform(1.0, 3.0, 5)
    pieces = minimum_snap(places, durations)
    for i in range(4):
        for order in range(7):
            before, after = row(durations[i], order) @ pieces[i], row(0.0, order) @ pieces[i + 1]
            np.testing.assert_allclose(before, after, atol=1e-6 * (1.0 + np.abs(after).max()))


def test_twenty_waypoints_take_a_tenth_of_a_second() -> None:
    generator = random.Random(1)
    places = [(*(generator.uniform(-9, 9) for _ in range(3)), 0.0) for _ in range(20)]
    through(places, LIMITS)  # numpy is imported
    taken = []
    for _ in range(3):
        began_s = time.process_time()  # of this process alone: others do not count
        through(places, LIMITS)
        taken.append(time.process_time() - began_s)
    assert min(taken) < 0.1


@pytest.mark.parametrize("count", [2, 3, 9])
def test_waypoints_are_met_within_the_limits_and_near_one_of_them(count: int) -> None:
    generator = random.Random(count)
    places = [(*(generator.uniform(-9, 9) for _ in range(3)), generator.uniform(-1, 1)) for _ in range(count)]
    flown = through(places, LIMITS)
    assert excess(flown, LIMITS) is None
    assert excess(flown, Limits(*(0.9 * limit for limit in LIMITS[:3]), *LIMITS[3:])) is not None
    for place in places:
        assert min(math.dist(place[:3], at[:3]) for _, at in samples(flown)) < 0.1


def test_two_places_in_one_are_refused() -> None:
    with pytest.raises(ValueError, match="place 2 is where place 1 is"):
        through([(0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)], LIMITS)


def test_headings_go_the_short_way_round() -> None:
    flown = piecewise([(0.0, 0.0, 0.0, 3.0), (1.0, 0.0, 0.0, -3.0)], [1.0])
    assert abs(flown.at(0.5).yaw_rad - 3.0) == pytest.approx(math.pi - 3.0)
