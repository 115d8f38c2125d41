"""From a config and its trajectories to their tubes, as `companion check --trajectory` tells them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from fractions import Fraction
from typing import Any

from companion.attitude_response.inverse import inverse
from companion.certify.problem import AxisProblem, Problem
from companion.certify.tube.feed_forward import STEP_S, Asked, left_over
from companion.certify.tube.loop import Bias
from companion.certify.tube.tube import Tube, tube
from companion.config import Config, ConfigError
from companion.config.mission.flown import legs_of, limits_of
from companion.control.tracking import LeadParams, feed
from companion.control.types import GRAVITY_M_S2, Reference
from companion.trajectory.course import Course


def tube_json(config: Config, stated: Problem, disturbance_m_s2: float) -> dict[str, Any]:
    """`tube_m` by axis, and what it is made of. Raises `ConfigError`."""
    if not (math.isfinite(disturbance_m_s2) and disturbance_m_s2 >= 0.0):
        raise ConfigError(f"--disturbance {disturbance_m_s2:g}: an acceleration in m/s^2, not below zero")
    if not config.mission.trajectories:
        raise ConfigError("--trajectory: the mission is one of set-points, which have no tube")
    references = list(_instants(config))
    tubes, told = {}, {}
    known: dict[tuple[AxisProblem, Bias | None], Tube] = {}
    for name, axis in stated.axes.items():
        weight = bias_of(config, name, axis)
        if (axis, weight) not in known:  # identical axes are proven once
            known[axis, weight] = tube(axis, weight)
        found = known[axis, weight]
        left = left_over(axis, _asked(references, axis, name))
        total = disturbance_m_s2 + left
        proof = dict(found.proof)
        if 0.0 < found.largest_m_s2 < total:
            proof["bias"] = f"not proven for {total:.3g} m/s2: up to {found.largest_m_s2:.3g}"
        tubes[name] = found.m_per_m_s2 * total
        told[name] = {
            "m_per_m_s2": found.m_per_m_s2,
            "searched_m_per_m_s2": found.searched_m_per_m_s2 if math.isfinite(found.searched_m_per_m_s2) else None,
            "disturbance_m_s2": disturbance_m_s2,
            "feed_forward_m_s2": left,
            "proof": proof,
        }
    return {"tube_m": tubes, "tube": told}


def bias_of(config: Config, name: str, axis: AxisProblem) -> Bias | None:
    """The bias weight of an axis as it flies on a trajectory; None where there is none."""
    bias = config.controller.bias
    section = config.controller.axes.x if name == "x" else config.controller.axes.y
    if bias is None or bias.adaptation_rate.hedged <= 0.0 or section is None:
        return None
    q1, q2 = (Fraction(str(q)) for q in section.lyapunov_q)
    lead = Fraction(inverse(axis.response).first_s).limit_denominator(10**6)
    return Bias(Fraction(str(bias.adaptation_rate.hedged)), Fraction(str(bias.bound)), (q1, q2), lead)


def _instants(config: Config) -> Iterator[Reference]:
    """The course from the origin, every `STEP_S`; what is a set-point to travel to is left out."""
    try:
        limits = limits_of(config.mission, config.controller, config.attitude, config.vehicle.hover_thrust)
        course = Course(legs_of(config.mission, limits), (0.0, 0.0, 0.0, 0.0), limits)
    except ValueError as error:
        raise ConfigError(str(error)) from None
    for k in range(int(course.duration_s / STEP_S) + 1):
        instant, steps = course.at(k * STEP_S)
        if not steps:
            yield instant


def _asked(references: list[Reference], axis: AxisProblem, name: str) -> Iterator[Asked]:
    """Of one axis of the frame that points where the trajectory does."""
    found = inverse(axis.response)
    lead = LeadParams(found.first_s, found.second_s2, found.first_s, found.second_s2, 0.0)
    for at in references:
        c, s = math.cos(at.yaw_rad), math.sin(at.yaw_rad)
        along, across = feed(at, lead, c, s, GRAVITY_M_S2)
        if name == "x":
            yield Asked(c * at.ax_m_s2 + s * at.ay_m_s2, GRAVITY_M_S2 * along)
        else:
            yield Asked(c * at.ay_m_s2 - s * at.ax_m_s2, GRAVITY_M_S2 * across)
