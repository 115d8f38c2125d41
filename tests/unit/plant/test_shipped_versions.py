"""The shipped configs of PX4 v1.17 and v1.18: each states its version; its plant answers as the real one did."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Final

import numpy as np
import pytest

from companion.config import load_config
from companion.config.attitude import certified_delay_s
from companion.flight.readiness.parameters import response_parameters
from sitl.autopilot.modes import FlightMode
from sitl.autopilot.parameters import PX4_DEFAULTS, Px4Version
from sitl.build import build_world
from sitl.vehicles.rotation import euler, quaternion

CONFIG: Final = Path(__file__).resolve().parents[3] / "config"
SHIPPED: Final = {"1.17": CONFIG / "px4_quadrotor.yaml", "1.18": CONFIG / "px4_quadrotor_1_18.yaml"}
BOTH: Final = pytest.mark.parametrize("version", SHIPPED)
IDENTIFIED: Final = {  # on a real PX4 in SITL with default parameters: rad/s, [1], s
    "1.18": {"roll": (9.1, 0.92, 0.077), "pitch": (9.3, 0.92, 0.082)},
}
LINK_S: Final = 0.004  # of a period of the tick, which identification in the plant finds beside the plant's own delay


@BOTH
def test_each_states_its_version_and_all_that_the_response_is_made_of(version: str) -> None:
    config = load_config(SHIPPED[version])
    assert config.plant is not None
    assert config.vehicle.px4_version == config.plant.px4_version == version
    minor = int(version.split(".")[1])
    defaults = PX4_DEFAULTS[Px4Version(version)]
    stated = config.vehicle.parameters
    assert stated == {name: float(defaults[name]) for name in response_parameters((1, minor, 0))}


def test_the_reference_of_v1_18_is_slower_and_its_box_later() -> None:
    old, new = (load_config(path) for path in SHIPPED.values())
    assert new.controller.axes.x.natural_frequency_rad_s < old.controller.axes.x.natural_frequency_rad_s
    assert certified_delay_s(new.attitude) > certified_delay_s(old.attitude) + 0.035


@pytest.mark.parametrize("angle", ["roll", "pitch"])
def test_the_plant_of_v1_18_answers_as_the_real_one_did(angle: str) -> None:
    """A step of 8 degrees in Hold's place, against the identified response's exact step."""
    frequency, damping, delay_s = IDENTIFIED["1.18"][angle]
    pilot = build_world(load_config(SHIPPED["1.18"])).autopilot
    pilot.start_in_air(5.0)
    step_rad, period_us = math.radians(8.0), 4_000
    wanted = quaternion(*((step_rad, 0.0, 0.0) if angle == "roll" else (0.0, step_rad, 0.0)))
    level, hover = (1.0, 0.0, 0.0, 0.0), pilot.vehicle.hover_thrust
    pilot.on_attitude_target(level, hover)
    pilot.commander.request(FlightMode.OFFBOARD, pilot.time_us)
    for _ in range(250):
        pilot.on_attitude_target(level, hover)
        pilot.advance(pilot.time_us + period_us)
    answers = []
    for _ in range(250):
        pilot.on_attitude_target(wanted, hover)
        pilot.advance(pilot.time_us + period_us)
        answers.append(euler(*pilot.truth().q_wxyz)[0 if angle == "roll" else 1])
    time_s = 4e-3 * np.arange(1, 251) - (delay_s - LINK_S)
    damped = frequency * math.sqrt(1.0 - damping**2)
    decay = np.exp(-damping * frequency * time_s) * (
        np.cos(damped * time_s) + damping * frequency / damped * np.sin(damped * time_s)
    )
    expected = step_rad * np.where(time_s > 0.0, 1.0 - decay, 0.0)
    assert np.max(np.abs(expected - answers)) < 0.03 * step_rad
