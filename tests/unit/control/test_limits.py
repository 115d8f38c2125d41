"""Limits on the force: never a thrust or a tilt outside them, direction kept, altitude first."""

import math

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from companion.control.limits import LimitParams, limit, limit_level

anything = st.floats(allow_nan=False, allow_infinity=False)
near = st.floats(-3.0, 3.0)


@st.composite
def bounds(draw: st.DrawFn) -> tuple[LimitParams, float]:
    """Limits, and a hover thrust between them."""
    low, hover, high = sorted(draw(st.lists(st.floats(0.02, 1.0), min_size=3, max_size=3, unique=True)))
    acceleration = draw(st.one_of(st.just(math.inf), st.floats(0.1, 20.0)))
    return LimitParams(math.radians(draw(st.floats(1.0, 60.0))), low, high, acceleration, 9.81), hover


@given(bounds(), st.one_of(near, anything), st.one_of(near, anything), st.one_of(near, anything))
@example((LimitParams(0.5, 0.1, 0.9, math.inf, 9.81), 0.5), 1e308, -1e308, 1e308)
@example((LimitParams(0.5, 0.1, 0.9, math.inf, 9.81), 0.5), 5e-324, 0.0, 1.0)
def test_limits_hold_for_any_finite_force(given: tuple[LimitParams, float], x: float, y: float, up: float) -> None:
    params, hover = given
    fx, fy, kept, cut, up_cut = limit(params, x, y, up, hover)
    assert all(map(math.isfinite, (fx, fy, kept)))
    thrust = hover * math.hypot(fx, fy, kept)
    assert params.thrust_min * (1 - 1e-12) <= thrust <= params.thrust_max * (1 + 1e-9)
    assert math.atan2(math.hypot(fx, fy), kept) <= params.tilt_rad + 1e-9
    assert math.hypot(fx, fy) * params.gravity_m_s2 <= params.acceleration_m_s2 * (1 + 1e-9)
    # altitude first: the vertical part is the wanted one wherever the thrust can make it, whatever the horizontal one
    if params.thrust_min <= hover * up <= params.thrust_max:
        assert kept == pytest.approx(up, rel=1e-12)
    assert up_cut == (kept != up)
    # direction kept, and never longer than wanted
    assert math.hypot(fx, fy) <= math.hypot(x, y) * (1 + 1e-9)
    largest = max(abs(x), abs(y))
    if largest > 1e-300:
        assert fx * (y / largest) == pytest.approx(fy * (x / largest), abs=1e-9 * math.hypot(fx, fy))
        assert fx * x >= 0.0
        assert fy * y >= 0.0
    if not cut:
        assert (fx, fy) == (x, y)


@given(bounds(), st.floats(-0.01, 0.01), st.floats(-0.01, 0.01))
def test_a_force_within_the_limits_is_left_alone(given: tuple[LimitParams, float], x: float, y: float) -> None:
    params, hover = given
    reach = min(
        math.tan(params.tilt_rad), params.acceleration_m_s2 / 9.81, math.sqrt((params.thrust_max / hover) ** 2 - 1)
    )
    if math.hypot(x, y) < 0.999 * reach:
        assert limit(params, x, y, 1.0, hover) == (x, y, 1.0, False, False)


def test_the_horizontal_part_gets_what_altitude_leaves() -> None:
    params = LimitParams(math.radians(60.0), 0.1, 0.9, math.inf, 9.81)
    fx, fy, up, cut, up_cut = limit(params, 3.0, 4.0, 1.5, 0.5)
    assert (up, cut, up_cut) == (1.5, True, False)
    assert math.hypot(fx, fy, up) == pytest.approx(1.8)  # all of the thrust there is
    assert fy / fx == pytest.approx(4.0 / 3.0)
    assert limit(params, 3.0, 4.0, 9.0, 0.5) == (0.0, 0.0, 1.8, True, True)
    slow = params._replace(acceleration_m_s2=0.981)
    assert math.hypot(*limit(slow, 3.0, 4.0, 1.0, 0.5)[:2]) == pytest.approx(0.1)


@given(st.one_of(near, anything))
def test_a_rig_turns_its_thrust_and_keeps_it(x: float) -> None:
    params = LimitParams(math.radians(35.0), 0.1, 0.9, math.inf, 9.81)
    fx, fy, up, cut, _ = limit_level(params, x)
    assert math.hypot(fx, up) == pytest.approx(1.0)
    assert fy == 0.0
    assert abs(math.asin(fx)) <= params.tilt_rad + 1e-12
    assert cut == (abs(x) > math.sin(params.tilt_rad))
    assert fx == x or cut


def test_a_force_that_is_no_number_stays_one_for_the_guards_to_see() -> None:
    params = LimitParams(0.5, 0.1, 0.9, math.inf, 9.81)
    assert math.isnan(limit(params, math.nan, 0.0, 1.0, 0.5)[0])
    assert math.isnan(limit(params, 0.0, 0.0, math.nan, 0.5)[2])
    assert math.isnan(limit_level(params, math.nan)[0])
