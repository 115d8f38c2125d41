"""The second opinion reads like the paper, agrees with ours, and ends when it is told to."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from companion.certify.from_config import problem
from companion.certify.problem import AxisProblem
from companion.certify.second_opinion import closed_loops, margin, minimum_bandwidth, second_opinion
from companion.config.load import load_config

CONFIGS = Path(__file__).resolve().parents[3] / "config"


def axis_of(name: str, *overrides: str, axis: str = "x") -> AxisProblem:
    return problem(load_config(CONFIGS / f"{name}.yaml", overrides)).axes[axis]


@pytest.mark.parametrize(
    ("config", "axis", "bandwidth"),
    [("antx_rig", "x", 2.904), ("paper_quadrotor", "x", 5.697), ("paper_quadrotor", "y", 5.697)],
)
def test_both_solvers_find_the_bandwidth_that_the_inequality_needs(config: str, axis: str, bandwidth: float) -> None:
    opinions = second_opinion(axis_of(config, axis=axis))
    assert opinions.theirs_rad_s == pytest.approx(bandwidth, rel=1e-3)
    assert opinions.ours_rad_s == pytest.approx(opinions.theirs_rad_s, rel=1e-3)
    assert (opinions.solver, opinions.delay_left_out) == ("SCS", False)


@pytest.mark.parametrize(
    "response",
    [
        "{natural_frequency_rad_s: [10, 12], damping_ratio: 0.8}",
        "{numerator: [16], denominator: [1, 6, 16]}",
    ],
)
def test_responses_of_other_kinds_have_a_second_opinion_too(response: str) -> None:
    opinions = second_opinion(axis_of("antx_rig", f"attitude.x={response}"))
    assert opinions.theirs_rad_s is not None
    assert opinions.ours_rad_s == pytest.approx(opinions.theirs_rad_s, rel=1e-3)


def test_a_delay_is_left_out_of_both_and_that_is_told() -> None:
    delayed = second_opinion(axis_of("antx_rig", "attitude.x.delay_s=[0.01, 0.03]"))
    assert delayed == second_opinion(axis_of("antx_rig"))._replace(delay_left_out=True)


def test_the_start_of_the_search_does_not_matter() -> None:
    found = [minimum_bandwidth(axis_of("antx_rig", f"attitude.x.bandwidth_rad_s={m}")) for m in (0.3, 3, 200)]
    assert found == pytest.approx([2.904] * 3, rel=1e-3)


def test_the_matrices_are_those_of_the_paper() -> None:
    """(24) in the state of (18), x_c = w / M."""
    wn, zeta, g, m = 2.3, 0.7, 9.81, 3.0
    wanted = [
        np.array([[0, 1, 0], [-wn * wn + g * w1, -2 * zeta * wn + g * w2, g * m], [-w1, -w2, -m]])
        for w1 in (-0.55, 0.55)
        for w2 in (-0.35, 0.35)
    ]
    units = np.array([1.0, 1.0, m])  # w = M x_c
    given = [loop * units / units[:, np.newaxis] for loop in closed_loops(axis_of("antx_rig"))]
    assert np.array(given) == pytest.approx(np.array(wanted), rel=1e-12)


def test_a_loop_that_is_unstable_has_no_margin() -> None:
    assert margin([np.diag([-1.0, -2.0])]) > 0.1
    assert margin([np.diag([-1.0, 0.5])]) < 1e-6


def test_ctrl_c_ends_it_although_the_solver_catches_it() -> None:
    code = (
        "import signal\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"  # ignored where a shell started this behind it
        "import numpy as np\n"
        "import companion.certify.second_opinion as s\n"
        "s._ACCURACY, s._ITERATIONS = 1e-15, 10**7\n"
        "chain = s.cp.reductions.solvers.conic_solvers.scs_conif.SCS\n"
        "solve = chain.solve_via_data\n"
        "def told(*given, **more):\n"
        "    print('solving', flush=True)\n"
        "    return solve(*given, **more)\n"
        "chain.solve_via_data = told\n"
        "rng = np.random.default_rng(0)\n"
        "s.margin([rng.normal(size=(20, 20)) - 9 * np.eye(20) for _ in range(8)])\n"
        "print('went on')"
    )
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout is not None
    try:
        assert process.stdout.readline() == "solving\n"
        code_ = None
        while code_ is None:  # the solver takes Ctrl-C once it has begun, Python before
            os.kill(process.pid, signal.SIGINT)
            try:
                code_ = process.wait(0.5)
            except subprocess.TimeoutExpired:
                continue
        out, err = process.communicate()
    finally:
        process.kill()
        process.wait()
    assert "went on" not in out
    assert "KeyboardInterrupt" in err
