#!/usr/bin/env bash
# In Python float(numpy.float32(x)) is a double. Compiled by numba it stays a float32, and what is computed from such values
# is rounded to 24 bits: a simulation that rounds to a wire's float32 and goes on in doubles differs from itself
# uncompiled, in the eighth digit and without a word. numpy.float64(...) widens in both.
set -euo pipefail
work=$(mktemp -d); trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install -q numba==0.68.1 numpy==2.4.6
"$work/venv/bin/python" - <<'PYTHON'
import numba
import numpy as np


def by_float(x, y):
    return float(np.float32(x)) * float(np.float32(y))


def by_float64(x, y):
    return np.float64(np.float32(x)) * np.float64(np.float32(y))


print("numba", numba.__version__, "numpy", np.__version__)
found = {}
for function in (by_float, by_float64):
    compiled = numba.njit(function)
    plain, quick = float(function(0.1, 0.3)), float(compiled(0.1, 0.3))
    result = compiled.nopython_signatures[0].return_type
    found[function.__name__] = (plain == quick, str(result))
    print(f"{function.__name__}: Python {plain!r}, compiled {quick!r}, compiled type {result}")
assert found == {"by_float": (False, "float32"), "by_float64": (True, "float64")}, found
PYTHON
