"""Three short flights in the plant, flown once for all tests of the report."""

from __future__ import annotations

from pathlib import Path

import pytest

from sitl.scenarios.campaign import fly_all
from sitl.scenarios.flight import Bases
from sitl.scenarios.scenario import QUADROTOR, RIG

CONFIG = Path(__file__).resolve().parents[3] / "config"


@pytest.fixture(scope="session")
def flights(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Flight folders by the name of their scenario: a pilot takes over, GPS is lost, the attitude goes astray."""
    names = ["pilot_hold", "gps_lost", "tilt_error"]
    parent = tmp_path_factory.mktemp("flights")
    bases = Bases({QUADROTOR: CONFIG / QUADROTOR, RIG: CONFIG / RIG}, ())
    fly_all(names, bases, parent, lambda _: None, 1)
    return {name: parent / name for name in names}
