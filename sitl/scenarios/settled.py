"""A world in the air, Hold settled, from which most scenarios begin: flown once in a process, and copied after that."""

from __future__ import annotations

import pickle
from typing import Final

from companion.config import Config
from sitl.build import World, build_world

ALTITUDE_M: Final = 5.0
SETTLE_S: Final = 8.0  # of Hold, before anybody is there

_flown: dict[str, bytes] = {}


def settled_world(config: Config) -> World:
    """A complete world of a config, hovering in Hold, armed. Raises as `build_world` does."""
    assert config.plant is not None  # every scenario's config has one
    key = f"{config.vehicle.model_dump_json()} {config.plant.model_dump_json()}"  # all that a world is built from
    if key not in _flown:
        world = build_world(config, complete=True)
        world.autopilot.start_in_air(ALTITUDE_M, SETTLE_S)
        _flown[key] = pickle.dumps(world)
    copy: World = pickle.loads(_flown[key])
    return copy
