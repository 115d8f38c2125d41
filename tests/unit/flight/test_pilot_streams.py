"""The pilot and a planner's stream: from a hover or from a mission into it, resets of the estimator, and its end."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from companion.config import load_config
from companion.control import attitude
from companion.control.types import Jump, Odometry, PositionSetpoint
from companion.flight.pilot.pilot import Pilot
from companion.trajectory.sample import Sample
from companion.trajectory.streamed import Phase

CONFIG = Path(__file__).resolve().parents[3] / "config" / "trajectories.yaml"
STREAMED = (
    "steering={enabled: true, system_ids: [250]}",
    "guards.fence={enabled: true, radius_m: 9, lower_ned_m: [-9, -9, -4], upper_ned_m: [9, 9, 4]}",
)
HOVER = (*STREAMED, "mission.trajectories=[]")
TICK_S = 0.004


LEAN_RAD = math.atan(1.0 / 9.81)  # of an acceleration of 1 m/s2, nose down


def at(time_s: float, x: float = 3.0, vx: float = 0.0, lean_rad: float = 0.0) -> Odometry:
    half = -0.5 * lean_rad
    return Odometry(time_s, x, 4.0, -5.0, vx, 0.0, 0.0, math.cos(half), 0.0, math.sin(half), 0.0)


def sample(time_s: float, x: float, vx: float, ax: float = 0.0) -> Sample:
    return Sample(round(1e3 * time_s), x, 4.0, -5.0, vx, 0.0, 0.0, ax, 0.0, 0.0, math.nan)


def leaning_deg(pilot: Pilot, now: Odometry) -> float:
    """Forwards."""
    x, _, down = attitude.thrust_direction(*pilot.step(now, TICK_S)[:4])
    return math.degrees(math.atan2(x, -down))


def streamed(pilot: Pilot, seconds: float) -> float:
    """Stream from rest with 1 m/s2, flown perfectly; when it is over."""
    now_s = 0.0
    for k in range(round(seconds / TICK_S)):
        now_s = TICK_S * k
        if k % 12 == 0:
            assert pilot.follow(sample(now_s, 3.0 + 0.5 * now_s**2, now_s, 1.0), now_s) is None
        pilot.step(at(now_s, 3.0 + 0.5 * now_s**2, now_s, LEAN_RAD), TICK_S)
    return now_s


def test_a_stream_takes_the_place_of_the_mission_and_its_acceleration_is_flown() -> None:
    pilot = Pilot(load_config(CONFIG, HOVER), hedging=True)
    pilot.take_over(at(0.0))
    now_s = streamed(pilot, 1.0)
    assert pilot.target.x_m == pytest.approx(3.0 + 0.5 * now_s**2, abs=2e-3)
    assert pilot.stream is not None
    assert pilot.stream.phase is Phase.FOLLOWED
    now_s += TICK_S
    leans = leaning_deg(pilot, at(now_s, 3.0 + 0.5 * now_s**2, now_s, LEAN_RAD))
    assert leans == pytest.approx(math.degrees(LEAN_RAD), abs=1.0)


def test_where_nobody_may_steer_there_is_no_stream() -> None:
    pilot = Pilot(load_config(CONFIG, ("mission.trajectories=[]",)), hedging=True)
    pilot.take_over(at(0.0))
    assert pilot.stream is None
    assert pilot.follow(sample(0.0, 3.0, 0.0), 0.0) == "a stream needs anchor: setpoint"


def test_a_mission_in_motion_goes_over_into_a_stream_that_moves_along() -> None:
    circle = "mission.trajectories=[{circle: {radius_m: 2, speed_m_s: 1, ramp_s: 1}}]"
    pilot = Pilot(load_config(CONFIG, (*STREAMED, circle)), hedging=True)
    pilot.take_over(at(0.0))
    for k in range(600):
        pilot.step(at(TICK_S * k), TICK_S)
    reference = pilot._reference
    assert reference is not None
    assert math.hypot(*reference[3:6]) == pytest.approx(1.0)
    still = sample(2.4, *(reference.x_m, 0.0))._replace(y_m=reference.y_m)
    assert pilot.follow(still, 2.4) == "begins 1 m/s off, most 0.5"
    along = Sample(2400, *reference[:9], math.nan)
    assert pilot.follow(along, 2.4) is None
    pilot.step(at(2.4), TICK_S)
    assert pilot._reference is not None
    assert math.dist(pilot._reference[:2], reference[:2]) == pytest.approx(TICK_S, rel=0.01)
    assert pilot._reference[3:9] == pytest.approx(reference[3:9], abs=0.03)


def test_after_a_reset_of_the_estimator_it_brakes_where_it_is_and_may_begin_again() -> None:
    pilot = Pilot(load_config(CONFIG, HOVER), hedging=True)
    pilot.take_over(at(0.0))
    now_s = streamed(pilot, 0.8)
    before = pilot.target
    pilot.reseat(Jump(0.4, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    pilot.step(at(now_s + TICK_S, 3.4 + 0.5 * now_s**2, now_s), TICK_S)
    assert pilot.stream is not None
    assert (pilot.stream.phase, pilot.stream.why) == (Phase.ENDED, "the estimator reset")
    assert pilot.target.x_m - before.x_m == pytest.approx(0.4 + TICK_S * now_s, abs=1e-3)
    for k in range(600):
        pilot.step(at(now_s + TICK_S * k, pilot.target.x_m), TICK_S)
    assert pilot._reference is not None
    assert pilot._reference[3:9] == pytest.approx((0.0,) * 6, abs=1e-9)
    assert pilot.follow(sample(now_s + 2.5, pilot.target.x_m, 0.0), now_s + 2.5) is None


def test_a_place_to_travel_to_ends_it_and_so_does_another_engagement() -> None:
    pilot = Pilot(load_config(CONFIG, HOVER), hedging=True)
    pilot.take_over(at(0.0))
    streamed(pilot, 0.4)
    pilot.steer(PositionSetpoint(5.0, 4.0, -5.0, math.nan))
    assert pilot.stream is not None
    assert pilot.stream.phase is Phase.NONE
    pilot.step(at(0.404, 3.08, 0.4), TICK_S)
    assert pilot.target[:3] == (5.0, 4.0, -5.0)
    pilot.take_over(at(9.0))
    pilot.step(at(9.0), 0.0)
    assert pilot.target[:3] == (3.0, 4.0, -5.0)
