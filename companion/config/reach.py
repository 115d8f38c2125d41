"""How far from its anchor the mission takes the vehicle, against the envelope of its adaptation rate."""

from __future__ import annotations

import math
from itertools import pairwise

from companion.config.controller import AxisSection, ControllerSection
from companion.config.guards.fence import FenceSection
from companion.config.mission import MissionSection
from companion.config.mission.identification import SMALLEST_DEG, USUAL_DEG, IdentificationSection


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


def amplitude_deg(controller: ControllerSection, fence: FenceSection, flown: IdentificationSection) -> float:
    """Of the doublets: the one asked for, or the usual one where it fits, or the largest that does.

    Raises `ValueError` for doublets that leave the envelope or reach half way to the fence.
    """
    room = controller.envelope.position_m
    what = f"controller.envelope.position_m ({room:g})"
    if fence.enabled:
        sides = [*(fence.lower_ned_m or ())[:2], *(fence.upper_ned_m or ())[:2], fence.radius_m or math.inf]
        half = 0.5 * min(abs(side) for side in sides)
        if half < room:
            room, what = half, f"half of guards.fence ({half:g})"
    fastest = controller.envelope.velocity_m_s
    most_m = min(room, fastest * flown.pulse_s)
    largest = math.floor(10.0 * flown.amplitude_for_deg(most_m)) / 10.0  # rounded down, so that it fits
    asked = flown.amplitude_deg
    if asked is None and largest >= SMALLEST_DEG:
        return min(USUAL_DEG, largest)
    amplitude = asked or SMALLEST_DEG
    goes_m = flown.excursion_m(amplitude)
    if goes_m <= most_m:
        return amplitude
    too_much = f"goes {goes_m:.2g} m to the side, beyond {what}"
    if goes_m <= room:
        too_much = f"reaches {goes_m / flown.pulse_s:.2g} m/s, beyond controller.envelope.velocity_m_s ({fastest:g})"
    remedy = f"an amplitude_deg of {largest:g} would not, nor would a shorter pulse_s"
    if largest < SMALLEST_DEG:
        remedy = "make pulse_s shorter"
    raise ValueError(f"mission.identification: a doublet {too_much}: {remedy}")


def _lag_s(axis: AxisSection) -> float:
    """How far the reference model is behind a set-point that travels at 1 m/s."""
    return 2.0 * axis.damping_ratio / axis.natural_frequency_rad_s
