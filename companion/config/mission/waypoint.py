"""A step of the stairs."""

from __future__ import annotations

from itertools import pairwise

from companion.config.base import NonNegative, Number, Section, Vector


class Waypoint(Section):
    """From a time on, a position and a heading relative to where control began."""

    at_s: NonNegative
    """Since control began. Waypoints come in this order, no two at the same time."""
    offset_ned_m: Vector
    """North, east, down of where control began. It must lie inside `guards.fence` and within what
    `controller.envelope` allows."""
    yaw_deg: Number | None = None
    """Heading, clockwise from above, from the one at engagement. Left out: as it is. A rig has none."""


def check_order(waypoints: tuple[Waypoint, ...], duration_s: float | None) -> None:
    """Refuse waypoints out of order, or after the end. Raises `ValueError`."""
    times = [waypoint.at_s for waypoint in waypoints]
    if any(later <= earlier for earlier, later in pairwise(times)):
        raise ValueError("waypoints must come in order of at_s, no two at the same time")
    if times and duration_s is not None and times[-1] >= duration_s:
        raise ValueError("the last waypoint lies at or after duration_s")
