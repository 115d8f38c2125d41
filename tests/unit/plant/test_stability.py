"""What is called unstable: an error that grows, wherever the stairs are."""

from pathlib import Path

import numpy as np
import pytest

from companion.config import Config, load_config
from companion.record.reader import Flight, tick_dtype
from sitl.metrics import score

ROOT = Path(__file__).resolve().parents[3]
STEP_M = 0.3
RATE_HZ = 50


def config(*overrides: str) -> Config:
    return load_config(ROOT / "config" / "antx_rig.yaml", (f"mission.waypoints=[{waypoints()}]", *overrides))


def waypoints(times_s: tuple[float, ...] = (2.0, 9.0)) -> str:
    return ", ".join(f"{{at_s: {t}, offset_ned_m: [{STEP_M * (n % 2 == 0)}, 0, 0]}}" for n, t in enumerate(times_s))


def flight(duration_s: float, stairs_s: tuple[float, ...], growth_1_s: float, step_m: float = STEP_M) -> Flight:
    """Each stair makes an error of 30 % that swings and grows or decays so fast; what is left of it stays."""
    time_s = np.arange(0.0, duration_s, 1.0 / RATE_HZ)
    error, target = np.zeros_like(time_s), np.zeros_like(time_s)
    for n, at_s in enumerate(stairs_s):
        since_s = time_s - at_s
        after = since_s >= 0.0
        swing = 0.3 * step_m * np.exp(growth_1_s * since_s[after]) * np.sin(2.0 * since_s[after])
        error[after] += np.clip(swing, -1.0, 1.0)
        target[after] = step_m * (n % 2 == 0)
    ticks = np.zeros(len(time_s), tick_dtype())
    ticks["time_s"], ticks["state"] = time_s, 3
    ticks["target_ned_m"][:, 0] = target
    ticks["position_m"][:, 0] = ticks["position_ned_m"][:, 0] = error
    return Flight(ticks, [])


@pytest.mark.parametrize("last_s", [10.0, 20.0, 22.0, 24.0, 24.8])
@pytest.mark.parametrize("growth_1_s", [-2.0, -1.0, -0.5])
def test_what_decays_is_stable_wherever_its_last_stair_is(last_s: float, growth_1_s: float) -> None:
    assert score(config(), flight(25.0, (2.0, 9.0, last_s), growth_1_s)).stable


@pytest.mark.parametrize("last_s", [10.0, 20.0, 24.0])
@pytest.mark.parametrize("growth_1_s", [0.15, 0.3, 1.0])
def test_what_grows_is_not(last_s: float, growth_1_s: float) -> None:
    assert not score(config(), flight(25.0, (2.0, 9.0, last_s), growth_1_s)).stable


@pytest.mark.parametrize(("growth_1_s", "stable"), [(-0.5, True), (0.3, False)])
def test_one_stair_is_enough_to_tell(growth_1_s: float, stable: bool) -> None:
    assert score(config(), flight(12.0, (2.0,), growth_1_s)).stable is stable
    assert score(config(), flight(10.0, (0.0,), growth_1_s)).stable is stable  # from the beginning on


def test_a_larger_stair_makes_a_larger_error_and_no_instability() -> None:
    small, large = flight(30.0, (2.0, 9.0), -0.7, 0.1), flight(30.0, (18.0, 26.0), -0.7, 0.9)
    for name in ("position_m", "position_ned_m", "target_ned_m"):
        small.ticks[name] += large.ticks[name]
    assert score(config(), small).stable


def test_growth_that_noise_or_wind_may_have_made_is_judged_by_its_size() -> None:
    noisy = config("plant.sensors={}")
    assert noisy.plant is not None
    assert noisy.plant.sensors is not None
    assert score(noisy, flight(25.0, (2.0, 9.0), 0.04)).stable
    assert not score(config(), flight(25.0, (2.0, 9.0), 0.04)).stable
    assert not score(noisy, flight(25.0, (2.0, 9.0), 1.0)).stable


def test_below_five_centimetres_nothing_is_judged() -> None:
    assert score(config(), flight(25.0, (2.0, 9.0), 0.05, 0.01)).stable
