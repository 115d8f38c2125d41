"""Scenarios in which nothing is broken: free flight, weather, a vehicle that is not as believed, live commands."""

from __future__ import annotations

from typing import Final

from companion.flight.authority.states import Reason
from sitl.autopilot.modes import FlightMode
from sitl.scenarios.actors import Steer
from sitl.scenarios.faults import Blow, Jump, LoseMotor, Push, Sag
from sitl.scenarios.scenario import RIG, Scenario
from sitl.world.environment import Turbulence, Wind
from sitl.world.wind import Gust

DONE: Final = Reason.MISSION_COMPLETE
RATE: Final = "tick.rate_hz=125"
STEP: Final = (RATE, "mission.duration_s=8", "mission.waypoints=[{at_s: 1, offset_ned_m: [0.8, 0.4, -0.4]}]")
HOVER: Final = (RATE, "mission.duration_s=7", "mission.waypoints=[]")
LONG_HOVER: Final = (RATE, "mission.duration_s=11", "mission.waypoints=[]")
FAULT: Final = Jump((0.0, 0.0, -1.4))  # a release for a fault, at once
# Where PX4 goes without a stream: COM_OBL_RC_ACT is Position, there are no sticks, NAV_RCL_ACT is Return.
BY_ITSELF: Final = (FlightMode.RTL,)

_BREEZE: Final = Wind((5.0, 0.0, 0.0))
_GUSTS: Final = Wind((3.0, 2.0, 0.0), Gust((3.0, 0.0, 0.5), 0.0, 0.8, 0.5, 4.0))
_TURBULENCE: Final = Wind((4.0, 3.0, 0.0), None, Turbulence(7.7, 6.0))
_ALL_AT_ONCE: Final = (
    "plant.mismatch={mass: 1.2}",
    "plant.wind={mean_ned_m_s: [4, 3, 0], gust: {peak_ned_m_s: [2, 1, 0], rise_s: 1.0, hold_s: 1.0, every_s: 6.0}}",
    "plant.sensors={position_m: 0.02, velocity_m_s: 0.03, attitude_deg: 0.3, delay_s: 0.005}",
)
_STEERED: Final = (
    *LONG_HOVER,
    "guards.fence={enabled: true, radius_m: 5, lower_ned_m: [-5, -5, -4], upper_ned_m: [5, 5, 3]}",
    "steering={enabled: true, system_ids: [255]}",
)

FLIGHT: Final = (
    Scenario("free_flight", "a step in x, y and z", DONE, overrides=STEP, stays_within_m=1.2, error_m=0.1),
    Scenario(
        "take_off",
        "the companion arms, takes off, and flies a step",
        DONE,
        overrides=STEP,
        airborne=False,
        engage=True,
        stays_within_m=1.2,
        error_m=0.1,
        limit_s=60.0,
    ),
    Scenario(
        "stairs_with_everything",
        "1 m stairs in x, y and z and a turn by 90 degrees: 20 % too heavy, wind with gusts, noise",
        DONE,
        overrides=_ALL_AT_ONCE,
        stays_within_m=2.2,
        error_m=0.5,
        limit_s=70.0,
    ),
    Scenario(
        "turn",
        "the heading turns by 90 degrees while the place is kept",
        DONE,
        overrides=(RATE, "mission.duration_s=8", "mission.waypoints=[{at_s: 1, offset_ned_m: [0, 0, 0], yaw_deg: 90}]"),
        stays_within_m=0.2,
        error_m=0.1,
    ),
    Scenario(
        "far_away",
        "20 m from where it engaged it flies a step as well as at the start",
        DONE,
        overrides=(
            RATE,
            "mission.duration_s=26",
            "mission.waypoints=[{at_s: 1, offset_ned_m: [20, 0, 0]}, {at_s: 19, offset_ned_m: [20, 0.8, 0]}]",
        ),
        stays_within_m=21.0,
        error_m=0.2,
        limit_s=40.0,
    ),
    Scenario(
        "rig",
        "the rig along its guide",
        DONE,
        base=RIG,
        overrides=(
            "tick.rate_hz=250",
            "tick.floor_hz=200",
            "mission.duration_s=8",
            "mission.waypoints=[{at_s: 1, offset_ned_m: [0.35, 0, 0]}]",
        ),
        stays_within_m=0.6,
        error_m=0.15,
    ),
    Scenario(
        "rig_pushed",
        "a constant force of 0.3 m/s2 on the rig",
        DONE,
        base=RIG,
        overrides=("tick.rate_hz=250", "tick.floor_hz=200", "mission.duration_s=8", "mission.waypoints=[]"),
        happens=((1.0, Push(0.3)),),
        stays_within_m=0.4,
        error_m=0.3,
    ),
    # --- weather
    Scenario("wind", "5 m/s sets in at once", DONE, ((1.0, Blow(_BREEZE)),), overrides=HOVER, stays_within_m=0.5),
    Scenario("gusts", "gusts of 1-cosine shape", DONE, ((0.5, Blow(_GUSTS)),), overrides=LONG_HOVER),
    Scenario("turbulence", "Dryden turbulence in 5 m/s", DONE, ((0.5, Blow(_TURBULENCE)),), overrides=LONG_HOVER),
    # --- not as believed
    Scenario(
        "heavy", "20 % heavier than believed", DONE, overrides=(*STEP, "plant.mismatch={mass: 1.2}"), stays_within_m=1.5
    ),
    Scenario(
        "light", "20 % lighter than believed", DONE, overrides=(*STEP, "plant.mismatch={mass: 0.8}"), stays_within_m=1.5
    ),
    Scenario(
        "weak",
        "15 % less thrust than believed",
        DONE,
        overrides=(*STEP, "plant.mismatch={thrust: 0.85}"),
        stays_within_m=1.5,
    ),
    Scenario(
        "draggy",
        "four times the drag, in 3 m/s",
        DONE,
        overrides=(*STEP, "plant.mismatch={drag: 4}", "plant.wind={mean_ned_m_s: [3, 0, 0]}"),
        stays_within_m=1.5,
    ),
    Scenario("battery_sags", "2 % of the thrust lost a second", DONE, ((0.5, Sag(0.02)),), overrides=HOVER),
    Scenario(
        "motor_weakens",
        "10 % of the thrust lost at once, and 4 degrees of roll",
        DONE,
        ((1.0, LoseMotor(0.9, roll_deg=4.0)),),
        overrides=HOVER,
        stays_within_m=1.0,
    ),
    Scenario(
        "too_windy_for_doublets",
        "the wind is more than the tilt limit can hold against, so that no doublet can begin",
        Reason.NOT_CALM,
        ((0.5, Blow(Wind((6.5, 0.0, 0.0)))),),
        overrides=(
            RATE,
            "mission={identification: {amplitude_deg: 5, pause_s: 2}}",
            "controller.limits.tilt_deg=8",
            *(f"guards.{name}.enabled=false" for name in ("envelope", "tracking_error_m", "weights_on_bound")),
        ),
        limit_s=30.0,
        stays_within_m=40.0,
        margin_m=10.0,
        error_m=40.0,
    ),
    # --- live commands
    Scenario(
        "steered",
        "a MAVLink client moves it by SET_POSITION_TARGET_LOCAL_NED",
        DONE,
        ((1.0, Steer((2.0, 1.0, -1.0), yaw_deg=45.0)), (6.0, Steer((0.0, 0.0, 0.0)))),
        overrides=_STEERED,
        stays_within_m=2.8,
        error_m=0.2,
    ),
    Scenario(
        "steered_out_of_fence",
        "a command beyond the fence is refused",
        DONE,
        ((1.0, Steer((6.0, 0.0, 0.0))),),
        overrides=_STEERED,
        stays_within_m=0.2,
        error_m=0.1,
        events=("command_refused",),
    ),
    Scenario(
        "steered_by_velocity",
        "a command with a type mask that is not for places is refused",
        DONE,
        ((1.0, Steer((1.0, 0.0, 0.0), type_mask=0xDC7)),),
        overrides=_STEERED,
        stays_within_m=0.2,
        error_m=0.1,
        events=("command_refused",),
    ),
    Scenario(
        "steered_in_a_body_frame",
        "a command in another frame is refused",
        DONE,
        ((1.0, Steer((1.0, 0.0, 0.0), frame=8)),),
        overrides=_STEERED,
        stays_within_m=0.2,
        error_m=0.1,
        events=("command_refused",),
    ),
    Scenario(
        "steered_by_a_stranger",
        "a command of a system that may not steer",
        DONE,
        ((1.0, Steer((1.0, 0.0, 0.0))),),
        overrides=(*_STEERED, "steering.system_ids=[254]"),
        stays_within_m=0.2,
        error_m=0.1,
    ),
    Scenario(
        "steered_by_nobody",
        "where steering is off, nobody steers",
        DONE,
        ((1.0, Steer((1.0, 0.0, 0.0))),),
        overrides=HOVER,
        stays_within_m=0.2,
        error_m=0.1,
    ),
)
