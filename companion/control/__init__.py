"""The paper's controller as pure steps over flat records: no clock, no I/O, no arrays.

`step(params, state, inputs, dt) -> (state, output)` everywhere. The same source runs in CPython and under `numba.njit`.
"""
