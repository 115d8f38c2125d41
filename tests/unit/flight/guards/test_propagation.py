"""Position against velocity, and velocity against attitude and thrust: what an independent propagation shows."""

import math

import pytest

from companion.control.types import GRAVITY_M_S2, Jump, Odometry
from companion.flight.guards import estimator, propagation
from companion.flight.guards.propagation import Disagreement, Propagation

AT_REST = Odometry(10.0, 1.0, 2.0, -3.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
HOVERS = (0.0, 0.0, 0.0)  # acceleration by attitude and thrust


def slid(speed_m_s: float, said_m_s: float, seconds: float, period_s: float = 0.02, place: str = "x") -> Disagreement:
    """What disagrees after moving at one speed and telling another."""
    says = AT_REST._replace(**{f"v{place}_m_s": said_m_s})
    state, apart = propagation.start(says, HOVERS), Disagreement()
    for k in range(1, round(seconds / period_s) + 1):
        t = k * period_s
        at = {"time_s": 10.0 + t, f"{place}_m": getattr(AT_REST, f"{place}_m") + speed_m_s * t}
        state, apart = propagation.step(state, says._replace(**at), HOVERS)
    return apart


def test_a_steady_difference_of_real_estimators_stays_far_below_the_limit() -> None:
    assert max(slid(2.0, 2.0, 10.0)) < 1e-9
    assert slid(0.2, 0.0, 10.0).drift_m == pytest.approx(0.1, abs=0.01)


def test_a_slide_of_five_metres_in_0_6_s_shows_within_a_quarter_of_a_second() -> None:
    assert slid(5.0 / 0.6, 0.0, 0.1).drift_m < 1.0
    assert slid(5.0 / 0.6, 0.0, 0.25).drift_m > 1.0


def test_it_does_not_depend_on_how_often_it_is_looked_at() -> None:
    often, seldom = slid(8.0, 0.0, 0.4, 0.004), slid(8.0, 0.0, 0.4, 0.02)
    assert often[:3] == pytest.approx(seldom[:3], rel=0.05)


def test_a_slow_slide_adds_up_over_ten_seconds_and_height_has_a_limit_of_its_own() -> None:
    after_10_s_m = 0.3 * 10.0 * (1.0 - math.exp(-1.0))
    assert slid(0.3, 0.0, 10.0).slide_m == pytest.approx(after_10_s_m, rel=0.02)
    assert slid(0.3, 0.0, 10.0).height_slide_m == 0.0
    assert slid(0.3, 0.0, 10.0, place="z").height_slide_m == pytest.approx(after_10_s_m, rel=0.02)
    assert slid(0.3, 0.0, 10.0, place="z").slide_m == 0.0
    assert slid(1.5, 0.0, 3.0).slide_m > 7.2, "a faster one is seen by what it does in two seconds"


def test_a_step_is_more_than_noise_and_counted_ones_are_none() -> None:
    state = propagation.start(AT_REST, HOVERS)
    for step_m, seen_m in ((0.19, 0.0), (0.45, 0.45)):
        assert propagation.step(state, AT_REST._replace(time_s=10.02, y_m=2.0 + step_m), HOVERS)[1].step_m == (
            pytest.approx(seen_m)
        )
    jump = Jump(0.0, 0.45, 0.0, 0.0, 0.0, 0.0, 0.0)
    moved = AT_REST._replace(time_s=10.02, y_m=2.45)
    assert max(propagation.step(state, moved, HOVERS, jump)[1]) == pytest.approx(0.0, abs=1e-9)


def test_a_counted_jump_is_no_slide() -> None:
    before = AT_REST._replace(vx_m_s=0.5)
    after = before._replace(time_s=10.02, x_m=1.01 + 4.0, vx_m_s=0.1, vz_m_s=0.3)
    state, apart = propagation.step(propagation.start(before, HOVERS), after, HOVERS)
    assert apart.drift_m > 3.5
    state, apart = propagation.step(propagation.start(before, HOVERS), after, HOVERS, estimator.jump(before, after))
    assert apart.drift_m < 0.02
    assert apart.unexplained_m_s < 0.01
    _, apart = propagation.step(state, after._replace(time_s=10.04, x_m=after.x_m + 0.002, z_m=-3.0 + 0.006), HOVERS)
    assert apart.drift_m < 0.02


def thrown(acceleration_ned_m_s2: tuple[float, float, float], flown: tuple[float, float, float], for_s: float) -> float:
    """What velocity does beyond what is flown, after a while from rest."""
    state: Propagation = propagation.start(AT_REST, HOVERS)
    apart = Disagreement()
    for k in range(1, round(for_s / 0.02) + 1):
        t = 0.02 * k
        x, y, z = (0.5 * a * t * t for a in acceleration_ned_m_s2)
        vx, vy, vz = (a * t for a in acceleration_ned_m_s2)
        sample = AT_REST._replace(time_s=10.0 + t, x_m=1 + x, y_m=2 + y, z_m=z - 3, vx_m_s=vx, vy_m_s=vy, vz_m_s=vz)
        state, apart = propagation.step(state, sample, flown if k else HOVERS)
    return apart.unexplained_m_s


def test_velocity_that_does_not_follow_the_thrust_is_unexplained() -> None:
    assert thrown((3.0, 0.0, 0.0), (3.0, 0.0, 0.0), 1.0) < 0.05
    assert thrown((0.0, 0.0, 0.0), (3.0, 0.0, 0.0), 1.0) > 1.5  # it leans, and says that it stands still
    assert thrown((0.0, 0.0, GRAVITY_M_S2), HOVERS, 0.5) > 2.5  # it falls


def test_wind_that_blows_steadily_is_learnt_and_one_that_blew_before_is_known() -> None:
    assert thrown((0.0, 0.0, 0.0), (3.0, 0.0, 0.0), 30.0) < 0.1
    state = propagation.start(AT_REST, (3.0, 0.0, 0.0))  # leaning against wind when control begins
    for k in range(1, 100):
        state, apart = propagation.step(state, AT_REST._replace(time_s=10.0 + 0.02 * k), (3.0, 0.0, 0.0))
        assert apart.unexplained_m_s < 1e-9


def test_thrust_is_along_the_measured_direction_and_carries_the_weight_at_hover() -> None:
    assert propagation.acceleration((0.0, 0.0, -1.0), 0.5, 0.5) == (0.0, 0.0, 0.0)
    north, east, down = propagation.acceleration((0.1, -0.2, -0.97), 0.6, 0.5)
    assert (north, east) == (pytest.approx(0.12 * GRAVITY_M_S2), pytest.approx(-0.24 * GRAVITY_M_S2))
    assert down == pytest.approx(GRAVITY_M_S2 * (1.0 - 1.2 * 0.97))
