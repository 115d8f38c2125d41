"""Identification flights with an estimate as wrong as each preset has it: do they end, and is the response the plant's?

    python benchmarks/identification_presets.py [SEEDS] [--jobs N] [--preset NAME] [--set KEY=VALUE]

Flown in lockstep, from Hold in the air; plant and companion are one program.
"""

from __future__ import annotations

import argparse
import tempfile
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from rich.console import Console
from rich.table import Table

from companion.config import load_config
from companion.config.estimator import PRESETS
from companion.errors import CompanionError
from companion.identify.identification import identify_log
from sitl.experiment.against import fly_against

CONFIG = Path(__file__).resolve().parents[1] / "config" / "px4_quadrotor.yaml"


def fly(preset: str, seed: int, settings: tuple[str, ...]) -> tuple[str, float]:
    """(why it ended, the largest share by which a natural frequency is off; 1 where nothing was identified)."""
    sensors = f"plant.sensors={{preset: {preset}}}"
    config = load_config(CONFIG, ("mission={identification: {}}", f"plant.seed={seed}", sensors, *settings))
    assert config.plant is not None
    assert config.plant.quadrotor is not None
    with tempfile.TemporaryDirectory() as folder:
        flown = fly_against(config, CONFIG, Path(folder), "hedged")
        try:
            axes = identify_log([Path(folder)]).axes
        except CompanionError:
            return flown.reason, 1.0
    off = 0.0
    for angle, plant in (("roll", config.plant.quadrotor.roll), ("pitch", config.plant.quadrotor.pitch)):
        assert plant is not None
        assert plant.natural_frequency_rad_s is not None
        if angle not in axes:
            return flown.reason, 1.0
        found = axes[angle].models["second_order_delay"].named()["natural_frequency_rad_s"]
        off = max(off, abs(found / plant.natural_frequency_rad_s - 1.0))
    return flown.reason, off


def main() -> None:
    parser = argparse.ArgumentParser(description="Identification flights with each preset of the estimator.")
    parser.add_argument("seeds", type=int, nargs="?", default=10)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--preset", choices=list(PRESETS), action="append")
    parser.add_argument("--set", dest="settings", action="append", default=[])
    arguments = parser.parse_args()
    table = Table(title=f"{arguments.seeds} identification flights each {' '.join(arguments.settings)}")
    for column in ("preset", "completed", "within 10 %", "worst", "otherwise"):
        table.add_column(column)
    with ProcessPoolExecutor(arguments.jobs) as pool:
        for preset in arguments.preset or PRESETS:
            jobs = [pool.submit(fly, preset, seed, tuple(arguments.settings)) for seed in range(1, arguments.seeds + 1)]
            flown = [job.result() for job in jobs]
            complete = [off for reason, off in flown if reason == "mission_complete"]
            others = sorted({reason for reason, _ in flown} - {"mission_complete"})
            good = sum(off < 0.1 for off in complete)
            worst = f"{max(complete, default=1.0):.2%}"
            table.add_row(preset, str(len(complete)), str(good), worst, ", ".join(others))
    Console().print(table)


if __name__ == "__main__":
    main()
