"""The flown set-point: on its way from where it is to the target, no faster than it may travel and turn."""

from __future__ import annotations

import math
from typing import NamedTuple

from companion.control.types import PositionSetpoint


class SetpointParams(NamedTuple):
    """How fast the flown set-point may travel, on a straight line in space, and turn. An infinite speed is a jump."""

    speed_m_s: float
    yaw_rate_rad_s: float


def turn(from_rad: float, to_rad: float) -> float:
    """The short way round from one heading to another, in [-pi, pi]; exactly zero between equal ones."""
    between = to_rad - from_rad
    return math.atan2(math.sin(between), math.cos(between))


def advance(params: SetpointParams, flown: PositionSetpoint, target: PositionSetpoint, dt_s: float) -> PositionSetpoint:
    """The flown set-point one tick later; it arrives at the target exactly."""
    x, y, z, yaw = flown
    target_x, target_y, target_z, target_yaw = target
    speed, yaw_rate = params
    north, east, down = target_x - x, target_y - y, target_z - z
    distance = math.sqrt(north * north + east * east + down * down)
    if speed == math.inf or distance <= speed * dt_s:
        x, y, z = target_x, target_y, target_z
    else:
        share = speed * dt_s / distance
        x, y, z = x + share * north, y + share * east, z + share * down
    if yaw != target_yaw:
        between = turn(yaw, target_yaw)
        if abs(between) <= yaw_rate * dt_s:
            yaw = target_yaw
        else:
            yaw += yaw_rate * dt_s if between > 0.0 else -yaw_rate * dt_s
    return PositionSetpoint(x, y, z, yaw)
