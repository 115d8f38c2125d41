"""Identification flights in the served plant, over its sockets: truth inside the interval, and bias.

    python benchmarks/identification_flight.py [RUNS] [--jobs N]

Every run draws a vehicle, its delays, its noise and a link: even seeds a quadrotor in wind (roll and pitch, second
order), odd ones the rig with its guide friction (pitch, first order). `companion sitl --identify` flies it,
`companion identify` reads the folder it leaves. The truth of the delay is the vehicle's, the estimator's and the link's
both ways, with the mean of its jitter.
"""

from __future__ import annotations

import argparse
import json
import random
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table

CONFIG = Path(__file__).resolve().parents[1] / "config"


class Vehicle(NamedTuple):
    """What is flown, and what is true of it: the model's name, and per axis its parameters in the model's order."""

    config: str
    settings: tuple[str, ...]
    model: str
    truth: dict[str, dict[str, float]]


def drawn(seed: int) -> Vehicle:
    """A vehicle whose delays are whole milliseconds, the plant's step."""
    chance = random.Random(seed)
    vehicle_s, estimator_s, down_s, up_s = (1e-3 * chance.randint(*ms) for ms in ((10, 40), (0, 8), (1, 10), (1, 10)))
    jitter_s = 1e-3 * chance.randint(0, 3)
    # Of what arrives within a step of the plant, 1 ms, the step knows from its beginning: half a step less each way.
    delay_s = vehicle_s + estimator_s + down_s + up_s + max(jitter_s - 1e-3, 0.0)
    noise = f"position_m: 0.01, velocity_m_s: 0.02, attitude_deg: {chance.uniform(0.05, 0.3):.3f}"
    link = f"delay_s: {{}}, jitter_s: {jitter_s}, loss: {chance.uniform(0.0, 0.01):.4f}"
    common = (
        f"plant.seed={seed}",
        f"plant.sensors={{{noise}, delay_s: {estimator_s}}}",
        f"plant.link={{down: {{{link.format(down_s)}}}, up: {{{link.format(up_s)}}}}}",
        f"plant.setpoint_delay_s={vehicle_s}",
        "guards.link_delay_s.enabled=false",  # here the link is what is asked about
    )
    if seed % 2:
        bandwidth = round(chance.uniform(2.8, 6.0), 2)
        return Vehicle(
            "antx_rig.yaml",
            (
                *common,
                f"plant.rig.pitch.bandwidth_rad_s={bandwidth}",
                "mission.identification.amplitude_deg=6",
                "tick.rate_hz=250",
                "tick.floor_hz=125",
            ),
            "first_order_delay",
            {"pitch": {"bandwidth_rad_s": bandwidth, "delay_s": delay_s}},
        )
    axes, truth = [], {}
    for angle in ("roll", "pitch"):
        frequency, damping = round(chance.uniform(8.0, 13.0), 2), round(chance.uniform(0.8, 1.2), 2)
        axes += [f"plant.quadrotor.{angle}={{natural_frequency_rad_s: {frequency}, damping_ratio: {damping}}}"]
        truth[angle] = {"natural_frequency_rad_s": frequency, "damping_ratio": damping, "delay_s": delay_s}
    wind = f"plant.wind={{mean_ned_m_s: [{chance.uniform(-2, 2):.2f}, {chance.uniform(-2, 2):.2f}, 0]}}"
    return Vehicle("px4_quadrotor.yaml", (*common, *axes, wind), "second_order_delay", truth)


def flown(seed: int) -> tuple[Vehicle, dict[str, Any] | str]:
    """What `companion identify` prints of the flight; or why there is nothing to print, in one line."""
    vehicle = drawn(seed)
    settings = [part for text in vehicle.settings for part in ("--set", text)]
    companion = [sys.executable, "-m", "companion"]
    with tempfile.TemporaryDirectory() as folder:
        flight = [*companion, "sitl", str(CONFIG / vehicle.config), "--identify", "--out", folder, "--json", *settings]
        for command in (flight, [*companion, "identify", f"{folder}/hedged", "--json"]):
            ended = subprocess.run(command, capture_output=True, text=True, check=False)
            if ended.returncode:
                return vehicle, f"{ended.stderr.strip().splitlines()[-1] if ended.stderr.strip() else ended.stdout}"
        axes: dict[str, Any] = json.loads(ended.stdout)["axes"]
        return vehicle, axes


class Found(NamedTuple):
    """One parameter of one axis: found over true, and whether its interval holds the truth; None for a wrong model."""

    model: str
    name: str
    ratio: float
    inside: bool | None


def compared(truth: dict[str, float], model: str, axis: dict[str, Any]) -> list[Found]:
    """An axis beside the truth about it."""
    values, right = axis["models"][model], axis["chosen"] == model
    intervals = axis["interval_95"] if right else {}
    return [
        Found(model, name, values[name] / value, intervals[name][0] <= value <= intervals[name][1] if right else None)
        for name, value in truth.items()
    ]


def table(found: list[Found], title: str) -> Table:
    """By parameter: how often inside, bias and spread."""
    shown = Table(title=title)
    for column in ("model", "parameter", "axes", "inside", "bias", "spread"):
        shown.add_column(column, justify="left" if column in ("model", "parameter") else "right")
    for model, name in dict.fromkeys((f.model, f.name) for f in found):
        of = [f for f in found if (f.model, f.name) == (model, name)]
        ratios = [f.ratio for f in of]
        inside = sum(f.inside is True for f in of)
        shown.add_row(model, name, str(len(of)), str(inside), f"{np.mean(ratios) - 1:+.2%}", f"{np.std(ratios):.2%}")
    return shown


def main() -> None:
    parser = argparse.ArgumentParser(description="Identification of known vehicles that fly in the plant.")
    parser.add_argument("runs", type=int, nargs="?", default=100)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--first-seed", type=int, default=1)
    arguments = parser.parse_args()
    seeds = range(arguments.first_seed, arguments.first_seed + arguments.runs)
    runs: list[list[list[Found]]] = []  # by run and axis
    console = Console()
    with ThreadPoolExecutor(arguments.jobs) as pool:
        for seed, (vehicle, axes) in zip(seeds, pool.map(flown, seeds), strict=True):
            if isinstance(axes, str):
                console.print(f"seed {seed}: {axes}", markup=False)
                continue
            runs.append([compared(truth, vehicle.model, axes[angle]) for angle, truth in vehicle.truth.items()])
            missed = [f"{f.name}, {f.ratio:.3f} of the truth" for axis in runs[-1] for f in axis if not f.inside]
            if missed:
                console.print(f"seed {seed}: not inside: {'; '.join(missed)}", markup=False)
    flown_axes = [axis for run in runs for axis in run]
    console.print(table([f for axis in flown_axes for f in axis], f"{arguments.runs} flights in the served plant"))
    good = [all(f.inside for f in axis) for axis in flown_axes]
    whole = sum(all(f.inside for axis in run for f in axis) for run in runs)
    right = sum(axis[0].inside is not None for axis in flown_axes)
    console.print(
        f"all of an axis inside, of which the interval says 95 %: {sum(good)} of {len(good)}; "
        f"all of a run, one axis or two: {whole} of {arguments.runs}; "
        f"model right: {right} of {len(good)} axes; not flown or not read: {arguments.runs - len(runs)}"
    )


if __name__ == "__main__":
    main()
