"""What a kind of vehicle says is what schema, plant and companion take it for."""

from pathlib import Path
from typing import get_args

import pytest

from companion.config import load_config
from companion.config.vehicles import VEHICLE_KINDS, VehicleName, VehiclePlants
from companion.flight.pilot.controller_params import position_params
from companion.identify.vehicle import vehicle_of
from sitl.build import BUILDERS, build_vehicle

CONFIGS = sorted((Path(__file__).resolve().parents[2] / "config").glob("*.yaml"))


def test_a_kind_has_a_name_a_section_and_physics() -> None:
    assert get_args(VehicleName) == tuple(VEHICLE_KINDS) == tuple(BUILDERS) == tuple(VehiclePlants.model_fields)
    assert all(kind.name == name for name, kind in VEHICLE_KINDS.items())
    assert {kind.axes for kind in VEHICLE_KINDS.values()} <= {("x",), ("x", "y")}


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.stem)
def test_the_shipped_vehicles_are_what_their_kind_says(path: Path) -> None:
    config = load_config(path)
    kind = config.vehicle_kind
    assert config.plant is not None
    assert config.plant.kind is kind
    assert build_vehicle(config).can_fly is kind.can_fly
    assert position_params(config, hedging=True).one_axis is kind.one_axis
    assert vehicle_of((), config).axes == kind.angles == (("pitch",) if kind.one_axis else ("roll", "pitch"))
