"""The vehicle that flew: its system id and its axes, as far as anything tells them."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from companion.config import Config
from companion.config.numbers import NOT_YAML, read_yaml
from companion.config.vehicles import VEHICLE_KINDS
from companion.identify.series import AXES


class FlownVehicle(NamedTuple):
    """Whose log it is."""

    system_id: int | None  # None: nothing tells it
    axes: tuple[str, ...]  # that it has: `roll`, `pitch`


def vehicle_of(logs: Iterable[Path], config: Config | None) -> FlownVehicle:
    """By the config; without one by the config in the first flight folder that has a readable one."""
    if config is not None:
        return FlownVehicle(config.vehicle.system_id, config.vehicle_kind.angles)
    for log in logs:
        flown = log / "config.yaml"
        if flown.is_file():
            try:
                vehicle = read_yaml(flown.read_text(encoding="utf-8"))["vehicle"]
                return FlownVehicle(int(vehicle.get("system_id", 1)), VEHICLE_KINDS[vehicle["kind"]].angles)
            except (OSError, KeyError, *NOT_YAML):
                continue
    return FlownVehicle(None, AXES)
