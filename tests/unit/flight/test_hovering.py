"""What a vehicle hovers at before control begins, by the thrust that it is told to fly there."""

import math

import pytest

from companion.control.types import Odometry
from companion.flight.readiness.hovering import Hovering

DT_S = 0.008


def seen(hovers_at: float, climb_m_s2: float = 0.0, seconds: float = 3.0, tilt_rad: float = 0.0) -> Hovering:
    """A vehicle whose PX4 climbs and sinks in turns, by its thrust."""
    hovering, velocity = Hovering(), 0.0
    for k in range(round(seconds / DT_S)):
        up = 1.0 + climb_m_s2 / 9.81 * math.sin(2.0 * k * DT_S)
        velocity += DT_S * 9.81 * (1.0 - up)
        hovering.on_thrust(hovers_at * up / math.cos(tilt_rad), offboard=False)
        sample = Odometry(k * DT_S, 0, 0, 0, 0, 0, velocity, math.cos(tilt_rad / 2), math.sin(tilt_rad / 2), 0, 0)
        hovering.on_sample(sample, DT_S, offboard=False)
    return hovering


@pytest.mark.parametrize(("climb_m_s2", "tilt_rad"), [(0.0, 0.0), (2.0, 0.0), (0.0, 0.3)])
def test_it_is_known_whatever_is_flown(climb_m_s2: float, tilt_rad: float) -> None:
    assert seen(0.59, climb_m_s2, tilt_rad=tilt_rad).thrust == pytest.approx(0.59, rel=0.02)


def test_not_before_a_while_and_not_after_the_ground() -> None:
    assert seen(0.59, seconds=0.4).thrust is None
    hovering = seen(0.59)
    hovering.forget()
    assert hovering.thrust is None


def test_what_is_streamed_in_offboard_is_no_news() -> None:
    hovering = seen(0.59)
    for k in range(500):
        hovering.on_thrust(0.1, offboard=True)
        hovering.on_sample(Odometry(3 + k * DT_S, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0), DT_S, offboard=True)
    assert hovering.thrust == pytest.approx(0.59, rel=0.02)


def test_no_number_is_no_thrust() -> None:
    hovering = Hovering()
    for thrust in (math.nan, math.inf):
        hovering.on_thrust(thrust, offboard=False)
        hovering.on_sample(Odometry(0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0), 5.0, offboard=False)
    assert hovering.thrust is None
