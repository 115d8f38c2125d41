"""What a vehicle tells a tool of itself: firmware, health, parameters, and how often its odometry comes."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable
from typing import Final, NamedTuple

from pymavlink.dialects.v20 import development as mavlink

from companion.mavlink import px4
from companion.mavlink.client import Client
from companion.mavlink.codec import decode_cold
from companion.mavlink.services import Firmware, Services

_INSTANCES: Final = range(3)  # of MAVLink, as MAV_0_MODE; PX4 in simulation has them too, and does not use them
_ONBOARD: Final = 2  # MAV_*_MODE
_AT_ONCE: Final = 16  # questions under way: what a slow serial line bears
_ASK_AGAIN_S: Final = 0.4
_TRIES: Final = 3


class VehicleReport(NamedTuple):
    """The vehicle's answers.

    Attributes: `health` good or not, by name; `parameters` those asked for that the vehicle has; `odometry_hz` the rate
    at which ODOMETRY came unasked, None where the process that shares its link keeps it to itself.
    """

    firmware: Firmware
    health: dict[str, bool]
    parameters: dict[str, int | float]
    odometry_hz: float | None


def read_vehicle(client: Client, wanted: Callable[[tuple[int, int, int]], Iterable[str]]) -> VehicleReport:
    """Ask a connected vehicle; `wanted`: from version to the names of the parameters to read. Raises `LinkError`."""
    began_s, odometry = time.monotonic(), client.heard[mavlink.MAVLINK_MSG_ID_ODOMETRY]
    with Services(client) as services:
        firmware = services.firmware()
        health = services.health()
    modes = {f"MAV_{instance}_MODE": f"MAV_{instance}_RATE" for instance in _INSTANCES}
    asked = dict.fromkeys(wanted(firmware.version))
    told = read_parameters(client, [*asked, *modes, *modes.values()])
    onboard = {rate for mode, rate in modes.items() if told.get(mode) == _ONBOARD}
    found = {name: value for name, value in told.items() if name in asked or name in onboard}
    seconds = time.monotonic() - began_s
    count = client.heard[mavlink.MAVLINK_MSG_ID_ODOMETRY] - odometry
    return VehicleReport(firmware, health, found, None if client.shared else count / seconds)


def read_parameters(client: Client, names: Iterable[str]) -> dict[str, int | float]:
    """Parameters by name, in the order asked for; what the vehicle lacks is left out. Raises `LinkError`.

    Asked side by side, each up to three times: those that are lacking cost one silence together.
    """
    wanted = list(dict.fromkeys(names))
    tries = dict.fromkeys(wanted, 0)
    asked_s = dict.fromkeys(wanted, -math.inf)
    found: dict[str, int | float] = {}
    open_ = set(wanted)
    while open_:
        now_s = time.monotonic()
        waiting = [name for name in open_ if now_s - asked_s[name] < _ASK_AGAIN_S]
        open_ -= {name for name in open_ if tries[name] == _TRIES and name not in waiting}
        for name in [name for name in wanted if name in open_ and name not in waiting][: _AT_ONCE - len(waiting)]:
            tries[name], asked_s[name] = tries[name] + 1, now_s
            client.send(px4.read_parameter(*client.vehicle, name))
        for frame in client.frames():
            if frame.message_id == mavlink.MAVLINK_MSG_ID_PARAM_VALUE:
                told = px4.parameter(frame.payload)
                if told is not None and told.name in open_:
                    found[told.name] = told.value
                    open_.discard(told.name)
            elif frame.message_id == mavlink.MAVLINK_MSG_ID_PARAM_ERROR:
                error = decode_cold(frame)
                if (error.target_system, error.target_component) == client.ids:
                    open_.discard(error.param_id)
    return {name: found[name] for name in wanted if name in found}
