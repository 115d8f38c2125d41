"""Deaths at random moments, none outside the bound: a few of those that `benchmarks/dying_companion.py` flies."""

import importlib.util
import sys
from pathlib import Path

from companion.certify import link_loss
from companion.config import load_config

ROOT = Path(__file__).resolve().parents[3]


def test_no_death_is_outside_the_bound() -> None:
    path = ROOT / "benchmarks" / "dying_companion.py"
    spec = importlib.util.spec_from_file_location("dying_companion", path)
    assert spec is not None
    assert spec.loader is not None
    benchmark = importlib.util.module_from_spec(spec)
    sys.modules["dying_companion"] = benchmark
    spec.loader.exec_module(benchmark)
    config = load_config(ROOT / "config" / "px4_quadrotor.yaml")
    bound = link_loss.worst(config, 1.0)
    worst = benchmark.fly_some(config, 1.1, [f"test {k}" for k in range(20)])
    assert worst.counted > 50
    assert 0.8 * bound.tilt_rad < worst.tilt_rad <= bound.tilt_rad
    assert 0.4 * bound.distance_m < worst.distance_m <= bound.distance_m
    assert 0.3 * bound.height_lost_m < worst.height_lost_m <= bound.height_lost_m
