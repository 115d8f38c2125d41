"""Least certified bandwidth, ours beside plain cvxpy bisection with every step built anew.

With `--baseline DIR`, `companion check` of the rig by this build and by the one in DIR instead, in turn.

python benchmarks/certificate.py [--degree 6] [--baseline DIR]
"""

import argparse
import os
import subprocess
import sys
import time
import warnings
from decimal import Decimal
from functools import partial
from pathlib import Path

import cvxpy as cp
import numpy as np
from baseline import checkout

from companion.attitude_response.exact import decimal, interval
from companion.attitude_response.kinds import FirstOrder
from companion.attitude_response.response import AttitudeResponse
from companion.certify.bandwidth import minimum_bandwidth, with_bandwidth
from companion.certify.certificate import Scaling, certify
from companion.certify.closed_loop import axis_vertices
from companion.certify.falsify import unstable_bandwidth
from companion.certify.polynomial.lifting import gram_null_space, lift, monomials
from companion.certify.problem import AxisProblem, Problem
from companion.certify.proof import verify
from companion.certify.search.bisection import TOLERANCE

CASES = {"simulation": ("4", "1.8", "0.65", "5.5"), "rig": ("2.3", "0.55", "0.35", "3")}
MARGIN = 1e-5  # plain cvxpy has no exact check: it must trust a margin


def problem_of(name: str) -> AxisProblem:
    wn, position, velocity, bandwidth = CASES[name]
    upper = decimal(position), decimal(velocity)
    lower = -upper[0], -upper[1]
    return AxisProblem(decimal(wn), Decimal("0.7"), lower, upper, AttitudeResponse(FirstOrder(interval(bandwidth))))


def plain_feasible(axis: AxisProblem, degree: int, scaling: Scaling) -> bool:
    """One step of the plain way: the cvxpy problem built anew and solved, the margin believed."""
    half = degree // 2
    matrices = scaling.apply(axis_vertices(axis))
    size, relations = len(monomials(3, half)), gram_null_space(3, half)
    p, margin = cp.Variable((size, size), symmetric=True), cp.Variable()
    constraints = [p - margin * np.eye(size) >> 0, cp.trace(p) == size, margin <= 1]
    for matrix in matrices:
        lifted = np.zeros((size, size))
        for row, entries in enumerate(lift(matrix, half)):
            for column, entry in entries.items():
                lifted[row, column] = entry
        decay = -(lifted.T @ p + p @ lifted)
        if relations:
            null = np.zeros((len(relations), size, size))
            for number, (i, j, k, l) in enumerate(relations):  # noqa: E741
                for sign, a, b in ((1, i, j), (-1, k, l)):
                    null[number, a, b] += sign
                    null[number, b, a] += sign  # twice on the diagonal
            factors = cp.Variable(len(relations))
            decay = decay + cp.reshape(null.reshape(len(relations), -1).T @ factors, (size, size), order="C")
        constraints.append(decay - margin * np.eye(size) >> 0)
    problem = cp.Problem(cp.Maximize(margin), constraints)
    try:
        warnings.simplefilter("ignore")  # "solution may be inaccurate", near the boundary
        problem.solve(solver=cp.CLARABEL)
    except cp.SolverError:
        return False
    return margin.value is not None and float(margin.value) > MARGIN


def plain_bandwidth(axis: AxisProblem, degree: int, scaling: Scaling, low: float, high: float) -> float:
    while high - low > TOLERANCE * high:
        middle = (low + high) / 2
        if plain_feasible(with_bandwidth(axis, Decimal(f"{middle:.4f}")), degree, scaling):
            high = middle
        else:
            low = middle
    return high


def beside(baseline: Path, rounds: int = 3) -> None:
    """Wall-clock seconds of `companion check config/antx_rig.yaml --all-degrees`, each build with its defaults."""
    builds = {"this build": Path(__file__).resolve().parents[1], "baseline": baseline}
    seconds: dict[str, list[float]] = {name: [] for name in builds}
    for _ in range(rounds):
        for name, root in builds.items():
            command = [sys.executable, "-m", "companion", "check", str(root / "config/antx_rig.yaml"), "--all-degrees"]
            start = time.perf_counter()
            environment = os.environ | {"PYTHONPATH": str(root)}
            subprocess.run(command, check=True, cwd=root, env=environment, stdout=subprocess.DEVNULL)
            seconds[name].append(time.perf_counter() - start)
            print(f"{name:<11}{seconds[name][-1]:>8.2f} s", flush=True)
    print(f"ratio of the fastest {min(seconds['baseline']) / min(seconds['this build']):.1f}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--degree", type=int, default=6, help="highest degree for plain cvxpy")
    parser.add_argument("--baseline", type=checkout, metavar="DIR", help="an older build to run in turn")
    arguments = parser.parse_args()
    if arguments.baseline is not None:
        beside(arguments.baseline)
        return
    plain_degree = arguments.degree
    print(f"{'case':<11}{'degree':>7}{'rad/s':>9}{'ours s':>9}{'plain rad/s':>13}{'plain s':>9}{'ratio':>8}")
    for name in CASES:
        axis = problem_of(name)
        scaling = Scaling(axis_vertices(axis))
        below: float | None = None
        for degree in (2, 4, 6, 8):
            start = time.perf_counter()
            found = minimum_bandwidth(axis, degree, below=below)
            ours = time.perf_counter() - start
            assert found is not None
            line = f"{name:<11}{degree:>7}{found.value:>9}{ours:>9.2f}"
            if degree <= plain_degree:
                high = below or 2 * float(found.value)
                start = time.perf_counter()
                plain = plain_bandwidth(axis, degree, scaling, 0.8 * float(found.value), high)
                seconds = time.perf_counter() - start
                line += f"{plain:>13.4f}{seconds:>9.2f}{seconds / ours:>8.1f}"
            print(line, flush=True)
            below = float(found.value)
        start = time.perf_counter()
        unstable = unstable_bandwidth(partial(with_bandwidth, axis), below or 1.0)
        assert unstable is not None
        print(f"{name:<11}unstable {unstable[0]:>7}{time.perf_counter() - start:>9.2f}")
    start = time.perf_counter()
    certificate = certify(Problem({"x": problem_of("simulation"), "y": problem_of("rig")}), 4)
    assert certificate is not None
    certified = time.perf_counter()
    verdict = verify(certificate)
    milliseconds = 1e3 * (time.perf_counter() - certified)
    print(f"certify both {certified - start:.3f} s, verify {milliseconds:.1f} ms: {verdict.reason}")


if __name__ == "__main__":
    main()
