"""What flies while the response is looked for: fixed slow feedback, and the lag that it bears."""

from __future__ import annotations

import cmath
import math
from pathlib import Path

import pytest

from companion.config import Config, load_config
from companion.config.mission.identifying import LINK_DELAY_S, as_flown, bearable_lag_s, in_a_line
from companion.flight.guards.measures import longest_delay_s

CONFIG = Path(__file__).resolve().parents[3] / "config"
IDENTIFY = "mission={identification: {}}"


def loaded(name: str = "px4_quadrotor", *overrides: str) -> Config:
    return load_config(CONFIG / f"{name}.yaml", overrides)


def test_a_mission_is_flown_as_it_stands() -> None:
    config = loaded()
    assert as_flown(config) is config


def test_weights_do_not_adapt_and_the_estimate_is_corrected() -> None:
    config = loaded(
        "px4_quadrotor", IDENTIFY, "controller.hedging=false", "controller.axes.x.natural_frequency_rad_s=2.4"
    )
    flown = as_flown(config).controller
    for axis in (flown.axes.x, flown.axes.y):
        assert axis is not None
        assert (axis.natural_frequency_rad_s, axis.adaptation_rate.hedged) == (1.5, 0.0)
    assert flown.hedging
    assert flown.initial_weights == "nominal"
    assert flown.estimate_correction is not None
    assert flown.bias is not None
    assert config.controller.bias is not None
    assert flown.bias.bound == config.controller.bias.bound
    assert as_flown(as_flown(config)) == as_flown(config)


def test_a_rig_stays_one_and_a_slower_config_stays_slower() -> None:
    flown = as_flown(loaded("antx_rig", IDENTIFY, "controller.axes.x.natural_frequency_rad_s=1.2"))
    assert flown.controller.axes.x.natural_frequency_rad_s == 1.2
    assert flown.controller.axes.y is None
    assert flown.controller.bias is None
    assert flown.controller.estimate_correction is None
    assert Config.model_validate(flown.model_dump()) == flown, "what is left in the flight folder can be loaded"


@pytest.mark.parametrize(("wn", "bears_s"), [(1.5, 0.49), (1.0, 0.74)])
def test_the_lag_it_bears_brings_the_loop_to_minus_one(wn: float, bears_s: float) -> None:
    axis = as_flown(loaded("px4_quadrotor", IDENTIFY)).controller.axes.x
    axis = axis.model_copy(update={"natural_frequency_rad_s": wn})
    lag_s = bearable_lag_s(axis)
    assert lag_s == pytest.approx(bears_s, abs=0.01)
    zeta = axis.damping_ratio
    s = 1j * wn * math.sqrt(2 * zeta**2 + math.sqrt(4 * zeta**4 + 1))
    loop = (wn**2 + 2 * zeta * wn * s) / s**2 * cmath.exp(-lag_s * s)
    assert loop == pytest.approx(-1.0, abs=1e-9)


def test_one_line_says_what_and_why() -> None:
    line = in_a_line(as_flown(loaded("px4_quadrotor", IDENTIFY)))
    assert "\n" not in line
    assert "1.5 rad/s" in line
    assert "0.49 s" in line


def test_the_link_is_watched_by_what_that_loop_bears_and_by_what_the_config_says() -> None:
    assert longest_delay_s(loaded("px4_quadrotor", IDENTIFY)) == LINK_DELAY_S
    assert longest_delay_s(loaded("px4_quadrotor", IDENTIFY, "guards.link_delay_s.limit=0.04")) == 0.04
    assert longest_delay_s(loaded()) == pytest.approx(0.025)
