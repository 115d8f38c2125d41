"""A second opinion on the quadratic bound: (24)-(25) in cvxpy as the paper has them, solved by SCS.

Remark 3 casts (25) as a convex problem whose solution is the least actuator bandwidth M that satisfies Assumption 2.
Here that is a bisection on M over the feasibility of (25). It shares no matrix, no scaling and no solver with the
certificate, and is no proof: SCS is a first-order method in floating point. Without delay, as the paper."""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Callable
from dataclasses import replace
from decimal import Decimal
from typing import Any, Final, NamedTuple

import cvxpy as cp
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import matrix_balance

from companion.attitude_response.exact import NO_DELAY
from companion.attitude_response.kind import PLACES, ceiling
from companion.certify.bandwidth import minimum_bandwidth_by_rays, tuned_bandwidth, with_bandwidth
from companion.certify.problem import AxisProblem
from companion.certify.search.bisection import REACH

SOLVER: Final = cp.SCS
_ACCURACY: Final = 1e-7  # asked of the solver, in at most so many iterations: it needs more near the boundary alone
_ITERATIONS: Final = 50_000
_TOLERANCE: Final = 1e-4  # of the bisection, relative
_INTERRUPTED: Final = -5  # SCS_SIGINT

Array = NDArray[np.float64]


class Opinions(NamedTuple):
    """The least bandwidth without delay that a quadratic function certifies, rad/s; None where none is found.

    Attributes
    ----------
    ours_rad_s
        By Clarabel, rounded to rationals and verified exactly.
    theirs_rad_s
        By `solver`, in floating point.
    solver
        Its name.
    delay_left_out
        Whether the axis has a delay, which neither number counts.
    """

    ours_rad_s: float | None
    theirs_rad_s: float | None
    solver: str
    delay_left_out: bool


def second_opinion(axis: AxisProblem) -> Opinions:
    """Both numbers for one axis. Of a second order the bandwidth is its natural frequency, as everywhere."""
    undelayed = replace(axis, response=replace(axis.response, delay_s=NO_DELAY))
    ours = minimum_bandwidth_by_rays(undelayed, 0)
    theirs = minimum_bandwidth(undelayed)
    return Opinions(None if ours is None else float(ours.value), theirs, str(SOLVER), axis.response.delay_s.upper > 0)


def minimum_bandwidth(axis: AxisProblem) -> float | None:
    """The least M in rad/s for which (25) has a solution, by bisection; None up to `REACH` times the tuned one."""

    def satisfied(m: float) -> bool:
        return margin(closed_loops(with_bandwidth(axis, ceiling(Decimal(m), PLACES)))) > 10 * _ACCURACY

    return _bisect(satisfied, float(tuned_bandwidth(axis.response)))


def closed_loops(axis: AxisProblem) -> list[Array]:
    """(24) at every corner of the weights and of the attitude response.

    With A_a = -M, B_a = 1, C_a = M these are the matrices of the paper, for its actuator (18) `x_c' = -M x_c + u`,
    `w = M x_c`. Here its state is w itself, a change of coordinates, and it may be of higher order.
    """
    wn, zeta, g = (float(v) for v in (axis.natural_frequency_rad_s, axis.damping_ratio, axis.gravity_m_s2))
    a_r = np.array([[0.0, 1.0], [-(wn**2), -2.0 * zeta * wn]])
    b = np.array([[0.0], [g]])
    loops = []
    for actuator in axis.response.dynamics.corners():
        a_a = np.array(actuator.a, dtype=float)
        b_a = np.array(actuator.b, dtype=float)[:, np.newaxis]
        c_a = np.array(actuator.c, dtype=float)[np.newaxis, :]
        for corner in itertools.product(*zip(axis.weights_lower, axis.weights_upper, strict=True)):
            w = np.array(corner, dtype=float)[:, np.newaxis]
            loops.append(np.block([[a_r + b @ w.T, b @ c_a], [-b_a @ w.T, a_a]]))
    return loops


def margin(loops: list[Array]) -> float:
    """The largest t with `A' P + P A <= -t I` for every loop, `P >= t I` and trace P = n: positive where (25) holds.

    In units of time and of the states that make the entries of the loops alike, on which (25) does not depend."""
    _, scales = matrix_balance(sum(np.abs(loop) for loop in loops), permute=False, separate=True)
    units = scales[0]
    loops = [loop * units / units[:, np.newaxis] for loop in loops]
    time = max(np.abs(loop).max() for loop in loops)
    n = len(units)
    p, t = cp.Variable((n, n), symmetric=True), cp.Variable()
    inequalities = [a.T @ p + p @ a << -t * np.eye(n) for a in (loop / time for loop in loops)]
    trace: Any = sum(p[i, i] for i in range(n))
    problem = cp.Problem(cp.Maximize(t), [p >> t * np.eye(n), trace == n, *inequalities])
    _solve(problem)
    return float(np.asarray(t.value).item())


def _solve(problem: cp.Problem) -> None:
    """`problem.solve`, which would take Ctrl-C, caught by the solver itself, for one more failure."""
    data, chain, inverse = problem.get_problem_data(SOLVER)
    options = {"eps_abs": _ACCURACY, "eps_rel": _ACCURACY, "max_iters": _ITERATIONS}
    raw = chain.solve_via_data(problem, data, solver_opts=options)
    if raw["info"]["status_val"] == _INTERRUPTED:
        raise KeyboardInterrupt
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # "inaccurate" is what it calls a solution near the boundary
        problem.unpack_results(raw, chain, inverse)


def _bisect(satisfied: Callable[[float], bool], start: float) -> float | None:
    """The least value that satisfies, sought from `start`."""
    low = high = start
    while not satisfied(high):
        low, high = high, 1.5 * high
        if high > REACH * start:
            return None
    while low == high or satisfied(low):
        low, high = low / 1.5, low
        if low < start / 1000:
            return high
    while high - low > _TOLERANCE * high:
        middle = (low + high) / 2
        low, high = (low, middle) if satisfied(middle) else (middle, high)
    return high
