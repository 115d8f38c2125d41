"""Identification from flights that nobody made for it: truth inside the box, refusals, bias and spread.

    python benchmarks/identification_any_flight.py [--flights N] [--kind stabilized|position|mission] [--jobs N]
    python benchmarks/identification_any_flight.py --compare [--flights N] [--kind ...] [--ratio R]

Flown in the plant, in memory (`tests/harness/any_flight.py`). Each flight draws a vehicle, wind, noise, a torque
disturbance and a logging profile. A flight counts as inside where all three parameters of both axes are within the
95 % boxes. Where a log keeps set-points seldom, the truth of the delay includes half the plant's control step, for
which a set-point stands.

`--compare` flies pairs: equal vehicles, and vehicles of which the second has `--ratio` times the bandwidth. An axis is
told right where the verdict is the truth.
"""

from __future__ import annotations

import argparse
import time
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from random import Random
from typing import NamedTuple

import harness_path  # noqa: F401 - finds `harness`
import numpy as np
from harness.any_flight import CONTROL_S, DURATION_S, KINDS, Truth, drawn, fly

from companion.identify.comparison.compare import EQUAL, FASTER, SLOWER, compare
from companion.identify.identification import PREDICTION, AxisIdentification, Identification, identify
from companion.identify.series import LogError

MODEL = "second_order_delay"


class Found(NamedTuple):
    """One flight: by axis what was found over the truth and whether the box holds it; or why not."""

    seed: int
    ratios: dict[str, np.ndarray]
    inside: dict[str, bool]
    refused: dict[str, str]
    by_prediction: int
    seconds: tuple[float, float]


def truth_of(truth: Truth, lateness_s: float, method: str) -> np.ndarray:
    """Natural frequency, damping, delay as the log shows it."""
    curve = method == PREDICTION and lateness_s > 1.5 * CONTROL_S
    return np.array([*truth[:2], truth.delay_s + (CONTROL_S / 2.0 if curve else 0.0)])


def one(kind: str, duration_s: float, seed: int) -> Found:
    began = time.process_time()
    flight = fly(kind, seed, duration_s)
    flown = time.process_time()
    axes: dict[str, AxisIdentification] = {}
    try:
        found = identify([flight.recording])
        axes, refused = found.axes, dict(found.refused)
    except LogError as error:
        refused = {axis: str(error) for axis in flight.truth}
    ratios, inside = {}, {}
    for name, axis in axes.items():
        truth = truth_of(flight.truth[name], flight.recording.lateness_s, axis.method)
        model = axis.models[MODEL]
        ratios[name] = np.array(model.values) / truth
        inside[name] = axis.chosen is model and all(
            low <= v <= high for v, (low, high) in zip(truth, model.interval_95, strict=True)
        )
    by_prediction = sum(axis.method == PREDICTION for axis in axes.values())
    return Found(seed, ratios, inside, refused, by_prediction, (flown - began, time.process_time() - flown))


def report(kind: str, found: list[Found]) -> None:
    for f in found:
        for axis, held in f.inside.items():
            if not held:
                print(f"  seed {f.seed}, {axis}: outside, or another model; over the truth {f.ratios[axis].round(3)}")
        for axis, why in f.refused.items():
            print(f"  seed {f.seed}, {axis}: {why}")
    axes = [held for f in found for held in f.inside.values()]
    whole = sum(all(f.inside.values()) and not f.refused for f in found)
    wrong = sum(not all(f.inside.values()) for f in found)
    ratios = np.array([r for f in found for r in f.ratios.values()])
    flown_s, taken_s = np.mean([f.seconds for f in found], axis=0)
    print(
        f"{kind}: both axes inside in {whole} of {len(found)} flights, an axis outside in {wrong}, an axis refused in "
        f"{sum(bool(f.refused) for f in found)}; axes inside {sum(axes)} of {len(axes)}, "
        f"{sum(f.by_prediction for f in found)} by prediction error; {flown_s:.2f} s a flight, "
        f"{taken_s:.2f} s to identify"
    )
    if len(ratios):
        print(
            "  bias and spread of frequency, damping, delay: "
            + ", ".join(f"{m:+.1%} ± {s:.1%}" for m, s in zip(ratios.mean(0) - 1.0, ratios.std(0), strict=True))
        )


def _identified(kind: str, seed: int, duration_s: float, truth: dict[str, Truth]) -> Identification | str:
    try:
        return identify([fly(kind, seed, duration_s, truth).recording])
    except LogError as error:
        return str(error)


def pair(kind: str, duration_s: float, ratio: float, seed: int) -> tuple[list[str], list[str]] | str:
    """Verdicts by axis of a pair of equal vehicles, and of one whose second is `ratio` times as fast."""
    truth = drawn(Random(f"pair {seed}"))
    faster = {axis: t._replace(natural_frequency_rad_s=ratio * t.natural_frequency_rad_s) for axis, t in truth.items()}
    flights = ((10_000 + seed, truth), (20_000 + seed, truth), (30_000 + seed, faster))
    found = [_identified(kind, number, duration_s, vehicle) for number, vehicle in flights]
    verdicts = []
    for other in found[1:]:
        if isinstance(found[0], str) or isinstance(other, str):
            return next(f for f in found if isinstance(f, str))
        try:
            verdicts.append([axis.verdict for axis in compare(found[0], other).axes.values()])
        except LogError as error:
            return str(error)
    return verdicts[0], verdicts[1]


def report_pairs(kind: str, ratio: float, found: list[tuple[list[str], list[str]] | str]) -> None:
    pairs = [f for f in found if not isinstance(f, str)]
    different = sum(any(v != EQUAL for v in same) for same, _ in pairs)
    changed = [v for _, other in pairs for v in other]
    right = FASTER if ratio > 1.0 else SLOWER
    told = sum(all(v == right for v in other) for _, other in pairs)
    print(
        f"{kind}: of {len(pairs)} pairs of equal vehicles {different} called different; {ratio:g} times the bandwidth "
        f"told in both axes of {told} pairs, in {changed.count(right)} of {len(changed)} axes; "
        f"{len(found) - len(pairs)} pairs not identified"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description="Identification from any flight.")
    parser.add_argument("--flights", type=int, default=100)
    parser.add_argument("--kind", choices=KINDS, action="append")
    parser.add_argument("--compare", action="store_true")
    parser.add_argument("--ratio", type=float, default=1.2)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--duration", type=float, help="seconds; by default as long as the kind needs")
    arguments = parser.parse_args()
    seeds = range(arguments.first_seed, arguments.first_seed + arguments.flights)
    with ProcessPoolExecutor(arguments.jobs) as pool:
        for kind in arguments.kind or KINDS:
            duration_s = arguments.duration or DURATION_S[kind]
            if arguments.compare:
                made = pool.map(partial(pair, kind, duration_s, arguments.ratio), seeds)
                report_pairs(kind, arguments.ratio, list(made))
                continue
            report(kind, list(pool.map(partial(one, kind, duration_s), seeds)))


if __name__ == "__main__":
    main()
