"""Between the plant's local NED frame and latitude, longitude and altitude, on a tangent plane: metres, not kilometres.

The origin is where PX4's simulators stand by default.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

EARTH_RADIUS_M: Final = 6_371_000.0


class GlobalPosition(NamedTuple):
    """WGS84 degrees, and metres above mean sea level."""

    latitude_deg: float
    longitude_deg: float
    altitude_m: float


ORIGIN: Final = GlobalPosition(47.397742, 8.545594, 489.4)
_METRES_PER_DEGREE: Final = math.radians(1.0) * EARTH_RADIUS_M
_METRES_PER_DEGREE_EAST: Final = _METRES_PER_DEGREE * math.cos(math.radians(ORIGIN.latitude_deg))


def to_global(position_ned_m: tuple[float, float, float]) -> GlobalPosition:
    """Where a local position is on the globe."""
    north, east, down = position_ned_m
    return GlobalPosition(
        ORIGIN.latitude_deg + north / _METRES_PER_DEGREE,
        ORIGIN.longitude_deg + east / _METRES_PER_DEGREE_EAST,
        ORIGIN.altitude_m - down,
    )


def to_local(position: GlobalPosition) -> tuple[float, float, float]:
    """Local NED position in m of a place on the globe."""
    return (
        (position.latitude_deg - ORIGIN.latitude_deg) * _METRES_PER_DEGREE,
        (position.longitude_deg - ORIGIN.longitude_deg) * _METRES_PER_DEGREE_EAST,
        ORIGIN.altitude_m - position.altitude_m,
    )
