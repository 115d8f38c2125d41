"""Waypoints of a QGroundControl plan (`.plan`, JSON), as places around its planned home.

Source: docs.qgroundcontrol.com, "Plan File Format"; MAVLink common.xml, MAV_CMD and MAV_FRAME. Waypoints are taken,
with the time to hold and the heading of each; take-off, landing and return are the pilot's.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any, Final, NamedTuple

from companion.trajectory.trajectory import Place

_WAYPOINT: Final = 16  # MAV_CMD_NAV_WAYPOINT
_BEFORE: Final = frozenset({22, 84})  # NAV_TAKEOFF, NAV_VTOL_TAKEOFF
_BEHIND: Final = frozenset({20, 21, 85})  # NAV_RETURN_TO_LAUNCH, NAV_LAND, NAV_VTOL_LAND
_ABOVE_SEA: Final = frozenset({0, 5})  # MAV_FRAME_GLOBAL, _INT
_ABOVE_HOME: Final = frozenset({3, 6})  # MAV_FRAME_GLOBAL_RELATIVE_ALT, _INT
_EARTH_RADIUS_M: Final = 6371000.0


class Stop(NamedTuple):
    """A waypoint: where, for how long the vehicle stays there, and whether it has a heading of its own."""

    place: Place  # from the planned home
    hold_s: float
    heading_given: bool


def read_plan(path: Path) -> list[Stop]:
    """The waypoints of a plan, in order. Raises `ValueError`, one line."""
    try:
        plan = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise ValueError(f"{path}: no such file") from None
    except OSError as error:
        raise ValueError(f"{path}: {error.strerror}") from None
    except (ValueError, RecursionError):
        raise ValueError(f"{path}: not JSON") from None
    try:
        return _stops(plan)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def _stops(plan: Any) -> list[Stop]:
    mission = plan.get("mission") if isinstance(plan, dict) else None
    if not isinstance(mission, dict) or not isinstance(mission.get("items"), list):
        raise ValueError("not a plan of QGroundControl: no mission with items")
    home = _numbers(mission.get("plannedHomePosition"), 3, "plannedHomePosition")
    stops: list[Stop] = []
    for number, item in enumerate(mission["items"], 1):
        if not isinstance(item, dict) or item.get("type") != "SimpleItem":
            raise ValueError(f"item {number} is no simple item: surveys and scans are not flown")
        command = item.get("command")
        if command in _BEFORE and not stops:
            continue
        if command in _BEHIND:
            break
        if command != _WAYPOINT:
            raise ValueError(f"item {number} is command {command!r}: only waypoints (16) are flown")
        stops.append(_stop(item, number, home, stops))
    if len(stops) < 2:
        raise ValueError("fewer than two waypoints")
    return stops


def _stop(item: dict[str, Any], number: int, home: list[float], before: list[Stop]) -> Stop:
    parameters = item.get("params")
    if not isinstance(parameters, list) or len(parameters) != 7:
        raise ValueError(f"item {number}: params: seven numbers are wanted")
    hold_s = 0.0 if parameters[0] is None else _numbers(parameters[:1], 1, f"item {number}")[0]
    latitude, longitude, height = _numbers(parameters[4:], 3, f"item {number}")
    if abs(latitude) > 90.0 or abs(longitude) > 180.0:
        raise ValueError(f"item {number}: {latitude:g}, {longitude:g} is no place on Earth")
    frame = item.get("frame")
    if frame in _ABOVE_SEA:
        height -= home[2]
    elif frame not in _ABOVE_HOME:
        raise ValueError(f"item {number}: frame {frame!r}: heights above home (3) or above the sea (0) are known")
    north = math.radians(latitude - home[0]) * _EARTH_RADIUS_M
    east = math.radians(longitude - home[1]) * _EARTH_RADIUS_M * math.cos(math.radians(home[0]))
    given = parameters[3] is not None
    yaw = math.radians(_numbers([parameters[3]], 1, f"item {number}")[0]) if given else 0.0
    if not given and before:
        yaw = before[-1].place[3]
    return Stop((north, east, -height, yaw), max(hold_s, 0.0), given)


def _numbers(values: Any, count: int, what: str) -> list[float]:
    good = isinstance(values, list) and len(values) == count
    if not good or not all(type(v) in (int, float) and math.isfinite(v) for v in values):
        raise ValueError(f"{what}: {count} finite numbers are wanted")
    return [float(v) for v in values]
