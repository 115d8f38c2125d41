"""Scenarios of authority: pilots who switch, disarm and kill, and an operator who has had enough."""

from __future__ import annotations

from functools import partial
from typing import Final

from companion.flight.authority.states import Reason
from sitl.autopilot.modes import FlightMode
from sitl.scenarios.actors import OperatorStops, PilotArms, PilotDisarms, PilotKills, PilotTakes
from sitl.scenarios.catalogue.flight import FAULT, HOVER, STEP
from sitl.scenarios.scenario import Scenario

# From the ground, with a pilot who does not take off: no thrust, and PX4 disarms by itself (COM_DISARM_PRFLT).
_on_the_ground = partial(
    Scenario,
    reason=Reason.ON_GROUND,
    overrides=HOVER,
    airborne=False,
    engaged=False,
    armed=False,
    coast_s=14.0,
    stays_within_m=0.0,
    margin_m=0.0,
    events=("standby",),
)

AUTHORITY: Final = (
    _on_the_ground(
        name="on_ground_then_armed",
        about="the pilot chooses OFFBOARD while it is disarmed on the ground, and arms",
        before=(PilotArms(FlightMode.OFFBOARD),),
    ),
    _on_the_ground(
        name="on_ground_armed",
        about="the pilot arms on the ground in Hold, and chooses OFFBOARD there",
        before=(PilotArms(FlightMode.HOLD),),
    ),
    _on_the_ground(
        name="on_ground_noisy",
        about="the same with the estimate of a GPS, which is never at rest",
        overrides=(*HOVER, "plant.sensors={preset: gps}"),
        own_clock=True,
        before=(PilotArms(FlightMode.OFFBOARD),),
    ),
    Scenario(
        "pilot_position",
        "the pilot takes over with the sticks",
        Reason.MODE_CHANGED,
        ((2.0, PilotTakes(FlightMode.POSCTL)),),
        overrides=STEP,
        ends_in=(FlightMode.POSCTL,),
        by_s=2.2,
        stays_within_m=2.0,
    ),
    Scenario(
        "pilot_hold",
        "the pilot chooses Hold",
        Reason.MODE_CHANGED,
        ((2.0, PilotTakes(FlightMode.HOLD)),),
        overrides=STEP,
        by_s=2.2,
        stays_within_m=2.0,
    ),
    Scenario(
        "pilot_returns",
        "the pilot chooses Return",
        Reason.MODE_CHANGED,
        ((2.0, PilotTakes(FlightMode.RTL)),),
        overrides=STEP,
        by_s=2.2,
        stays_within_m=4.0,
        ends_in=(FlightMode.RTL,),
    ),
    Scenario(
        "pilot_asks_again",
        "the pilot takes over and asks for OFFBOARD again: nobody streams, nobody fights",
        Reason.MODE_CHANGED,
        ((2.0, PilotTakes(FlightMode.HOLD)), (3.5, PilotTakes(FlightMode.OFFBOARD))),
        overrides=HOVER,
        by_s=2.2,
        stays_within_m=1.0,
        coast_s=3.0,
    ),
    Scenario(
        "pilot_and_fault",
        "the pilot switches a moment before a fault releases: the pilot keeps it",
        Reason.ESTIMATOR_JUMP,
        ((1.99, PilotTakes(FlightMode.POSCTL)), (2.0, FAULT)),
        overrides=(*HOVER, "plant.telemetry=even"),  # PX4 tells the mode at once, and it would be no race
        ends_in=(FlightMode.POSCTL,),
        by_s=2.2,
        stays_within_m=2.0,
    ),
    Scenario(
        "pilot_disarms",
        "the pilot disarms in the air",
        Reason.DISARMED,
        ((2.0, PilotDisarms()),),
        overrides=HOVER,
        ends_in=(FlightMode.HOLD, FlightMode.OFFBOARD),
        armed=False,
        stays_within_m=6.0,
        error_m=6.0,
    ),
    Scenario(
        "pilot_kills",
        "the kill switch",
        Reason.KILLED,
        ((2.0, PilotKills()),),
        overrides=HOVER,
        ends_in=(FlightMode.RTL, FlightMode.OFFBOARD),
        armed=True,
        stays_within_m=6.0,
        error_m=6.0,
        coast_s=0.5,
    ),
    Scenario(
        "terminated",
        "flight termination",
        Reason.KILLED,
        ((2.0, PilotTakes(FlightMode.TERMINATION)),),
        overrides=HOVER,
        ends_in=(FlightMode.TERMINATION,),
        armed=True,
        stays_within_m=6.0,
        error_m=6.0,
        coast_s=0.5,
    ),
    Scenario(
        "operator",
        "Ctrl-C",
        Reason.OPERATOR,
        ((2.0, OperatorStops()),),
        overrides=HOVER,
        by_s=2.1,
        stays_within_m=0.3,
    ),
)
