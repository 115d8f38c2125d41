"""The autopilot under faults: what it believes, tells and obeys."""

import math
import sys
from pathlib import Path

import pytest

from companion.config import ConfigError, load_config
from companion.mavlink.codec import FrameParser, Layout, decode_cold
from companion.mavlink.px4 import Result
from sitl.autopilot.autopilot import Autopilot
from sitl.autopilot.commands import VehicleCommand, execute, switch
from sitl.autopilot.modes import FlightMode, custom_mode
from sitl.autopilot.request_faults import Answer, RequestFaults
from sitl.autopilot.status import system_status
from sitl.build import build_world
from sitl.messages.telemetry import Telemetry
from sitl.scenarios.settled import ALTITUDE_M, SETTLE_S, settled_world
from sitl.vehicles.rotation import euler, quaternion, turned

sys.path.append(str(Path(__file__).resolve().parents[2] / "sitl"))
from harness.running_plant import autopilot, quadrotor

CONFIG = Path(__file__).resolve().parents[3] / "config" / "px4_quadrotor.yaml"
ODOMETRY = Layout("ODOMETRY")


def airborne() -> Autopilot:
    pilot = autopilot(quadrotor())
    pilot.start_in_air(5.0)
    return pilot


def in_offboard() -> Autopilot:
    pilot = airborne()
    pilot.on_attitude_target((1.0, 0.0, 0.0, 0.0), 0.5)
    assert switch(pilot, FlightMode.OFFBOARD) is Result.ACCEPTED
    return pilot


def told(pilot: Autopilot, name: str) -> object:
    telemetry = Telemetry(pilot, 1, 1, 0)
    frames = FrameParser().feed(telemetry.builders[Layout(name).message_id](0))
    return decode_cold(frames[0])


def world(*overrides: str, complete: bool = False):
    return build_world(load_config(CONFIG, ("plant.sensors=null", *overrides)), complete=complete)


# --- a start in the air -----------------------------------------------------------------------------------------------


def test_start_in_air_hovers_in_hold_at_time_zero() -> None:
    pilot = airborne()
    pilot.advance(5_000_000)
    assert (pilot.commander.mode, pilot.commander.armed, pilot.commander.landed) == (FlightMode.HOLD, True, False)
    assert pilot.vehicle.state.position_ned_m == pytest.approx((0.0, 0.0, -5.0), abs=0.05)


def test_settled_in_the_air_it_holds_although_it_is_too_heavy() -> None:
    heavy = world("plant.mismatch={mass: 1.2}").autopilot
    heavy.start_in_air(5.0, settle_s=10.0)
    assert heavy.time_us == 0
    before = heavy.vehicle.state.position_ned_m[2]
    heavy.advance(2_000_000)
    assert heavy.vehicle.state.position_ned_m[2] == pytest.approx(before, abs=0.1)


# --- what it is ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(("mismatch", "true_hover"), [("{mass: 1.2}", 1.2), ("{thrust: 0.8}", 1.25), ("{}", 1.0)])
def test_mismatch_moves_the_thrust_that_carries_it(mismatch: str, true_hover: float) -> None:
    craft = world(f"plant.mismatch={mismatch}").autopilot.vehicle
    craft.lift_to(-50.0)
    for _ in range(100):
        craft.step((1.0, 0.0, 0.0, 0.0), craft.hover_thrust * true_hover)
    assert craft.state.velocity_ned_m_s[2] == pytest.approx(0.0, abs=1e-9)


def test_only_what_is_configured_is_built() -> None:
    plain = world()
    assert (plain.environment, plain.estimator, plain.channels) == (None, None, None)
    assert plain.autopilot.on_control is None
    assert None not in world(complete=True)


def test_configured_wind_blows_and_noise_is_reported() -> None:
    built = world("plant.wind={mean_ned_m_s: [5, 0, 0]}", "plant.sensors={position_m: 0.1}")
    built.autopilot.start_in_air(5.0)
    built.autopilot.advance(1_000_000)
    assert built.autopilot.vehicle.effects.wind_north_m_s == 5.0
    assert built.autopilot.estimate().position_ned_m != built.autopilot.vehicle.state.position_ned_m


@pytest.mark.parametrize(
    ("override", "complaint"),
    [
        ("plant.parameters={NOT_THERE: 1}", "no parameter"),
        ("plant.wind={mean_ned_m_s: [1, 2]}", "plant.wind.mean_ned_m_s"),
        ("plant.link={down: {loss: 2}}", "plant.link.down.loss"),
    ],
)
def test_a_bad_plant_section_is_one_clear_line(override: str, complaint: str) -> None:
    with pytest.raises(ConfigError, match=complaint) as raised:
        world(override)
    assert "\n" not in str(raised.value)


# --- what it tells ---------------------------------------------------------------------------------------


def test_current_mode_tells_what_is_intended_while_a_failsafe_flies() -> None:
    pilot = in_offboard()
    pilot.commander.forced_failsafe = FlightMode.RTL
    pilot.advance(50_000)
    message = told(pilot, "CURRENT_MODE")
    assert message.custom_mode == custom_mode(FlightMode.RTL)
    assert message.intended_custom_mode == custom_mode(FlightMode.OFFBOARD)
    assert system_status(pilot) == 5


def test_health_is_told_by_odometry_and_estimator_status() -> None:
    pilot = airborne()
    telemetry = Telemetry(pilot, 1, 1, 0)
    telemetry.odometry(0)
    pilot.health = pilot.health._replace(flags=869, horizontal_m2=1.25)
    (frame,) = FrameParser().feed(telemetry.odometry(1))
    assert decode_cold(frame).pose_covariance[0] == decode_cold(frame).pose_covariance[6] == 1.25
    assert told(pilot, "ESTIMATOR_STATUS").flags == 869


def test_a_wrong_clock_is_in_the_stamps_of_odometry_alone() -> None:
    pilot = airborne()
    pilot.advance(100_000)
    pilot.stamp_us = lambda now_us: now_us + 5_000_000
    assert told(pilot, "ODOMETRY").time_usec == 5_100_000
    assert told(pilot, "ATTITUDE").time_boot_ms == 100


# --- what it obeys ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("answer", "result", "at_once", "later"),
    [
        (Answer.REFUSED, Result.TEMPORARILY_REJECTED, FlightMode.OFFBOARD, FlightMode.OFFBOARD),
        (Answer.EMPTY, Result.ACCEPTED, FlightMode.OFFBOARD, FlightMode.OFFBOARD),
        (Answer.LATE, Result.ACCEPTED, FlightMode.OFFBOARD, FlightMode.HOLD),
    ],
)
def test_request_faults(answer: Answer, result: Result, at_once: FlightMode, later: FlightMode) -> None:
    pilot = in_offboard()
    pilot.request_faults = RequestFaults()
    pilot.request_faults.answers[FlightMode.HOLD] = answer
    pilot.request_faults.late_us = 300_000
    results = execute(pilot, VehicleCommand(176, 1, 4, 3))
    assert results == (Result.ACCEPTED, result)
    assert pilot.commander.mode is at_once
    for _ in range(50):
        pilot.on_attitude_target((1.0, 0.0, 0.0, 0.0), 0.5)
        pilot.advance(pilot.time_us + 10_000)
    assert pilot.commander.mode is later
    assert pilot.request_faults.requests == [FlightMode.HOLD]


@pytest.mark.parametrize(
    ("answer", "result"), [(Answer.REFUSED, Result.TEMPORARILY_REJECTED), (Answer.EMPTY, Result.ACCEPTED)]
)
def test_arming_that_is_not_done(answer: Answer, result: Result) -> None:
    pilot = autopilot(quadrotor())
    pilot.request_faults = RequestFaults()
    pilot.request_faults.arming = answer
    assert execute(pilot, VehicleCommand(400, 1)) == (result,)
    assert not pilot.commander.armed


def test_kill_stops_the_motors_at_once_and_disarms_after_five_seconds() -> None:
    pilot = in_offboard()
    pilot.commander.kill(pilot.time_us)
    pilot.advance(20_000)
    pilot.on_attitude_target((1.0, 0.0, 0.0, 0.0), 0.5)
    assert (pilot.setpoint.thrust, pilot.commander.armed, system_status(pilot)) == (0.0, True, 8)
    pilot.advance(5_100_000)
    assert not pilot.commander.armed


def test_a_forced_failsafe_ends_when_the_user_asks_for_a_mode() -> None:
    pilot = in_offboard()
    pilot.commander.forced_failsafe = FlightMode.RTL
    pilot.advance(20_000)
    assert pilot.commander.mode is FlightMode.RTL
    assert switch(pilot, FlightMode.HOLD) is Result.ACCEPTED
    pilot.advance(40_000)
    assert (pilot.commander.mode, pilot.commander.failsafe) == (FlightMode.HOLD, False)


def test_the_attitude_loop_lives_in_the_estimates_heading() -> None:
    pilot = in_offboard()
    pilot.heading_error_rad = math.radians(20.0)
    for _ in range(300):
        pilot.on_attitude_target(turned(quaternion(0.1, 0.0, 0.0), pilot.heading_error_rad), 0.5)
        pilot.advance(pilot.time_us + 10_000)
    roll, pitch, yaw = euler(*pilot.vehicle.state.q_wxyz)
    assert (roll, pitch, yaw) == pytest.approx((0.1, 0.0, 0.0), abs=1e-3)


def test_hooks_see_every_control_step_and_every_setpoint() -> None:
    pilot = airborne()
    steps: list[int] = []
    setpoints: list[float] = []
    pilot.on_control = steps.append
    pilot.on_setpoint = lambda q, thrust, mask: setpoints.append(thrust)
    pilot.on_attitude_target((1.0, 0.0, 0.0, 0.0), 0.4)
    pilot.advance(100_000)
    assert len(steps) == 10
    assert setpoints == [0.4]


def test_a_settled_world_is_copied_whole_and_its_copies_share_nothing() -> None:
    config = load_config(
        CONFIG, ("plant.sensors={position_m: 0.02, delay_s: 0.01}", "plant.wind={mean_ned_m_s: [3, 0, 0]}")
    )
    fresh = build_world(config, complete=True)
    fresh.autopilot.start_in_air(ALTITUDE_M, SETTLE_S)
    first, second = settled_world(config), settled_world(config)
    begun = second.autopilot.vehicle.state
    for world in (fresh, first):
        world.autopilot.advance(world.autopilot.time_us + 2_000_000)
    assert first.autopilot.vehicle.state == fresh.autopilot.vehicle.state
    assert first.autopilot.estimate() == fresh.autopilot.estimate()
    assert second.autopilot.vehicle.state == begun != first.autopilot.vehicle.state
