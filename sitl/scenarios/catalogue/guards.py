"""Scenarios of the flight itself going wrong: what the guards on tracking, attitude, thrust and time are for."""

from __future__ import annotations

from typing import Final

from companion.flight.authority.states import Reason
from sitl.autopilot.modes import FlightMode
from sitl.scenarios.actors import Overrun
from sitl.scenarios.catalogue.flight import HOVER, LONG_HOVER, RATE
from sitl.scenarios.faults import Blow, Drift, LoseMotor, Sag
from sitl.scenarios.scenario import Scenario
from sitl.world.environment import Wind

_SICK: Final = LoseMotor(1.0)

GUARDS: Final = (
    Scenario(
        "fence",
        "a step up to the fence, and wind that takes it over",
        Reason.FENCE,
        ((3.0, Blow(Wind((9.0, 0.0, 0.0)))),),
        overrides=(
            RATE,
            "mission.duration_s=8",
            "mission.waypoints=[{at_s: 1, offset_ned_m: [1, 0, 0]}]",
            "guards.fence={enabled: true, radius_m: 1.2}",
        ),
        stays_within_m=1.5,
        margin_m=4.0,
    ),
    Scenario(
        "hover_thrust",
        "30 % too light for the hover thrust of its config: the loop's gain is as much too high",
        Reason.HOVER_THRUST,
        overrides=(*LONG_HOVER, "plant.mismatch={mass: 0.7}", "vehicle.hover_thrust_source=config"),
        stays_within_m=1.0,
    ),
    Scenario(
        "fence_box",
        "wind drives it out of a box",
        Reason.FENCE,
        ((1.0, Blow(Wind((0.0, 9.0, 0.0)))),),
        overrides=(*HOVER, "guards.fence={enabled: true, lower_ned_m: [-3, -0.3, -3], upper_ned_m: [3, 0.3, 3]}"),
        stays_within_m=0.6,
        margin_m=4.0,
    ),
    Scenario(
        "tracking_error",
        "a downdraught that the thrust does not hold against",
        Reason.TRACKING_ERROR,
        ((1.0, Blow(Wind((0.0, 0.0, 16.0)))),),
        overrides=(*HOVER, "guards.thrust_saturation.enabled=false", "guards.unexplained_motion_m_s.enabled=false"),
        stays_within_m=6.0,
        error_m=4.0,
        ends_in=(FlightMode.HOLD,),
    ),
    Scenario(
        "envelope",
        "wind beyond what the vehicle can lean against",
        Reason.ENVELOPE,
        ((1.0, Blow(Wind((13.0, 0.0, 0.0)))),),
        overrides=(
            *LONG_HOVER,
            "guards.tracking_error_m.enabled=false",
            "guards.weights_on_bound.enabled=false",
            "guards.unexplained_motion_m_s.enabled=false",
        ),
        stays_within_m=8.0,
        error_m=8.0,
        margin_m=20.0,
    ),
    Scenario(
        "tilt",
        "a blow turns it over by 110 degrees",
        Reason.TILT,
        ((2.0, LoseMotor(1.0, roll_deg=110.0)), (2.6, _SICK)),
        overrides=HOVER,
        stays_within_m=3.0,
        error_m=3.0,
        margin_m=12.0,
    ),
    Scenario(
        "tilt_error",
        "the attitude stays 30 degrees off its set-point",
        Reason.TILT_ERROR,
        ((2.0, LoseMotor(1.0, pitch_deg=30.0)), (3.2, _SICK)),
        overrides=(*HOVER, "guards.attitude_response_deg.enabled=false"),
        stays_within_m=5.0,
        error_m=3.0,
    ),
    Scenario(
        "attitude_response",
        "the attitude settles 14 degrees off its set-point",
        Reason.ATTITUDE_RESPONSE,
        ((2.0, LoseMotor(1.0, roll_deg=14.0)), (3.5, _SICK)),
        overrides=HOVER,
        stays_within_m=3.0,
        error_m=2.0,
    ),
    Scenario(
        "motor_lost",
        "a motor is lost: 40 % of the thrust, and 25 degrees of roll",
        Reason.ATTITUDE_RESPONSE,
        ((2.0, LoseMotor(0.6, roll_deg=25.0)),),
        overrides=HOVER,
        stays_within_m=3.0,
        error_m=4.0,
        margin_m=20.0,
    ),
    Scenario(
        "weights_on_bound",
        "wind that drives the weights to their bounds",
        Reason.WEIGHTS_ON_BOUND,
        ((1.0, Blow(Wind((6.0, 6.0, 0.0)))),),
        overrides=(*LONG_HOVER, "guards.weights_on_bound={limit: 1, timeout_s: 1}", "controller.bias.bound=0.1"),
        stays_within_m=3.0,
        error_m=2.0,
    ),
    Scenario(
        "thrust_saturation",
        "the battery gives out",
        Reason.THRUST_SATURATION,
        ((1.0, Sag(0.1)),),
        overrides=(*LONG_HOVER, "guards.hover_thrust.enabled=false", "guards.unexplained_motion_m_s.enabled=false"),
        stays_within_m=6.0,
        error_m=2.0,
    ),
    Scenario(
        "not_settled",
        "the position slides from the start and never settles",
        Reason.NOT_SETTLED,
        overrides=HOVER,
        before=(Drift((1.0, 0.0, 0.0)),),
        engaged=False,
        pilot=False,
        limit_s=70.0,
    ),
    Scenario(
        "flight_time",
        "the time in flight is limited",
        Reason.FLIGHT_TIME,
        overrides=(*HOVER, "guards.flight_time_s={enabled: true, limit: 3}"),
        by_s=3.1,
        stays_within_m=0.2,
    ),
    Scenario(
        "tick_overrun",
        "one tick takes 0.3 s",
        Reason.TICK_OVERRUN,
        ((0.5, Overrun(0.3)),),
        overrides=HOVER,
        own_clock=True,
        stays_within_m=0.5,
        coast_s=0.5,
    ),
)
