"""Values that only a slip of unit explains. They are possible, so the schema takes them; who means them says so.

Commands that act on the numbers refuse them, a line for the first; `--anyway` insists (`companion.commands.options`).
What can only be seen beside the vehicle is in `companion.flight.readiness.plausible`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

from companion.config.base import Section
from companion.config.guards.rows import Guards
from companion.config.schema import Config

FASTEST_ATTITUDE_RAD_S: Final = 120.0  # the smallest racing quadrotors answer at half of it
_LONGEST_LIMIT_S: Final = 20.0  # of a guard against what is stale, late or slow
_LONGEST_TIMEOUT_S: Final = 60.0
_WITHIN_A_FLIGHT: Final = frozenset({"flight_time_s"})
_SMALLEST_DEG: Final = 1.58  # a right angle in radians, and a bit
_TAKEOFF_ALTITUDE: Final = "MIS_TAKEOFF_ALT"
_TAKEOFF_ALTITUDE_M: Final = 2.5  # PX4's default
_HOVER_THRUST: Final = "MPC_THR_HOVER"
MOST_HOVER_RATIO: Final = 1.5


def slips(config: Config) -> Iterator[str]:
    """Each value that is not plausible, as one line that says what may have been meant."""
    yield from _attitude(config)
    yield from _guards(config.guards)
    for key, degrees in (
        ("controller.limits.tilt_deg", config.controller.limits.tilt_deg),
        ("controller.limits.yaw_rate_deg_s", config.controller.limits.yaw_rate_deg_s),
        ("guards.tilt_deg.limit", config.guards.tilt_deg.limit),
    ):
        if degrees < _SMALLEST_DEG:
            unit = "/s" if key.endswith("_s") else ""
            yield f"{key} is {degrees:g} degrees{unit}: radians{unit}? That would be {math.degrees(degrees):.3g}"
    yield from _waypoints(config)
    stated = config.vehicle.parameters.get(_HOVER_THRUST)
    if stated is not None and (line := hover_thrust(config.vehicle.hover_thrust, stated)) is not None:
        yield line


def hover_thrust(ours: float, theirs: float) -> str | None:
    """Why a config's hover thrust makes no sense beside the vehicle's MPC_THR_HOVER; None where it does."""
    if theirs > 0.0 and max(ours / theirs, theirs / ours) <= MOST_HOVER_RATIO:
        return None
    return (
        f"vehicle.hover_thrust is {ours:g} and the vehicle's {_HOVER_THRUST} {theirs:.4g}: one of them would let it "
        "shoot up or fall; correct the wrong one"
    )


def _attitude(config: Config) -> Iterator[str]:
    sections = {f"attitude.{axis}": getattr(config.attitude, axis) for axis in ("x", "y")}
    plant = config.plant
    for kind in () if plant is None else ("rig", "quadrotor"):
        for angle in ("roll", "pitch", "yaw"):
            sections[f"plant.{kind}.{angle}"] = getattr(getattr(plant, kind), angle, None)
    for place, section in sections.items():
        for key, value in _rates(section):
            if value > FASTEST_ATTITUDE_RAD_S:
                yield (
                    f"{place}.{key} is {value:g} rad/s, faster than any attitude loop: degrees/s? That would be "
                    f"{math.radians(value):.3g}"
                )


def _rates(section: Section | None) -> Iterator[tuple[str, float]]:
    """What of a response is told in rad/s; of an interval its upper end."""
    for key in () if section is None else type(section).model_fields:
        value = getattr(section, key)
        if key.endswith("_rad_s") and value is not None:
            yield key, max(value) if isinstance(value, tuple) else value


def _guards(guards: Guards) -> Iterator[str]:
    for name in type(guards).model_fields:
        section = getattr(guards, name)
        limit = getattr(section, "limit", None)
        seconds = [
            ("limit", limit if name.endswith("_s") and name not in _WITHIN_A_FLIGHT else None, _LONGEST_LIMIT_S),
            ("timeout_s", getattr(section, "timeout_s", None), _LONGEST_TIMEOUT_S),
        ]
        for key, value, longest in seconds:
            if section.enabled and value is not None and value > longest:
                yield (
                    f"guards.{name}.{key} is {value:g} s, by when there is nothing left to guard: milliseconds? That "
                    f"would be {1e-3 * value:g}"
                )


def _waypoints(config: Config) -> Iterator[str]:
    if not config.vehicle_kind.can_fly:
        return
    plant = {} if config.plant is None else config.plant.parameters
    height_m = config.vehicle.parameters.get(_TAKEOFF_ALTITUDE, plant.get(_TAKEOFF_ALTITUDE, _TAKEOFF_ALTITUDE_M))
    for waypoint in config.mission.waypoints:
        down_m = waypoint.offset_ned_m[2]
        if down_m >= height_m:
            yield (
                f"the waypoint at {waypoint.at_s:g} s is {down_m:g} m down, and a take-off goes {height_m:g} m up: z "
                f"points down; is {-down_m:g} meant?"
            )
