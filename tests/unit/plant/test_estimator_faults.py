"""The estimator between truth and everybody, one fault at a time."""

import math
from random import Random

import numpy as np
import pytest

from sitl.vehicles.rotation import euler, quaternion
from sitl.vehicles.vehicle import VehicleState
from sitl.world.estimator import Estimator, Lag, Noise, turned
from sitl.world.estimator_status import (
    NOMINAL,
    WITHOUT_HORIZONTAL,
    WITHOUT_PREDICTION,
    after_gps_loss,
    drift_after_gps_loss_m,
)


class Flight:
    """North at 2 m/s, in 4 ms steps."""

    def __init__(self, noise: Noise | None = None, lag: Lag | None = None, seed: int = 1) -> None:
        self.now_us = 0
        self.estimator = Estimator(lambda: self.truth, lambda: self.now_us, Random(seed), noise, lag)

    @property
    def truth(self) -> VehicleState:
        north = 2e-6 * self.now_us
        return VehicleState(
            (north, 0.0, -5.0), (2.0, 0.0, 0.0), quaternion(0.1, -0.2, 0.3), (0.0, 0.0, 0.0), (0.0, 0.0, -9.81)
        )

    def reports(self, count: int) -> list[VehicleState]:
        found = []
        for _ in range(count):
            self.now_us += 4000
            found.append(self.estimator())
        return found


def test_without_a_fault_it_is_the_truth() -> None:
    flight = Flight()
    assert flight.reports(1)[0] == flight.truth


def test_noise_has_its_deviation_and_its_memory() -> None:
    flight = Flight(Noise(0.05, 0.1, 0.01, 0.1))
    errors = []
    for report in flight.reports(40_000):
        north = np.subtract(report.position_ned_m, flight.truth.position_ned_m)
        errors.append((north[1], report.velocity_ned_m_s[1], euler(*report.q_wxyz)[0] - 0.1))
    errors = np.array(errors)
    assert errors.std(axis=0) == pytest.approx([0.05, 0.1, 0.01], rel=0.1)
    lag = 25  # 0.1 s
    assert float(np.corrcoef(errors[:-lag, 0], errors[lag:, 0])[0, 1]) == pytest.approx(math.exp(-1.0), abs=0.08)


def test_the_same_instant_is_the_same_answer() -> None:
    flight = Flight(Noise(0.05, 0.1, 0.01))
    flight.reports(3)
    assert flight.estimator() is flight.estimator()


def test_the_same_seed_is_the_same_noise() -> None:
    assert Flight(Noise(0.1)).reports(5) == Flight(Noise(0.1)).reports(5)
    assert Flight(Noise(0.1)).reports(5) != Flight(Noise(0.1), seed=2).reports(5)


def test_lag_reports_what_was_true_before() -> None:
    flight = Flight(lag=Lag(0.03))
    report = flight.reports(100)[-1]
    assert report.position_ned_m[0] == pytest.approx(2.0 * (0.4 - 0.03))


def test_jitter_of_the_lag_stays_in_its_bounds() -> None:
    flight = Flight(lag=Lag(0.02, 0.02))
    ages = [0.5 * (2e-6 * 4000 * (k + 1) - r.position_ned_m[0]) for k, r in enumerate(flight.reports(500))][50:]
    assert min(ages) >= 0.02 - 1e-9
    assert max(ages) <= 0.04 + 1e-9
    assert max(ages) - min(ages) > 0.015


def test_drift_moves_position_and_not_velocity() -> None:
    flight = Flight()
    flight.reports(1)
    flight.estimator.drift_ned_m_s = (0.0, 1.5, 0.0)
    report = flight.reports(250)[-1]
    assert report.position_ned_m[1] == pytest.approx(1.5)
    assert report.velocity_ned_m_s[1] == 0.0


def test_a_jump_of_velocity_converges_back() -> None:
    flight = Flight()
    flight.estimator.jump((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), math.radians(30.0))
    first = flight.reports(1)[0]
    assert first.position_ned_m[0] - flight.truth.position_ned_m[0] == pytest.approx(1.0)
    assert euler(*first.q_wxyz)[2] == pytest.approx(0.3 + math.radians(30.0))
    last = flight.reports(750)[-1]
    assert last.velocity_ned_m_s[1] == pytest.approx(math.exp(-3.0), rel=0.02)
    assert last.position_ned_m[0] - flight.truth.position_ned_m[0] == pytest.approx(1.0)


def test_frozen_repeats_itself_and_thaws() -> None:
    flight = Flight()
    before = flight.reports(1)[0]
    flight.estimator.frozen = True
    assert set(flight.reports(10)) == {before}
    flight.estimator.frozen = False
    assert flight.reports(1)[0] == flight.truth


def test_not_a_number_is_in_the_position() -> None:
    flight = Flight()
    flight.estimator.not_a_number = True
    assert all(math.isnan(value) for value in flight.reports(1)[0].position_ned_m)


def test_turned_is_a_turn_about_the_vertical() -> None:
    assert euler(*turned(quaternion(0.1, -0.2, 0.3), 0.5)) == pytest.approx((0.1, -0.2, 0.8))


@pytest.mark.parametrize(
    ("elapsed_s", "variance_m2", "flags"),
    [(0.0, 0.042, NOMINAL.flags), (2.0, 0.125, NOMINAL.flags), (5.0, 1.074, NOMINAL.flags),
     (5.7, 1.75, WITHOUT_HORIZONTAL), (8.0, 6.0, WITHOUT_PREDICTION), (60.0, 13.9, WITHOUT_PREDICTION)],
)  # fmt: skip
def test_after_gps_loss_it_tells_what_the_recording_tells(elapsed_s: float, variance_m2: float, flags: int) -> None:
    health = after_gps_loss(elapsed_s)
    assert health.horizontal_m2 == pytest.approx(variance_m2, rel=0.01)
    assert health.flags == flags
    assert drift_after_gps_loss_m(5.6) == pytest.approx(1.1, abs=0.01)
