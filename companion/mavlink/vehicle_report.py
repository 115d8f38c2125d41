"""What a vehicle tells a tool of itself: firmware, health, parameters, and how often its odometry comes."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Final, NamedTuple

from pymavlink.dialects.v20 import development as mavlink

from companion.mavlink.client import Client
from companion.mavlink.services import Firmware, Services

_INSTANCES: Final = range(3)  # of MAVLink, as MAV_0_MODE; PX4 in simulation has them too, and does not use them
_ONBOARD: Final = 2  # MAV_*_MODE


class VehicleReport(NamedTuple):
    """The vehicle's answers.

    Attributes: `health` good or not, by name; `parameters` those asked for that the vehicle has; `odometry_hz` the rate
    at which ODOMETRY came unasked, None where the process that shares its link keeps it to itself.
    """

    firmware: Firmware
    health: dict[str, bool]
    parameters: dict[str, int | float]
    odometry_hz: float | None


Kinds = Callable[[tuple[int, int, int]], Mapping[str, type | None]]


def read_vehicle(client: Client, kinds: Kinds) -> VehicleReport:
    """Ask a connected vehicle; `kinds`: from version to the parameters wanted, and their types. Raises `LinkError`."""
    began_s, odometry = time.monotonic(), client.heard[mavlink.MAVLINK_MSG_ID_ODOMETRY]
    with Services(client) as services:
        firmware = services.firmware()
        health = services.health()
        found = services.parameters(kinds(firmware.version)) | _link_rates(services)
    seconds = time.monotonic() - began_s
    count = client.heard[mavlink.MAVLINK_MSG_ID_ODOMETRY] - odometry
    return VehicleReport(firmware, health, found, None if client.shared else count / seconds)


def _link_rates(services: Services) -> dict[str, int | float]:
    """The byte rates of the onboard instances, where the vehicle has any."""
    onboard = []
    for instance in _INSTANCES:
        mode = services.parameters({f"MAV_{instance}_MODE": int})
        if not mode:  # one that has no such instance has no later one: one silence is enough to wait for
            break
        if _ONBOARD in mode.values():
            onboard.append(f"MAV_{instance}_RATE")
    return services.parameters(dict.fromkeys(onboard, int))
