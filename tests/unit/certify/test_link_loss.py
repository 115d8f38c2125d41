"""The bound on what a dying companion leaves: against closed forms, and against vehicles that fly on."""

import math
from pathlib import Path

import pytest

from companion.certify import link_loss
from companion.config import Config, load_config

SHIPPED = Path(__file__).resolve().parents[3] / "config"


def config(name: str, *overrides: str) -> Config:
    return load_config(SHIPPED / f"{name}.yaml", overrides)


def test_a_response_of_first_order_never_overshoots() -> None:
    found = link_loss.kernel(config("antx_rig"))
    assert sum(found.values) * 1e-3 == pytest.approx(1.0, abs=1e-3)
    assert found.values[100] == pytest.approx(3.0 * math.exp(-3.0 * 0.1005), rel=1e-6)
    assert found.peak == pytest.approx(1.0, abs=1e-3)


def test_of_an_underdamped_response_the_gain_is_the_sum_of_its_swings() -> None:
    own = ("natural_frequency_rad_s=9", "damping_ratio=0.5", "delay_s=0.03")
    overrides = [f"attitude.{axis}.{each}" for axis in "xy" for each in own]
    found = link_loss.kernel(config("px4_quadrotor", *overrides))
    swing = math.exp(-math.pi * 0.5 / math.sqrt(0.75))
    assert sum(found.values) * 1e-3 == pytest.approx((1.0 + swing) / (1.0 - swing), rel=1e-3)
    assert found.peak == pytest.approx(1.0 + swing, rel=1e-3)
    assert found.values[:30] == (0.0,) * 30


def test_an_interval_of_delays_holds_the_largest_of_all() -> None:
    apart = config("px4_quadrotor", *(f"attitude.{axis}.delay_s=0.045" for axis in "xy"))
    wide, late = link_loss.kernel(config("px4_quadrotor")).values, link_loss.kernel(apart).values
    assert all(a >= b - 1e-12 for a, b in zip(wide, late, strict=False))
    assert sum(wide) > sum(late)


def test_longer_is_worse_and_a_rig_does_not_sink() -> None:
    quadrotor, rig = config("px4_quadrotor"), config("antx_rig")
    short, long = link_loss.worst(quadrotor, 0.5), link_loss.worst(quadrotor, 1.0)
    assert short.tilt_rad == long.tilt_rad > math.radians(quadrotor.controller.limits.tilt_deg)
    assert 2.0 * short.distance_m < long.distance_m
    assert 2.0 * short.height_lost_m < long.height_lost_m
    assert link_loss.worst(rig, 1.0).height_lost_m == 0.0


def test_what_is_proposed_lets_the_companion_hand_over_first() -> None:
    assert link_loss.proposed_s(config("px4_quadrotor")) == 0.5
    assert link_loss.proposed_s(config("px4_quadrotor", "guards.pose_age_s.limit=0.5")) == 0.8
    told = link_loss.stated(config("px4_quadrotor", "vehicle.parameters={COM_OF_LOSS_T: 0.7}"))
    assert [bound.loss_time_s for bound in told] == [0.5, 0.7, 1.0]
