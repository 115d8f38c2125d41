#!/usr/bin/env bash
# Clarabel calls a termination callback once an iteration. What the callback raises, KeyboardInterrupt too, is printed and
# dropped: the solver goes on to the end. So Ctrl-C that arrives in the callback is lost. What ends a solve is the
# callback's return value.
set -euo pipefail
work=$(mktemp -d); trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install -q clarabel==0.11.1 numpy==2.4.6 scipy==1.17.1
"$work/venv/bin/python" - <<'PYTHON' 2>"$work/stderr"
import clarabel
import numpy as np
from scipy import sparse

settings = clarabel.DefaultSettings()
settings.verbose = False
problem = (sparse.csc_matrix(np.eye(2)), np.ones(2), sparse.csc_matrix(-np.eye(2)), np.zeros(2))


def solve(callback):
    solver = clarabel.DefaultSolver(*problem, [clarabel.NonnegativeConeT(2)], settings)
    solver.set_termination_callback(callback)
    return str(solver.solve().status)


calls = []


def interrupted(info):
    calls.append(info)
    raise KeyboardInterrupt


status = solve(interrupted)
print(f"clarabel {clarabel.__version__}: callback raised KeyboardInterrupt {len(calls)} times, solve() returned {status}")
assert status == "Solved", status
assert len(calls) > 1, "the first exception ended it"
ended = solve(lambda info: True)
print(f"a callback that returns True: solve() returned {ended}")
assert ended != "Solved", ended
PYTHON
grep -c KeyboardInterrupt "$work/stderr" | sed 's/$/ lines on standard error name KeyboardInterrupt/'
