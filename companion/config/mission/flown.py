"""From `mission.trajectories` to what is flown, against the limits, the envelope and the fence. Before flight."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

from companion.attitude_response.inverse import inverse
from companion.config.attitude import AttitudeSection, response_of
from companion.config.base import Vector
from companion.config.controller import ControllerSection
from companion.config.guards.fence import FenceSection
from companion.config.mission import MissionSection
from companion.config.mission.trajectories import TrajectorySection
from companion.trajectory.course import Course, Leg
from companion.trajectory.curves import Circle, Lemniscate
from companion.trajectory.feasibility import Limits, excess, farthest, stretched
from companion.trajectory.plan import read_plan
from companion.trajectory.samples import read_samples
from companion.trajectory.stairs import Stairs
from companion.trajectory.trajectory import Hold, Place, Shifted, Trajectory
from companion.trajectory.waypoints import through

SHARE: Final = 0.8  # of acceleration, tilt and thrust: the rest is left to the feedback, against wind and error


def check_trajectories(
    mission: MissionSection,
    controller: ControllerSection,
    attitude: AttitudeSection,
    fence: FenceSection,
    hover_thrust: float,
) -> None:
    """Refuse a mission that asks for too much, and say where and by how much. Raises `ValueError`."""
    if controller.anchor != "setpoint":
        raise ValueError("mission.trajectories need controller.anchor: setpoint, since the frame moves along with them")
    limits = limits_of(mission, controller, attitude, hover_thrust)
    legs = legs_of(mission, limits)
    for leg in legs:
        too_much = None if leg.steps else excess(leg.trajectory, limits)
        if too_much is not None:
            raise ValueError(f"mission.{leg.name}: {too_much.describe()}")
        left = None if leg.absolute else farthest(leg.trajectory, fence.outside)
        if left is not None:
            raise ValueError(f"mission.{leg.name} leaves guards.fence {left[0]:.3g} s after it began: {left[1]}")
    if not any(leg.absolute for leg in legs):  # the way to a place that is absolute is found where control begins
        Course(legs, (0.0, 0.0, 0.0, 0.0), limits)


def limits_of(
    mission: MissionSection, controller: ControllerSection, attitude: AttitudeSection, hover_thrust: float
) -> Limits:
    """The most that a trajectory may ask for.

    The envelope bounds the jerk: where the attitude response is anywhere in its certified interval, the force comes
    late or early by `spread_s` at most, and a jerk j leaves the reference model behind by ``j spread / wn^2`` and ``j
    spread / (2 zeta wn)``.
    """
    bounds, envelope = controller.limits, controller.envelope
    jerk = mission.limits.jerk_m_s3
    for axis, section in ((controller.axes.x, attitude.x), (controller.axes.y, attitude.y)):
        if axis is None or section is None:
            continue
        spread = inverse(response_of(section)).spread_s
        if spread > 0.0:
            wn, damping = axis.natural_frequency_rad_s, 2.0 * axis.damping_ratio * axis.natural_frequency_rad_s
            jerk = min(jerk, envelope.position_m * wn * wn / spread, envelope.velocity_m_s * damping / spread)
    acceleration = math.inf if bounds.acceleration_m_s2 is None else bounds.acceleration_m_s2
    return Limits(
        speed_m_s=mission.limits.speed_m_s,
        acceleration_m_s2=SHARE * acceleration,
        jerk_m_s3=jerk,
        tilt_rad=math.atan(SHARE * math.tan(math.radians(bounds.tilt_deg))),
        lift_lowest=1.0 - SHARE * (1.0 - bounds.thrust_min / hover_thrust),
        lift_highest=1.0 + SHARE * (bounds.thrust_max / hover_thrust - 1.0),
        yaw_rate_rad_s=math.radians(bounds.yaw_rate_deg_s),
    )


def legs_of(mission: MissionSection, limits: Limits) -> list[Leg]:
    """What is flown, each slowed until it fits where the mission says so. Raises `ValueError`, one line."""
    legs = []
    for number, section in enumerate(mission.trajectories):
        name = f"trajectories.{number}.{section.kind}"
        try:
            for trajectory in _built(section, limits):
                slowed = stretched(trajectory, limits) if mission.stretch and not section.stairs else trajectory
                legs.append(_leg(name, section, slowed))
        except ValueError as error:
            raise ValueError(f"mission.{name}: {error}") from None
    return legs


def _leg(name: str, section: TrajectorySection, trajectory: Trajectory) -> Leg:
    kind = section.circle or section.lemniscate or section.through or section.samples or section.plan
    return Leg(
        name,
        trajectory,
        absolute=section.absolute,
        from_north=(kind is not None and kind.heading == "path") or _has_headings(section),
        steps=section.stairs is not None,
        stays=section.hold_s is not None and section.offset_ned_m is None and not section.absolute,
    )


def _has_headings(section: TrajectorySection) -> bool:
    """Whether a plan says where the nose is to point: its headings are from north."""
    return section.plan is not None and any(stop.heading_given for stop in read_plan(section.plan.file))


def _built(section: TrajectorySection, limits: Limits) -> Iterator[Trajectory]:
    """In their place, but for where control began."""
    along_path = False
    found: list[Trajectory]
    if section.hold_s is not None:
        found = [Hold(section.hold_s)]
    elif section.stairs is not None:
        turn, places = 0.0, []
        for waypoint in section.stairs.waypoints:
            turn = turn if waypoint.yaw_deg is None else math.radians(waypoint.yaw_deg)
            places.append((*waypoint.offset_ned_m, turn))
        times = tuple(waypoint.at_s for waypoint in section.stairs.waypoints)
        found = [Stairs(section.stairs.duration_s, times, tuple(places))]
    elif (circle := section.circle) is not None:
        along_path = circle.heading == "path"
        found = [Circle(circle.radius_m, circle.speed_m_s, circle.laps, circle.ramp_s, circle.clockwise, along_path)]
    elif (eight := section.lemniscate) is not None:
        along_path = eight.heading == "path"
        found = [Lemniscate(eight.length_m, eight.width_m, eight.speed_m_s, eight.laps, eight.ramp_s, along_path)]
    elif (way := section.through) is not None:
        along_path = way.heading == "path"
        turn, stops = 0.0, []
        for place in way.places:
            turn = turn if place.yaw_deg is None else math.radians(place.yaw_deg)
            stops.append((*place.offset_ned_m, turn))
        found = [through(stops, limits, along_path=along_path)]
    elif (table := section.samples) is not None:
        along_path = table.heading == "path"
        found = [read_samples(table.file, along_path=along_path)]
    else:
        assert section.plan is not None
        along_path = section.plan.heading == "path"
        found = list(_planned(section, limits, along_path))
    north, east, down = section.offset_ned_m or (0.0, 0.0, 0.0)
    by: Place = (north, east, down, 0.0 if along_path else math.radians(section.yaw_deg))
    for trajectory in found:
        yield trajectory if by == (0.0, 0.0, 0.0, 0.0) else Shifted(trajectory, by)


def _planned(section: TrajectorySection, limits: Limits, along_path: bool) -> Iterator[Trajectory]:
    """Through the waypoints of a plan, with a stop wherever one is to be held."""
    assert section.plan is not None
    stops = read_plan(section.plan.file)
    origin: Vector = (0.0, 0.0, 0.0) if section.absolute else stops[0].place[:3]
    places = [(*(a - b for a, b in zip(stop.place[:3], origin, strict=True)), stop.place[3]) for stop in stops]
    way: list[Place] = []
    for stop, (north, east, down, yaw) in zip(stops, places, strict=True):
        way.append((north, east, down, yaw))
        if stop.hold_s > 0.0 or stop is stops[-1]:
            if len(way) > 1:
                yield through(way, limits, along_path=along_path)
            if stop.hold_s > 0.0:
                yield Hold(stop.hold_s, way[-1])
            way = way[-1:]
