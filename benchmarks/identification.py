"""How good the identification is: truth inside the interval, bias and spread, over flights of vehicles that are known.

PYTHONPATH=. python benchmarks/identification.py [RUNS]
"""

from __future__ import annotations

import math
import sys
import time

import harness_path  # noqa: F401 - finds `harness`
import numpy as np
from harness.identify_logs import Known, fly, recording

from companion.attitude_response.kind import LinearResponse
from companion.attitude_response.kinds import FirstOrder, SecondOrder
from companion.identify.identification import identify


def run(runs: int, second_order: bool, manoeuvres: int) -> None:
    inside, right, ratios, began = 0, 0, [], time.perf_counter()
    for seed in range(runs):
        random = np.random.default_rng(5000 + seed)
        up, down, noise = random.uniform(0.005, 0.04), random.uniform(0.002, 0.02), random.uniform(0.05, 0.3)
        if second_order:
            dynamics = (random.uniform(5.0, 14.0), random.uniform(0.6, 1.3))
            response = LinearResponse(SecondOrder, dynamics)
        else:
            dynamics = (random.uniform(3.0, 10.0),)
            response = LinearResponse(FirstOrder, dynamics)
        known = Known(response, up, down, math.radians(noise))
        rates = random.choice([50.0, 100.0, 250.0]), random.choice([50.0, 125.0])
        axis = identify([recording(fly(known, seed, *rates, manoeuvres=manoeuvres))]).axes["pitch"]
        truth = np.array([*dynamics, up + down])
        model = axis.models["second_order_delay" if second_order else "first_order_delay"]
        right += axis.chosen is model
        inside += all(low <= v <= high for v, (low, high) in zip(truth, model.interval_95, strict=True))
        ratios.append(np.array(model.values) / truth)
    names = " ".join(
        f"{n} {b:+.2%} ± {s:.2%}"
        for n, b, s in zip(model.model.parameters, np.mean(ratios, axis=0) - 1.0, np.std(ratios, axis=0), strict=True)
    )
    each = (time.perf_counter() - began) / runs
    print(
        f"{model.model.title}, {manoeuvres} manoeuvres: model right {right}/{runs}, all inside {inside}/{runs}; "
        f"bias and spread {names}; {each:.2f} s each"
    )


if __name__ == "__main__":
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    for order in (False, True):
        for number in (3, 4, 6):
            run(count, order, number)
