"""Every derivative is that of the one before; curves begin and end at rest; a course has no jump."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.control.types import Reference
from companion.trajectory.course import Course, Leg, brake, lead_in, transfer
from companion.trajectory.curves import Circle, Lemniscate
from companion.trajectory.feasibility import Limits, excess
from companion.trajectory.polynomial import nonic
from companion.trajectory.series import polynomial
from companion.trajectory.stairs import Stairs
from companion.trajectory.trajectory import Hold, Stretched, Trajectory
from companion.trajectory.waypoints import piecewise, through

LIMITS = Limits(3.0, 4.0, 20.0, math.radians(25.0), 0.3, 1.6, math.radians(60.0))
WAY = ((0.0, 0.0, 0.0, 0.0), (2.0, 1.0, -1.0, 0.5), (4.0, -1.0, 0.0, 1.0), (1.0, -2.0, 0.5, 1.0))
ALL: dict[str, Trajectory] = {
    "circle": Circle(2.0, 1.5, 2.0, 2.0, clockwise=False, along_path=True),
    "lemniscate": Lemniscate(4.0, 2.0, 2.0, 1.0, 3.0),
    "short lemniscate": Lemniscate(4.0, 2.0, 2.0, 0.25, 60.0, along_path=True),
    "through": through(WAY, LIMITS),
    "stretched": Stretched(Lemniscate(4.0, 2.0, 2.0, 1.0, 3.0), 1.7),
    "transfer": brake(Circle(1.0, 1.0, 1.0, 1.0).at(3.0), LIMITS),
}


@pytest.mark.parametrize("name", ALL)
def test_every_derivative_is_that_of_the_one_before(name: str) -> None:
    flown, h = ALL[name], 1e-5
    for k in range(1, 40):
        time_s = flown.duration_s * k / 40.0
        before, now, after = flown.at(time_s - h), flown.at(time_s), flown.at(time_s + h)
        for place in range(12):
            slope = (after[place] - before[place]) / (2.0 * h)
            assert slope == pytest.approx(now[place + 3], abs=2e-3 + 1e-3 * abs(now[place + 3]))


@pytest.mark.parametrize("name", ["circle", "lemniscate", "short lemniscate", "through", "stretched"])
def test_it_begins_and_ends_at_rest(name: str) -> None:
    flown = ALL[name]
    for time_s in (0.0, flown.duration_s, -1.0, flown.duration_s + 1.0):
        assert flown.at(time_s)[3:12] == pytest.approx((0.0,) * 9, abs=1e-6)


def test_a_lemniscate_has_its_size_and_its_speed_in_the_middle() -> None:
    flown = Lemniscate(4.0, 2.0, 2.0, 3.0, 3.0)
    instants = [flown.at(0.01 * k) for k in range(int(100 * flown.duration_s))]
    assert max(at.x_m for at in instants) == pytest.approx(2.0, abs=1e-3)
    assert max(at.y_m for at in instants) == pytest.approx(1.0, abs=1e-3)
    assert max(math.hypot(at.vx_m_s, at.vy_m_s) for at in instants) == pytest.approx(2.0, abs=1e-3)


def test_a_heading_along_the_path_is_that_of_the_velocity() -> None:
    for flown in (
        ALL["circle"],
        Lemniscate(4.0, 2.0, 2.0, 1.0, 3.0, along_path=True),
        through(WAY, LIMITS, along_path=True),
    ):
        for share in (0.2, 0.5, 0.8):
            at = flown.at(share * flown.duration_s)
            assert math.sin(at.yaw_rad - math.atan2(at.vy_m_s, at.vx_m_s)) == pytest.approx(0.0, abs=1e-6)


@given(st.lists(st.floats(-5, 5), min_size=10, max_size=10), st.floats(0.3, 8.0))
def test_a_polynomial_of_degree_9_has_both_states(states: list[float], duration_s: float) -> None:
    begin, end = tuple(states[:5]), tuple(states[5:])
    series = polynomial(nonic(begin, end, duration_s), duration_s)
    size = max(1.0, *(abs(v) * duration_s**k for k, v in enumerate(begin)))
    for k, value in enumerate(end):
        assert math.factorial(k) * series[k] * duration_s**k == pytest.approx(value * duration_s**k, abs=1e-6 * size)


def distance(one: Reference, other: Reference) -> float:
    return max(abs(a - b) for a, b in zip(one[:9], other[:9], strict=True))


def test_a_course_goes_on_without_a_jump_wherever_control_began() -> None:
    legs = [
        Leg("hold", Hold(1.0), stays=True),
        Leg("eight", Lemniscate(4.0, 2.0, 1.5, 1.0, 3.0)),
        Leg("circle", Circle(1.0, 1.0, 1.0, 2.0), absolute=True),
        # samples that begin and end in motion
        Leg("moving", piecewise([(t, 0.2 * t * t, 0.0, 0.0) for t in (0.0, 0.7, 1.4, 2.1)], (0.7,) * 3, at_rest=False)),
        Leg("hold", Hold(1.0), stays=True),
    ]
    engaged = (3.0, -2.0, -5.0, 0.7)
    course = Course(legs, engaged, LIMITS)
    before, steps = course.at(0.0)
    assert before[:3] == engaged[:3]
    h = 0.002
    for k in range(1, int(course.duration_s / h)):
        now, steps = course.at(h * k)
        assert not steps
        assert distance(before, now) < 6.0 * h * (1.0 + max(map(abs, (*now[3:12], *before[3:12]))))
        before = now
    assert course.at(course.duration_s)[0][3:9] == pytest.approx((0.0,) * 6, abs=1e-6)
    # the circle stands in the local frame, to the metre and the heading
    places = [course.at(0.01 * k)[0] for k in range(int(100 * course.duration_s))]
    assert min(math.dist(at[:3], (0.0, 2.0, 0.0)) for at in places) < 0.02


def test_stairs_in_a_course_are_set_points_to_travel_to() -> None:
    course = Course(
        [Leg("stairs", Stairs(4.0, (1.0,), ((1.0, 0.0, 0.0, 0.5),)), steps=True)], (1.0, 1.0, -2.0, 0.1), LIMITS
    )
    assert course.at(0.5) == (Reference(1.0, 1.0, -2.0, *(0.0,) * 12, 0.1), True)
    at, steps = course.at(1.0)
    assert (at.x_m, at.yaw_rad, steps) == (2.0, pytest.approx(0.6), True)
    assert course.duration_s == 4.0


def test_what_joins_keeps_the_limits_and_continues_both_ends() -> None:
    moving = Lemniscate(4.0, 2.0, 2.0, 1.0, 3.0).at(4.0)
    begins, ends = lead_in(moving, LIMITS), brake(moving, LIMITS)
    assert begins.at(begins.duration_s)[:12] == pytest.approx(moving[:12], abs=1e-6)
    assert ends.at(0.0)[:12] == pytest.approx(moving[:12], abs=1e-6)
    across = transfer(ends.at(ends.duration_s), begins.at(0.0)._replace(yaw_rad=2.0), LIMITS)
    for way in (begins, ends, across):
        assert excess(way, LIMITS) is None
    assert across.at(across.duration_s).yaw_rad == pytest.approx(2.0)
