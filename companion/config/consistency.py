"""What sections of a config may not say together: limits that contradict one another, or what is certified."""

from __future__ import annotations

import math

from companion.config.attitude import AttitudeSection, certified_delay_s
from companion.config.controller import ControllerSection
from companion.config.guards.fence import FenceSection
from companion.config.guards.rows import Guards
from companion.config.link import TickSection
from companion.config.mission import MissionSection
from companion.config.service import SteeringSection


def check_guards(guards: Guards, controller: ControllerSection, tick: TickSection) -> None:
    """Refuse guards that can never act, or act on what the controller may ask for. Raises `ValueError`."""
    rate_hz = guards.pose_rate_hz.limit
    if rate_hz is not None and rate_hz < tick.floor_hz:
        raise ValueError(
            f"guards.pose_rate_hz.limit ({rate_hz:g}) is below tick.floor_hz ({tick.floor_hz:g}), the slowest that is "
            "certified"
        )
    if guards.tilt_deg.enabled and guards.tilt_deg.limit <= controller.limits.tilt_deg:
        raise ValueError(
            f"guards.tilt_deg.limit ({guards.tilt_deg.limit:g}) is not above controller.limits.tilt_deg "
            f"({controller.limits.tilt_deg:g}), which the controller may ask for"
        )
    if guards.thrust_saturation.enabled and guards.thrust_saturation.limit >= 1.0:
        raise ValueError("guards.thrust_saturation.limit: a share of the ticks, so it must be below 1")


def check_delay(guards: Guards, attitude: AttitudeSection) -> None:
    """Refuse a link slower than what is certified. Raises `ValueError`."""
    certified_s, limit_s = certified_delay_s(attitude), guards.link_delay_s.limit
    if guards.link_delay_s.enabled and limit_s is not None and 0.0 < certified_s < limit_s:
        raise ValueError(
            f"guards.link_delay_s.limit ({limit_s:g}) is above the certified attitude.*.delay_s ({certified_s:g})"
        )


def check_fence(fence: FenceSection, mission: MissionSection) -> None:
    """Refuse a mission that leaves its own fence. Raises `ValueError`."""
    for waypoint in mission.waypoints:
        outside = fence.outside(waypoint.offset_ned_m)
        if outside is not None:
            raise ValueError(f"the waypoint at {waypoint.at_s:g} s lies outside guards.fence: {outside}")


def check_steering(steering: SteeringSection, fence: FenceSection, controller: ControllerSection) -> None:
    """Refuse live commands that no fence bounds, or that would throw the vehicle. Raises `ValueError`."""
    if not steering.enabled:
        return
    if not fence.enabled or fence.lower_ned_m is None or fence.upper_ned_m is None:
        raise ValueError(
            "steering.enabled needs guards.fence.enabled with lower_ned_m and upper_ned_m: a live command may ask for "
            "any place, and any height"
        )
    reach = math.hypot(
        *(max(-low, high) for low, high in zip(fence.lower_ned_m[:2], fence.upper_ned_m[:2], strict=True))
    )
    reach = min(reach, fence.radius_m or math.inf)
    if controller.anchor == "engage" and reach > controller.envelope.position_m:
        raise ValueError(
            f"steering.enabled: the fence reaches {reach:.3g} m, beyond controller.envelope.position_m "
            f"({controller.envelope.position_m:g}); with anchor setpoint only the way between two places counts"
        )
    if (
        controller.anchor == "setpoint"
        and controller.limits.speed_m_s is None
        and 2 * reach > controller.envelope.position_m
    ):
        raise ValueError(
            "steering.enabled needs controller.limits.speed_m_s: without it a live command is a jump beyond "
            "controller.envelope.position_m"
        )
