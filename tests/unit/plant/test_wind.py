"""Wind: the gust's shape, Dryden's statistics and its exact discretisation, and what air does to a vehicle."""

import math
from random import Random

import numpy as np
import pytest

from companion.attitude_response.kind import LinearResponse
from companion.attitude_response.kinds import FirstOrder
from sitl.vehicles.attitude_loop import AngleGains, RateGains
from sitl.vehicles.quadrotor import CALM, Effects, QuadrotorParams
from sitl.vehicles.vehicle import Quadrotor
from sitl.world.environment import STEP_S, Environment, Turbulence, Wind
from sitl.world.wind import STILL, Gust, dryden, dryden_step, gust_share

GUST = Gust((3.0, 0.0, 0.0), start_s=1.0, rise_s=2.0, hold_s=1.0, every_s=10.0)


def vehicle() -> Quadrotor:
    loop, rates = LinearResponse(FirstOrder, (8.0,)), RateGains(0.0, 0.0, 0.0, 1.0, 0.0)
    params = QuadrotorParams(
        1.0, 0.1, 0.01, 0.01, 0.02, False, loop, loop, loop, AngleGains(0.0, 0.0, 0.0), rates, rates, rates
    )
    return Quadrotor(params, 0.5)


@pytest.mark.parametrize(
    ("time_s", "share"),
    [(0.0, 0.0), (1.0, 0.0), (2.0, 0.5), (3.0, 1.0), (3.9, 1.0), (5.0, 0.5), (6.1, 0.0), (12.0, 0.5), (13.5, 1.0)],
)
def test_a_gust_rises_stays_falls_and_comes_again(time_s: float, share: float) -> None:
    assert gust_share(GUST, time_s) == pytest.approx(share, abs=1e-12)


def test_a_gust_that_comes_once_stays_away() -> None:
    assert gust_share(GUST._replace(every_s=0.0), 12.0) == 0.0


def series(count: int, dt_s: float, seed: int = 1) -> np.ndarray:
    params, state, normal = dryden(7.7, 6.0, 5.0, dt_s), STILL, Random(seed).gauss
    rows = []
    for _ in range(count):
        noise = (normal(0, 1), normal(0, 1), normal(0, 1), normal(0, 1), normal(0, 1))
        state, turbulence = dryden_step(params, state, noise)
        rows.append(turbulence)
    return np.array(rows)


def test_dryden_has_the_intensities_of_the_standard() -> None:
    height_ft = 6.0 / 0.3048
    vertical = 0.1 * 7.7
    horizontal = vertical / (0.177 + 0.000823 * height_ft) ** 0.4
    deviation = series(120_000, 0.2)[1000:].std(axis=0)
    assert deviation == pytest.approx([horizontal, horizontal, vertical], rel=0.05)


def test_dryden_along_the_wind_forgets_with_its_scale_length() -> None:
    along = series(120_000, 0.2)[:, 0]
    lag = 20  # 4 s
    length_m = 6.0 / 0.3048 / (0.177 + 0.000823 * 6.0 / 0.3048) ** 1.2 * 0.3048
    expected = math.exp(-lag * 0.2 * 5.0 / length_m)
    measured = float(np.corrcoef(along[:-lag], along[lag:])[0, 1])
    assert measured == pytest.approx(expected, abs=0.04)


def test_dryden_is_discretised_exactly_two_short_steps_are_a_long_one() -> None:
    short, long = dryden(7.7, 6.0, 5.0, 0.1).across, dryden(7.7, 6.0, 5.0, 0.2).across

    def over(p) -> tuple[np.ndarray, np.ndarray]:
        transition = p.decay * np.array([[1.0, 0.0], [p.step_s, 1.0]])
        root = np.array([[p.noise_11, 0.0], [p.noise_21, p.noise_22]])
        return transition, root @ root.T

    a, q = over(short)
    a_long, q_long = over(long)
    assert a @ a == pytest.approx(a_long, rel=1e-12)
    assert a @ q @ a.T + q == pytest.approx(q_long, rel=1e-9)


def test_the_same_seed_blows_the_same_wind() -> None:
    assert np.array_equal(series(50, 0.01, 3), series(50, 0.01, 3))
    assert not np.array_equal(series(50, 0.01, 3), series(50, 0.01, 4))


def fly_level(craft: Quadrotor, seconds: float) -> None:
    for _ in range(round(1e3 * seconds)):
        craft.step((1.0, 0.0, 0.0, 0.0), 0.5)


def test_a_level_vehicle_is_carried_along_until_it_drifts_with_the_wind() -> None:
    craft = vehicle()
    craft.lift_to(-10.0)
    craft.effects = CALM._replace(wind_north_m_s=4.0)
    fly_level(craft, 0.1)
    north, *_ = craft.state.velocity_ned_m_s
    assert north == pytest.approx(0.1 * 4.0**2 * 0.1, rel=0.05)  # c_D |v|² over the mass
    fly_level(craft, 60.0)
    assert craft.state.velocity_ned_m_s[0] == pytest.approx(4.0, abs=0.2)


def test_environment_hands_wind_battery_and_motors_to_the_vehicle() -> None:
    craft = vehicle()
    air = Environment(craft, Random(1), Wind((2.0, 0.0, 0.0), GUST), sag_1_s=0.1)
    air.motors, air.roll_bias_rad = 0.8, 0.2
    for step in range(200):
        air.step(round(1e6 * (1.0 + step * STEP_S)))
    assert craft.effects == Effects(*air.wind_ned_m_s, 0.2, 0.0)
    assert air.wind_ned_m_s[0] == pytest.approx(2.0 + 3.0 * gust_share(GUST, 2.99))
    assert craft.thrust_share == pytest.approx(0.8 * (1.0 - 0.1 * 2.0))


def test_turbulence_turns_with_the_mean_wind() -> None:
    def blown(mean: tuple[float, float, float]) -> np.ndarray:
        craft = vehicle()
        air = Environment(craft, Random(1), Wind(mean, None, Turbulence(7.7, 6.0)))
        rows = []
        for step in range(100):
            air.step(round(1e6 * step * STEP_S))
            rows.append(np.subtract(air.wind_ned_m_s, mean))
        return np.array(rows)

    north, east = blown((5.0, 0.0, 0.0)), blown((0.0, 5.0, 0.0))
    assert east[:, 1] == pytest.approx(north[:, 0])
    assert east[:, 0] == pytest.approx(-north[:, 1])
    assert float(np.abs(north).max()) > 0.05


def test_uneven_motors_hold_the_attitude_off_its_setpoint() -> None:
    craft = vehicle()
    craft.lift_to(-10.0)
    craft.effects = CALM._replace(roll_bias_rad=0.2)
    fly_level(craft, 2.0)
    w, x, *_ = craft.state.q_wxyz
    assert 2.0 * math.atan2(x, w) == pytest.approx(0.2, abs=1e-3)
