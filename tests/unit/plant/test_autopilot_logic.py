"""The autopilot's flight logic in simulated time: no socket, no clock."""

from __future__ import annotations

import math
import struct
from typing import Final

import pytest

from companion.attitude_response.kind import LinearResponse
from companion.attitude_response.kinds import FirstOrder
from companion.mavlink.px4 import Result
from sitl.autopilot.autopilot import Autopilot
from sitl.autopilot.commands import VehicleCommand, execute, set_mode
from sitl.autopilot.geodesy import GlobalPosition, to_global, to_local
from sitl.autopilot.modes import FlightMode, LandedState, custom_mode, from_main_sub, standard_mode
from sitl.autopilot.parameters import HASH_NAME, OffboardLossAction, Parameters, ParamType
from sitl.autopilot.position_hold import attitude_from_acceleration, yaw_of
from sitl.autopilot.status import base_mode, landed_state, system_status
from sitl.vehicles.attitude_loop import AngleGains, RateGains
from sitl.vehicles.quadrotor import QuadrotorParams
from sitl.vehicles.rig import RigParams
from sitl.vehicles.vehicle import Quadrotor, Rig

ACCEPTED: Final = (Result.ACCEPTED,)
REJECTED: Final = (Result.TEMPORARILY_REJECTED,)
NO_RATES: Final = RateGains(0.0, 0.0, 0.0, 1.0, 0.0)
LEVEL: Final = (1.0, 0.0, 0.0, 0.0)
HOVER: Final = 0.5

ARM: Final = VehicleCommand(400, 1.0)
DISARM: Final = VehicleCommand(400, 0.0)
KILL: Final = VehicleCommand(400, 0.0, 21196.0)
TAKE_OFF: Final = VehicleCommand(22, p7=math.nan)
LAND: Final = VehicleCommand(21)
OFFBOARD: Final = VehicleCommand(176, 1.0, 6.0)
HOLD: Final = VehicleCommand(176, 1.0, 4.0, 3.0)


def make_quadrotor(bandwidth_rad_s: float = 6.0, **parameters: float) -> Autopilot:
    loop = LinearResponse(FirstOrder, (bandwidth_rad_s,))
    gains = AngleGains(0.0, 0.0, 0.0)
    params = QuadrotorParams(1.0, 0.1, 0.01, 0.01, 0.02, False, loop, loop, loop, gains, NO_RATES, NO_RATES, NO_RATES)
    return Autopilot(Quadrotor(params, HOVER), Parameters(parameters))


def make_rig(**parameters: float) -> Autopilot:
    params = RigParams(1.2, 0.25, 0.005, False, LinearResponse(FirstOrder, (3.0,)), 0.0, NO_RATES)
    return Autopilot(Rig(params, HOVER), Parameters(parameters))


def run(pilot: Autopilot, seconds: float) -> None:
    pilot.advance(pilot.time_us + round(1e6 * seconds))


def stream(pilot: Autopilot, seconds: float, q_wxyz: tuple[float, float, float, float] = LEVEL) -> None:
    """Set-points at 50 Hz."""
    for _ in range(round(50 * seconds)):
        pilot.on_attitude_target(q_wxyz, HOVER)
        run(pilot, 0.02)


def airborne(pilot: Autopilot) -> Autopilot:
    assert execute(pilot, ARM) == ACCEPTED
    assert execute(pilot, TAKE_OFF) == ACCEPTED
    run(pilot, 8.0)
    assert pilot.commander.mode is FlightMode.HOLD
    return pilot


def in_offboard(pilot: Autopilot) -> Autopilot:
    stream(pilot, 0.1)
    assert execute(pilot, OFFBOARD)[-1] is Result.ACCEPTED
    stream(pilot, 0.5)
    assert pilot.commander.mode is FlightMode.OFFBOARD
    return pilot


# --- numbers on the wire --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("mode", "wire", "standard"),
    [  # as a PX4 v1.17 sends them
        (FlightMode.HOLD, 50593792, 0),
        (FlightMode.TAKEOFF, 33816576, 8),
        (FlightMode.RTL, 84148224, 5),
        (FlightMode.LAND, 100925440, 7),
        (FlightMode.OFFBOARD, 393216, 0),
        (FlightMode.POSCTL, 196608, 1),
        (FlightMode.MANUAL, 65536, 0),
    ],
)
def test_mode_numbers(mode: FlightMode, wire: int, standard: int) -> None:
    assert custom_mode(mode) == wire
    assert standard_mode(mode) == standard
    assert from_main_sub(wire >> 16 & 255, wire >> 24) is mode


def test_unknown_mode_is_none() -> None:
    assert from_main_sub(4, 99) is None
    assert from_main_sub(0, 0) is None
    assert from_main_sub(10, 0) is None, "termination is not a mode to ask for"


def test_heartbeat_fields_follow_mode() -> None:
    pilot = make_quadrotor()
    assert (base_mode(pilot), system_status(pilot)) == (29, 3)
    airborne(pilot)
    assert (base_mode(pilot), system_status(pilot)) == (157, 4)
    in_offboard(pilot)
    assert (base_mode(pilot), system_status(pilot)) == (145, 4)
    run(pilot, 1.5)
    assert (base_mode(pilot), system_status(pilot)) == (157, 5)


def test_geodesy_round_trip() -> None:
    for position in [(0.0, 0.0, 0.0), (12.5, -40.0, -7.25)]:
        assert to_local(to_global(position)) == pytest.approx(position, abs=1e-6)
    assert to_global((0.0, 0.0, -10.0)).altitude_m - to_global((0.0, 0.0, 0.0)).altitude_m == pytest.approx(10.0)
    assert isinstance(to_global((0.0, 0.0, 0.0)), GlobalPosition)


# --- parameters -----------------------------------------------------------------------------------------------------


def test_int32_travels_bytewise() -> None:
    parameters = Parameters()
    for value in (3, -1, -8388607, 2**31 - 1):  # -8388607 is a signalling NaN to anybody who reads it as a float
        answer = parameters.set_wire("COM_OBL_RC_ACT", struct.pack("<i", value), ParamType.INT32)
        assert answer is not None
        assert answer.raw == struct.pack("<i", value)
        assert parameters["COM_OBL_RC_ACT"] == value


def test_unknown_and_mistyped_parameters_are_met_with_silence() -> None:
    parameters = Parameters()
    assert parameters.wire("NO_SUCH_THING") is None
    assert parameters.wire_at(len(parameters)) is None
    assert parameters.set_wire("NO_SUCH_THING", bytes(4), ParamType.REAL32) is None
    assert parameters.set_wire("MC_ROLL_P", struct.pack("<i", 3), ParamType.INT32) is None
    assert parameters["MC_ROLL_P"] == 4.0


def test_parameter_places_are_in_order() -> None:
    parameters = Parameters()
    places = [parameters.wire_at(index) for index in range(len(parameters))]
    assert [p.name for p in places if p] == sorted(parameters)
    assert all(p and p.place == index and p.total == len(parameters) for index, p in enumerate(places))


def test_hash_changes_with_a_value() -> None:
    parameters = Parameters()
    before = parameters.wire(HASH_NAME)
    parameters.set("MC_ROLL_P", 3.0)
    after = parameters.wire(HASH_NAME)
    assert before is not None
    assert after is not None
    assert before.raw != after.raw
    assert after.type is ParamType.UINT32


def test_bad_override() -> None:
    with pytest.raises(KeyError):
        Parameters({"NO_SUCH_THING": 1})
    with pytest.raises(TypeError):
        Parameters({"COM_OBL_RC_ACT": 0.5})


# --- arming ---------------------------------------------------------------------------------------------------------


def test_disarm_in_the_air_needs_force() -> None:
    pilot = airborne(make_quadrotor())
    assert execute(pilot, DISARM) == REJECTED
    assert pilot.commander.armed
    assert execute(pilot, KILL) == ACCEPTED
    run(pilot, 1.0)
    assert pilot.setpoint.thrust == 0.0
    assert pilot.estimate().velocity_ned_m_s[2] > 5.0 or pilot.vehicle.on_ground()


def test_arming_in_offboard_needs_the_stream() -> None:
    pilot = make_quadrotor()
    assert execute(pilot, OFFBOARD) == (Result.ACCEPTED, Result.ACCEPTED), "disarmed, any mode may be chosen"
    assert system_status(pilot) == 0
    assert execute(pilot, ARM) == REJECTED
    stream(pilot, 0.1)
    assert execute(pilot, ARM) == ACCEPTED


@pytest.mark.parametrize("mode", [FlightMode.LAND, FlightMode.RTL, FlightMode.POSCTL, FlightMode.MANUAL])
def test_modes_that_prevent_arming(mode: FlightMode) -> None:
    pilot = make_quadrotor()
    set_mode(pilot, 1, custom_mode(mode) >> 16 & 255, custom_mode(mode) >> 24)
    assert pilot.commander.mode is mode
    assert execute(pilot, ARM) == REJECTED


def test_forced_arming_still_runs_the_checks() -> None:
    pilot = make_quadrotor()
    execute(pilot, LAND)
    assert execute(pilot, VehicleCommand(400, 1.0, 21196.0)) == REJECTED


def test_preflight_timeout_disarms() -> None:
    pilot = make_quadrotor()
    execute(pilot, ARM)
    run(pilot, 10.9)
    assert pilot.commander.armed
    run(pilot, 0.2)
    assert not pilot.commander.armed


def test_arming_sets_home() -> None:
    pilot = make_quadrotor()
    run(pilot, 2.0)
    execute(pilot, ARM)
    assert pilot.home.time_us == 2_000_000


# --- take-off, hold, land -------------------------------------------------------------------------------------------


def test_take_off_hold_and_land() -> None:
    pilot = make_quadrotor()
    execute(pilot, ARM)
    assert execute(pilot, TAKE_OFF) == ACCEPTED
    assert landed_state(pilot) is LandedState.ON_GROUND
    run(pilot, 3.0)
    assert landed_state(pilot) is LandedState.TAKEOFF
    run(pilot, 7.0)
    assert pilot.commander.mode is FlightMode.HOLD
    assert landed_state(pilot) is LandedState.IN_AIR
    assert pilot.estimate().position_ned_m == pytest.approx((0.0, 0.0, -2.5), abs=0.05)
    assert execute(pilot, LAND) == ACCEPTED
    run(pilot, 1.0)
    assert landed_state(pilot) is LandedState.LANDING
    assert pilot.estimate().velocity_ned_m_s[2] == pytest.approx(0.7, abs=0.1)
    run(pilot, 5.0)
    assert landed_state(pilot) is LandedState.ON_GROUND
    run(pilot, 2.0)
    assert not pilot.commander.armed
    assert pilot.commander.mode is FlightMode.HOLD


def test_take_off_to_a_given_altitude() -> None:
    pilot = make_quadrotor()
    execute(pilot, ARM)
    execute(pilot, VehicleCommand(22, p7=to_global((0.0, 0.0, -4.0)).altitude_m))
    run(pilot, 10.0)
    assert pilot.estimate().position_ned_m[2] == pytest.approx(-4.0, abs=0.05)


def test_nothing_but_take_off_lifts_off() -> None:
    pilot = make_quadrotor()
    execute(pilot, ARM)
    run(pilot, 5.0)
    assert pilot.commander.landed
    assert pilot.estimate().position_ned_m == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("bandwidth_rad_s", [3.0, 5.5, 20.0])
def test_hold_is_stable_on_slow_attitude_loops(bandwidth_rad_s: float) -> None:
    pilot = airborne(make_quadrotor(bandwidth_rad_s))
    execute(pilot, VehicleCommand(192, p2=1.0, p4=1.0, p5=math.nan, p6=math.nan, p7=math.nan))
    pilot.navigator.go_to((4.0, -3.0, -3.5), None)
    farthest = 0.0
    for _ in range(200):
        run(pilot, 0.1)
        farthest = max(farthest, pilot.estimate().position_ned_m[0])
    state = pilot.estimate()
    assert state.position_ned_m == pytest.approx((4.0, -3.0, -3.5), abs=0.1)
    assert math.dist(state.velocity_ned_m_s, (0.0, 0.0, 0.0)) < 0.05
    assert farthest < 4.5
    assert yaw_of(state.q_wxyz) == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize("yaw_rad", [0.0, 1.0, 3.1, -2.0])
def test_attitude_from_acceleration(yaw_rad: float) -> None:
    wanted = (1.0, -2.0, 0.5)
    w, x, y, z = attitude_from_acceleration(*wanted, yaw_rad)
    down = (2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y))
    force = math.hypot(wanted[0], wanted[1], wanted[2] - 9.81)
    reached = [-force * d + g for d, g in zip(down, (0.0, 0.0, 9.81), strict=True)]
    assert reached == pytest.approx(wanted, abs=1e-9)
    assert math.cos(yaw_of((w, x, y, z)) - yaw_rad) > 0.99


def test_return_from_afar_climbs_travels_and_lands() -> None:
    pilot = airborne(make_quadrotor(RTL_RETURN_ALT=6.0, RTL_DESCEND_ALT=4.0))
    pilot.navigator.go_to((15.0, 0.0, -2.5), None)
    run(pilot, 20.0)
    assert execute(pilot, VehicleCommand(20)) == ACCEPTED
    highest = 0.0
    for _ in range(400):
        run(pilot, 0.1)
        highest = min(highest, pilot.estimate().position_ned_m[2])
    assert highest == pytest.approx(-6.0, abs=0.6)
    assert not pilot.commander.armed
    assert math.hypot(*pilot.estimate().position_ned_m[:2]) < 0.7


# --- OFFBOARD -------------------------------------------------------------------------------------------------------


def test_set_mode_is_answered_twice_and_only_the_second_counts() -> None:
    pilot = airborne(make_quadrotor())
    assert execute(pilot, OFFBOARD) == (Result.ACCEPTED, Result.TEMPORARILY_REJECTED)
    assert pilot.commander.mode is FlightMode.HOLD
    stream(pilot, 0.1)
    assert execute(pilot, OFFBOARD) == (Result.ACCEPTED, Result.ACCEPTED)
    assert pilot.commander.mode is FlightMode.OFFBOARD


def test_an_old_setpoint_does_not_open_offboard() -> None:
    pilot = airborne(make_quadrotor())
    pilot.on_attitude_target(LEVEL, HOVER)
    run(pilot, 1.1)
    assert execute(pilot, OFFBOARD)[-1] is Result.TEMPORARILY_REJECTED


def test_silence_holds_the_last_setpoint_then_returns() -> None:
    pilot = in_offboard(airborne(make_quadrotor()))
    tilted = (math.cos(0.05), 0.0, -math.sin(0.05), 0.0)
    stream(pilot, 0.1, tilted)
    run(pilot, 0.9)  # the last one was 20 ms before: 0.92 s ago
    assert pilot.commander.mode is FlightMode.OFFBOARD
    assert pilot.setpoint.q_wxyz == pytest.approx(tilted)
    assert pilot.setpoint.thrust == HOVER
    run(pilot, 0.2)
    assert pilot.commander.mode is FlightMode.RTL
    assert pilot.commander.user_mode is FlightMode.OFFBOARD
    assert pilot.commander.failsafe


def test_loss_time_is_a_parameter() -> None:
    pilot = in_offboard(airborne(make_quadrotor(COM_OF_LOSS_T=0.3)))
    run(pilot, 0.25)
    assert pilot.commander.mode is FlightMode.OFFBOARD
    run(pilot, 0.1)
    assert pilot.commander.mode is FlightMode.RTL


@pytest.mark.parametrize(
    ("action", "mode"),
    [
        (OffboardLossAction.POSITION, FlightMode.RTL),  # no pilot: NAV_RCL_ACT decides
        (OffboardLossAction.STABILIZED, FlightMode.RTL),
        (OffboardLossAction.RETURN, FlightMode.RTL),
        (OffboardLossAction.LAND, FlightMode.LAND),
        (OffboardLossAction.HOLD, FlightMode.HOLD),
        (OffboardLossAction.TERMINATE, FlightMode.TERMINATION),
    ],
)
def test_loss_action(action: OffboardLossAction, mode: FlightMode) -> None:
    pilot = in_offboard(airborne(make_quadrotor(COM_OBL_RC_ACT=int(action))))
    run(pilot, 1.1)
    assert pilot.commander.mode is mode
    assert pilot.commander.armed


def test_loss_action_disarm() -> None:
    pilot = in_offboard(airborne(make_quadrotor(COM_OBL_RC_ACT=int(OffboardLossAction.DISARM))))
    run(pilot, 1.1)
    assert not pilot.commander.armed


def test_loss_with_a_pilot_hands_over() -> None:
    pilot = in_offboard(airborne(make_quadrotor()))
    pilot.commander.manual_control = True
    run(pilot, 1.1)
    assert pilot.commander.mode is FlightMode.POSCTL


def test_a_resumed_stream_returns_to_offboard_by_itself() -> None:
    for action in (OffboardLossAction.RETURN, OffboardLossAction.LAND):
        pilot = in_offboard(airborne(make_quadrotor(COM_OBL_RC_ACT=int(action))))
        run(pilot, 1.5)
        assert pilot.commander.failsafe
        pilot.on_attitude_target(LEVEL, HOVER)
        assert pilot.commander.mode is FlightMode.OFFBOARD
        assert not pilot.commander.failsafe
        assert pilot.setpoint == (LEVEL, HOVER)


def test_another_mode_asked_for_in_between_stays() -> None:
    pilot = in_offboard(airborne(make_quadrotor()))
    run(pilot, 1.5)
    assert execute(pilot, HOLD)[-1] is Result.ACCEPTED
    assert pilot.commander.mode is FlightMode.HOLD
    assert not pilot.commander.failsafe
    stream(pilot, 0.5)
    assert pilot.commander.mode is FlightMode.HOLD


def test_return_asked_for_during_the_failsafe_stays() -> None:
    pilot = in_offboard(airborne(make_quadrotor()))
    run(pilot, 1.5)
    assert execute(pilot, VehicleCommand(20)) == ACCEPTED
    stream(pilot, 0.5)
    assert pilot.commander.mode is FlightMode.RTL


def test_setpoints_are_not_flown_outside_offboard() -> None:
    pilot = airborne(make_quadrotor())
    stream(pilot, 1.0, (math.cos(0.1), 0.0, -math.sin(0.1), 0.0))
    assert pilot.commander.mode is FlightMode.HOLD
    assert math.hypot(*pilot.estimate().position_ned_m[:2]) < 0.01


def test_setpoints_are_not_validated() -> None:
    pilot = in_offboard(airborne(make_quadrotor()))
    pilot.on_attitude_target((2.0, 0.0, 0.0, 0.0), 1.5)
    assert pilot.setpoint == (LEVEL, 1.0)
    pilot.on_attitude_target((math.nan, 0.0, 0.0, 0.0), HOVER)
    assert pilot.setpoint.thrust == HOVER
    assert all(map(math.isnan, pilot.setpoint.q_wxyz)), "nothing controls the rotation"
    run(pilot, 0.9)
    assert pilot.commander.mode is FlightMode.OFFBOARD, "yet the stream counts as alive"
    assert all(map(math.isfinite, pilot.estimate().position_ned_m))


def test_throttle_ignore_means_no_thrust() -> None:
    pilot = in_offboard(airborne(make_quadrotor()))
    pilot.on_attitude_target(LEVEL, HOVER, 0x07 | 0x40)
    assert pilot.setpoint.thrust == 0.0


def test_a_setpoint_without_attitude_and_rates_is_none() -> None:
    pilot = airborne(make_quadrotor())
    pilot.on_attitude_target(LEVEL, HOVER, 0x87)
    assert execute(pilot, OFFBOARD)[-1] is Result.TEMPORARILY_REJECTED
    pilot.on_attitude_target(LEVEL, HOVER, 0x80)
    assert execute(pilot, OFFBOARD)[-1] is Result.ACCEPTED


def test_offboard_is_read_after_an_automatic_landing() -> None:
    pilot = in_offboard(airborne(make_quadrotor()))
    execute(pilot, LAND)
    run(pilot, 12.0)
    assert not pilot.commander.armed
    assert pilot.commander.mode is FlightMode.OFFBOARD
    assert base_mode(pilot) == 17


def test_termination_is_final() -> None:
    pilot = airborne(make_quadrotor())
    assert execute(pilot, VehicleCommand(185, 1.0)) == ACCEPTED
    run(pilot, 0.1)
    assert pilot.setpoint.thrust == 0.0
    assert system_status(pilot) == 8
    assert execute(pilot, HOLD)[-1] is Result.TEMPORARILY_REJECTED


def test_commands_nobody_knows() -> None:
    pilot = make_quadrotor()
    assert execute(pilot, VehicleCommand(31999)) == (Result.UNSUPPORTED,)
    assert execute(pilot, VehicleCommand(176, 1.0, 4.0, 99.0)) == (Result.ACCEPTED, Result.TEMPORARILY_REJECTED)
    assert execute(pilot, VehicleCommand(185, 1.0)) == (Result.DENIED,), "disarmed"
    assert execute(pilot, VehicleCommand(246, 1.0)) == (Result.DENIED,)


# --- rig ------------------------------------------------------------------------------------------------------------


def test_rig_neither_takes_off_nor_returns() -> None:
    pilot = make_rig()
    assert execute(pilot, TAKE_OFF) == REJECTED
    assert execute(pilot, VehicleCommand(20)) == REJECTED
    assert execute(pilot, ARM) == ACCEPTED
    run(pilot, 0.1)
    assert landed_state(pilot) is LandedState.IN_AIR
    assert execute(pilot, TAKE_OFF) == REJECTED
    assert pilot.commander.mode is FlightMode.HOLD
    run(pilot, 30.0)
    assert pilot.commander.armed, "no preflight timeout: it counts as flying"


def test_rig_loses_the_stream_into_hold_and_comes_back() -> None:
    pilot = make_rig()
    execute(pilot, ARM)
    run(pilot, 0.1)
    in_offboard(pilot)
    stream(pilot, 1.0, (math.cos(0.1), 0.0, -math.sin(0.1), 0.0))
    run(pilot, 1.1)
    assert pilot.commander.mode is FlightMode.HOLD
    assert pilot.commander.failsafe
    assert pilot.setpoint.thrust == HOVER
    start = pilot.estimate().position_ned_m[0]
    run(pilot, 15.0)
    assert abs(pilot.estimate().velocity_ned_m_s[0]) < 0.05
    assert abs(pilot.estimate().position_ned_m[0] - start) < 1.0
    pilot.on_attitude_target(LEVEL, HOVER)
    assert pilot.commander.mode is FlightMode.OFFBOARD


def test_rig_lands_by_stopping_its_motors() -> None:
    pilot = make_rig()
    execute(pilot, ARM)
    run(pilot, 0.5)
    assert execute(pilot, DISARM) == REJECTED
    execute(pilot, LAND)
    run(pilot, 0.1)
    assert pilot.setpoint.thrust == 0.0
    run(pilot, 2.5)
    assert not pilot.commander.armed


# --- time -----------------------------------------------------------------------------------------------------------


def test_time_moves_in_physics_steps_and_however_cut() -> None:
    whole, pieces = airborne(make_quadrotor()), airborne(make_quadrotor())
    whole.advance(whole.time_us + 1_000_000)
    while pieces.time_us < whole.time_us:
        pieces.advance(min(pieces.time_us + 3_700, whole.time_us))
    assert pieces.time_us == whole.time_us
    assert pieces.estimate() == whole.estimate()
    whole.advance(whole.time_us + 999)
    assert whole.time_us == pieces.time_us
