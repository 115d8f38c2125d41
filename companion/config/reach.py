"""How far from its anchor the mission takes the vehicle, against the envelope of its adaptation rate."""

from __future__ import annotations

import math
from itertools import pairwise

from companion.config.controller import AxisSection, ControllerSection
from companion.config.guards import FenceSection
from companion.config.identification import SMALLEST_DEG, IdentificationSection
from companion.config.mission import MissionSection


def check_reach(controller: ControllerSection, mission: MissionSection) -> None:
    """Refuse a mission that leaves the envelope by itself. Raises `ValueError`.

    Anchored at engagement, the farthest waypoint counts. Anchored at the flown set-point, the largest jump of it does;
    travelling at `limits.speed_m_s` it never jumps, and the vehicle lags behind by `2 ζ / ωn` times the speed.
    """
    envelope, speed = controller.envelope, controller.limits.speed_m_s
    places = [(0.0, 0.0), *((w.offset_ned_m[0], w.offset_ned_m[1]) for w in mission.waypoints)]
    if speed is not None:
        if speed > envelope.velocity_m_s:
            raise ValueError(
                f"controller.limits.speed_m_s ({speed:g}) is beyond controller.envelope.velocity_m_s "
                f"({envelope.velocity_m_s:g}), for which the adaptation rate is checked"
            )
        axes = (controller.axes.x, controller.axes.y)
        lag = max(_lag_s(axis) for axis in axes if axis is not None) * speed
        if lag > envelope.position_m:
            raise ValueError(
                f"at controller.limits.speed_m_s ({speed:g}) the vehicle lags {lag:.2g} m behind its set-point, beyond "
                f"controller.envelope.position_m ({envelope.position_m:g}), for which the adaptation rate is checked"
            )
    if controller.anchor == "engage":
        reach = max(math.hypot(*place) for place in places)
        if reach > envelope.position_m:
            raise ValueError(
                f"a waypoint lies {reach:g} m from where control begins, beyond controller.envelope.position_m "
                f"({envelope.position_m:g}), for which the adaptation rate is checked"
            )
    elif speed is None:
        jump = max((math.dist(a, b) for a, b in pairwise(places)), default=0.0)
        if jump > envelope.position_m:
            raise ValueError(
                f"a waypoint lies {jump:g} m from the one before, beyond controller.envelope.position_m "
                f"({envelope.position_m:g}), for which the adaptation rate is checked: "
                "come in smaller steps, or give controller.limits.speed_m_s"
            )


def check_excursion(controller: ControllerSection, fence: FenceSection, flown: IdentificationSection) -> None:
    """Refuse doublets that leave the envelope or reach half way to the fence. Raises `ValueError`."""
    room = controller.envelope.position_m
    what = f"controller.envelope.position_m ({room:g})"
    if fence.enabled:
        sides = [*(fence.lower_ned_m or ())[:2], *(fence.upper_ned_m or ())[:2], fence.radius_m or math.inf]
        half = 0.5 * min(abs(side) for side in sides)
        if half < room:
            room, what = half, f"half of guards.fence ({half:g})"
    fastest = controller.envelope.velocity_m_s
    if flown.excursion_m > room:
        raise ValueError(
            f"mission.identification: a doublet goes {flown.excursion_m:.2g} m to the side, beyond {what}: "
            + _remedy(flown, room)
        )
    if flown.speed_m_s > fastest:
        raise ValueError(
            f"mission.identification: a doublet reaches {flown.speed_m_s:.2g} m/s, beyond "
            f"controller.envelope.velocity_m_s ({fastest:g}): " + _remedy(flown, fastest * flown.pulse_s)
        )


def _remedy(flown: IdentificationSection, excursion_m: float) -> str:
    """What stays within an excursion; rounded down, so that it does."""
    amplitude = math.floor(10.0 * flown.amplitude_for_deg(excursion_m)) / 10.0
    if amplitude < SMALLEST_DEG:
        return "make pulse_s shorter"
    return f"an amplitude_deg of {amplitude:g} would not, nor would a shorter pulse_s"


def _lag_s(axis: AxisSection) -> float:
    """How far the reference model is behind a set-point that travels at 1 m/s."""
    return 2.0 * axis.damping_ratio / axis.natural_frequency_rad_s
