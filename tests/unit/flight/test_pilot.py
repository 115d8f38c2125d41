"""The pilot: take-over with a hover thrust, steering, re-seating, and what it tells the guards and the log."""

from __future__ import annotations

import math
import struct
from pathlib import Path

import numpy as np
import pytest

from companion.config import load_config
from companion.control import attitude
from companion.control.types import Jump, Odometry, PositionSetpoint
from companion.flight.pilot.pilot import Pilot, record_standby
from companion.record import schema
from companion.record.reader import tick_dtype

SHIPPED = Path(__file__).resolve().parents[3] / "config"
UNCORRECTED = "controller.estimate_correction=null"
PX4, RIG = load_config(SHIPPED / "px4_quadrotor.yaml", (UNCORRECTED,)), load_config(SHIPPED / "antx_rig.yaml")
HOLD = load_config(SHIPPED / "px4_quadrotor.yaml", ("mission.waypoints=[]", UNCORRECTED))
NONE = Jump(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def sample(time_s: float, jump: Jump = NONE, yaw: float = 0.4) -> Odometry:
    """Hovering over (3, 4) at 5 m, as an estimator tells it that has jumped."""
    half = 0.5 * (yaw + jump.yaw_rad)
    place = (3.0 + jump.x_m, 4.0 + jump.y_m, -5.0 + jump.z_m, jump.vx_m_s, jump.vy_m_s, jump.vz_m_s)
    return Odometry(time_s, *place, math.cos(half), 0.0, 0.0, math.sin(half))


def hover(pilot: Pilot, from_s: float, seconds: float, jump: Jump = NONE) -> None:
    for k in range(round(seconds / 0.004)):
        pilot.step(sample(from_s + 0.004 * k, jump), 0.004)


@pytest.mark.parametrize(
    ("source", "told", "flown"),
    [
        ("config", 0.6, 0.49),
        ("parameter", 0.6, 0.6),
        ("parameter", None, 0.49),
        ("parameter", 0.95, 0.49),
        ("parameter", math.nan, 0.49),
        ("estimated", 0.6, 0.6),
        ("estimated", None, 0.49),
    ],
)
def test_hover_thrust_comes_from_where_the_config_says(source: str, told: float | None, flown: float) -> None:
    config = load_config(SHIPPED / "px4_quadrotor.yaml", (f"vehicle.hover_thrust_source={source}",))
    pilot = Pilot(config, hedging=True)
    assert pilot.hover_thrust == 0.49
    pilot.believe_hover_thrust(told)
    pilot.take_over(sample(0.0))
    assert pilot.hover_thrust == flown
    assert pilot.step(sample(0.0), 0.0).thrust == pytest.approx(flown)


@pytest.mark.parametrize("source", ["config", "parameter", "estimated"])
@pytest.mark.parametrize("hovers_at", [0.59, 0.40])
def test_it_begins_with_the_thrust_that_carries_it(source: str, hovers_at: float) -> None:
    config = load_config(SHIPPED / "px4_quadrotor.yaml", (f"vehicle.hover_thrust_source={source}",))
    pilot = Pilot(config, hedging=True)
    pilot.believe_hovering(hovers_at)
    assert pilot.standby_thrust == pytest.approx(hovers_at)
    pilot.take_over(sample(0.0))
    assert pilot.step(sample(0.0), 0.0).thrust == pytest.approx(hovers_at)
    assert pilot.hover_thrust == pytest.approx(hovers_at if source == "estimated" else 0.49)
    for k in range(1, 250):  # it stays where it is, and so does the thrust
        assert pilot.step(sample(0.004 * k), 0.004).thrust == pytest.approx(hovers_at, rel=1e-6)


def test_what_px4_needs_to_stay_where_it_is_is_no_other_thrust() -> None:
    pilot = Pilot(PX4, hedging=True)
    pilot.believe_hovering(0.493)
    assert pilot.standby_thrust == 0.49


def test_a_live_command_replaces_the_mission_and_nan_keeps_the_heading() -> None:
    pilot = Pilot(PX4, hedging=True)
    pilot.take_over(sample(0.0))
    pilot.step(sample(0.0), 0.0)
    assert pilot.origin == pilot.target == (3.0, 4.0, -5.0, pytest.approx(0.4))
    pilot.steer(PositionSetpoint(5.0, 5.0, -6.0, math.nan))
    pilot.step(sample(3.0), 0.004)  # the mission would have moved north at 2 s
    assert pilot.target == (5.0, 5.0, -6.0, pytest.approx(0.4))
    pilot.steer(PositionSetpoint(5.0, 5.0, -6.0, -1.0))
    pilot.steer(PositionSetpoint(6.0, 5.0, -6.0, math.nan))
    assert pilot.target == (6.0, 5.0, -6.0, -1.0)
    pilot.take_over(sample(10.0))  # another engagement begins with its own mission
    pilot.step(sample(10.0), 0.0)
    assert pilot.target == (3.0, 4.0, -5.0, pytest.approx(0.4))


def test_a_re_seat_moves_origin_and_target_and_neither_attitude_nor_thrust() -> None:
    jump = Jump(0.3, -0.2, 1.4, 0.2, 0.1, -0.3, 0.2)
    pilot = Pilot(HOLD, hedging=True)
    pilot.take_over(sample(0.0))
    hover(pilot, 0.0, 2.0)
    before, error = pilot.step(sample(2.0), 0.004), pilot.tracking_error_m
    pilot.reseat(jump)
    after = pilot.step(sample(2.004, jump), 0.004)
    assert pilot.origin == pilot.target == pytest.approx((3.3, 3.8, -3.6, 0.6))
    assert after.thrust == pytest.approx(before.thrust, abs=1e-3)
    tilts = [np.array(attitude.thrust_direction(*setpoint[:4])) for setpoint in (before, after)]
    assert math.degrees(math.acos(min(1.0, tilts[0] @ tilts[1]))) < 0.2
    assert attitude.yaw(*after[:4]) - attitude.yaw(*before[:4]) == pytest.approx(0.2, abs=1e-3)
    assert pilot.tracking_error_m == pytest.approx(error, abs=0.01)


def test_tracking_error_is_in_space_and_counts_from_the_hedged_reference() -> None:
    pilot = Pilot(HOLD, hedging=True)
    assert pilot.tracking_error_m == 0.0
    pilot.take_over(sample(0.0))
    pilot.step(sample(0.0), 0.0)
    assert pilot.tracking_error_m == 0.0
    pilot.step(sample(0.004, Jump(0.1, 0.2, -0.3, 0, 0, 0, 0)), 0.004)  # it moved, and nothing pushed it
    assert pilot.tracking_error_m == pytest.approx(math.sqrt(0.01 + 0.04 + 0.09), rel=1e-3)
    assert pilot.error_m == pytest.approx(math.hypot(0.1, 0.2), rel=1e-3)
    rig = Pilot(RIG, hedging=True)
    rig.take_over(sample(0.0))
    rig.step(sample(0.004, Jump(0.1, 0.2, -0.3, 0, 0, 0, 0)), 0.004)
    assert rig.tracking_error_m == pytest.approx(0.1 * math.cos(0.4) + 0.2 * math.sin(0.4), rel=1e-3)  # along its guide


def test_weights_on_a_bound_are_counted_over_both_axes() -> None:
    pilot = Pilot(HOLD, hedging=True)
    assert pilot.weights_on_bound == 0
    pilot.take_over(sample(0.0))
    hover(pilot, 0.0, 0.1)
    assert pilot.weights_on_bound == 0
    assert pilot._control is not None
    x, y = (
        pilot._control.x._replace(position_weight=0.593, bias_weight=-0.3),
        pilot._control.y._replace(bias_weight=0.3),
    )
    pilot._control = pilot._control._replace(x=x, y=y)
    assert pilot.weights_on_bound == 3


def test_thrust_at_its_limit_is_told_apart_from_a_cut_tilt() -> None:
    pilot = Pilot(HOLD, hedging=True)
    pilot.take_over(sample(0.0))
    hover(pilot, 0.004, 1.2)  # what engagement eased in has run out
    pilot.step(sample(1.208, Jump(1.5, 0, 0, 2.0, 0, 0, 0)), 0.004)
    assert pilot.last is not None
    assert (pilot.last.limited, pilot.last.thrust_limited) == (True, False)
    pilot.step(sample(1.212, Jump(0, 0, 9.0, 0, 0, 5.0, 0)), 0.004)
    assert (pilot.last.limited, pilot.last.thrust_limited) == (True, True)


def unpack(record: bytes) -> np.void:
    assert len(record) == struct.calcsize(schema.PACKER.format)
    return np.frombuffer(record[4:], dtype=tick_dtype())[0]


def test_the_record_of_a_tick_tells_target_flown_setpoint_anchor_bias_and_hover_thrust() -> None:
    pilot = Pilot(HOLD, hedging=True)
    pilot.take_over(sample(0.0))
    pilot.steer(PositionSetpoint(6.0, 4.0, -5.0, 1.0))
    hover(pilot, 0.004, 0.4)
    at = sample(0.404)
    setpoint = pilot.step(at, 0.004)
    tick = unpack(pilot.record(at, 0.004, setpoint, 1e-3, 3))
    assert tick["target_ned_m"].tolist() == [6.0, 4.0, -5.0]
    assert tick["target_yaw_rad"] == 1.0
    assert tick["command_ned_m"] == pytest.approx([3.0 + 1.5 * 0.404, 4.0, -5.0], abs=0.01)
    assert tick["command_yaw_rad"] == pytest.approx(0.4 + math.radians(45.0) * 0.404, abs=0.01)
    assert tick["anchor_ned_m"].tolist() == tick["command_ned_m"][:2].tolist()
    assert tick["command_m"].tolist() == [0.0, 0.0]
    assert np.hypot(*tick["position_m"]) == pytest.approx(1.5 * 0.404, abs=0.01)
    assert 0.0 < np.hypot(*tick["bias_weight"]) < 0.3
    assert tick["hover_thrust"] == pilot.hover_thrust
    assert tick["reference_z_m"] == pytest.approx(-5.0, abs=0.01)
    assert (tick["setpoint_thrust"], tick["latency_s"], tick["state"]) == (setpoint.thrust, 1e-3, 3)
    standby = unpack(record_standby(at, 0.004, setpoint, 0.0, 2))
    assert all(np.isnan(standby[field.name]).all() for field in schema.CONTROL_FLOATS)
    assert standby["setpoint_q_wxyz"].tolist() == list(setpoint[:4])
    assert standby["position_ned_m"].tolist() == [3.0, 4.0, -5.0]
