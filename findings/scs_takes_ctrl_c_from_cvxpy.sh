#!/usr/bin/env bash
# SCS puts its own handler of SIGINT in place while it solves. Ctrl-C then stops the solve, but Python never hears of it:
# cvxpy turns the status "interrupted" into an ordinary SolverError. A search that takes SolverError for "infeasible" goes
# on, and nobody can stop it. What tells is the raw status: scs.SIGINT in `status_val`.
set -euo pipefail
work=$(mktemp -d); trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install -q cvxpy==1.9.3 scs==3.3.1
"$work/venv/bin/python" - <<'PYTHON' 2>/dev/null
import os
import signal
import threading

import cvxpy as cp
import numpy as np
import scs

generator = np.random.default_rng(0)
loops = [generator.normal(size=(20, 20)) - 9 * np.eye(20) for _ in range(8)]
p = cp.Variable((20, 20), symmetric=True)
problem = cp.Problem(cp.Minimize(cp.lambda_max(p)), [p >> np.eye(20), *(a.T @ p + p @ a << -np.eye(20) for a in loops)])
precise = {"eps_abs": 1e-15, "eps_rel": 1e-15, "max_iters": 10**6}  # for longer than it takes to press Ctrl-C


def ctrl_c():
    timer = threading.Timer(2.0, os.kill, (os.getpid(), signal.SIGINT))
    timer.daemon = True
    timer.start()


data, chain, _ = problem.get_problem_data(cp.SCS)
print(f"cvxpy {cp.__version__}, scs {scs.__version__}")
ctrl_c()
try:
    problem.solve(solver=cp.SCS, **precise)
    seen = "nothing"
except BaseException as error:
    seen = type(error).__name__
print(f"Ctrl-C during Problem.solve: {seen}")
assert seen == "SolverError", seen
ctrl_c()
raw = chain.solve_via_data(problem, data, solver_opts=precise)
print(f"the solver itself: status {raw['info']['status']!r}, status_val {raw['info']['status_val']}, SIGINT is {scs.SIGINT}")
assert raw["info"]["status_val"] == scs.SIGINT
PYTHON
