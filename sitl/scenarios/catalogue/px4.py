"""Scenarios of the autopilot: a PX4 that refuses, is slow, says what it does not do, or fails safe by itself."""

from __future__ import annotations

from functools import partial
from typing import Final

from companion.flight.authority.states import Reason
from sitl.autopilot.modes import FlightMode
from sitl.autopilot.request_faults import Answer
from sitl.scenarios.actors import AnswerTo, AnswerToArming, FailSafe, PilotTakes, Recover, SticksMove
from sitl.scenarios.catalogue.flight import BY_ITSELF, DONE, FAULT, HOVER
from sitl.scenarios.scenario import Scenario

_engaging = partial(Scenario, overrides=HOVER, airborne=False, engage=True)  # `--engage`, from the ground

PX4: Final = (
    Scenario(
        "px4_fails_safe",
        "PX4 returns by itself, OFFBOARD still intended",
        Reason.MODE_CHANGED,
        ((2.0, FailSafe(FlightMode.RTL)),),
        overrides=HOVER,
        ends_in=BY_ITSELF,
        by_s=2.2,
        stays_within_m=3.0,
    ),
    Scenario(
        "px4_recovers",
        "PX4's failsafe ends: without a stream it does not come back to OFFBOARD",
        Reason.MODE_CHANGED,
        ((2.0, FailSafe(FlightMode.HOLD)), (4.5, Recover())),
        overrides=HOVER,
        ends_in=BY_ITSELF,
        by_s=2.2,
        coast_s=4.0,
        stays_within_m=4.0,
    ),
    Scenario(
        "px4_refuses_hold",
        "a fault, and PX4 refuses Hold: silence, and its own failsafe",
        Reason.ESTIMATOR_JUMP,
        ((1.5, AnswerTo(FlightMode.HOLD, Answer.REFUSED)), (2.0, FAULT)),
        overrides=HOVER,
        ends_in=BY_ITSELF,
        coast_s=3.0,
        stays_within_m=4.0,
    ),
    Scenario(
        "px4_ignores_hold",
        "a fault, and PX4 acknowledges Hold and does not do it",
        Reason.ESTIMATOR_JUMP,
        ((1.5, AnswerTo(FlightMode.HOLD, Answer.EMPTY)), (2.0, FAULT)),
        overrides=HOVER,
        ends_in=BY_ITSELF,
        coast_s=3.0,
        stays_within_m=4.0,
    ),
    Scenario(
        "px4_slow",
        "a fault, and Hold comes 0.8 s later",
        Reason.ESTIMATOR_JUMP,
        ((1.5, AnswerTo(FlightMode.HOLD, Answer.LATE, 0.8)), (2.0, FAULT)),
        overrides=HOVER,
        stays_within_m=3.0,
    ),
    Scenario(
        "release_to_land",
        "where the config says so, a release lands it",
        Reason.ESTIMATOR_JUMP,
        ((2.0, FAULT),),
        overrides=(*HOVER, "release.mode=land"),
        ends_in=(FlightMode.LAND,),
        stays_within_m=6.0,
    ),
    Scenario(
        "release_to_return",
        "where the config says so, a release returns it",
        Reason.ESTIMATOR_JUMP,
        ((2.0, FAULT),),
        overrides=(*HOVER, "release.mode=return"),
        ends_in=(FlightMode.RTL,),
        stays_within_m=6.0,
    ),
    Scenario(
        "sticks_v1_17",
        "sticks pushed hard leave OFFBOARD alone in PX4 v1.17 with default parameters",
        DONE,
        ((2.0, SticksMove(100.0, 5.0)),),
        overrides=(*HOVER, 'plant.px4_version="1.17"'),
    ),
    Scenario(
        "sticks_v1_18",
        "sticks pushed hard take OFFBOARD in PX4 v1.18 with default parameters",
        Reason.MODE_CHANGED,
        ((2.0, SticksMove(100.0, 5.0)),),
        overrides=(*HOVER, 'plant.px4_version="1.18"'),
        ends_in=(FlightMode.POSCTL,),
        by_s=2.2,
    ),
    Scenario(
        "landed_by_command",
        "the pilot lands it by command: disarmed, PX4 is in OFFBOARD again, and nobody flies it",
        Reason.MODE_CHANGED,
        ((2.0, PilotTakes(FlightMode.LAND)),),
        overrides=HOVER,
        ends_in=(FlightMode.OFFBOARD,),
        armed=False,
        by_s=2.2,
        coast_s=20.0,
        stays_within_m=5.0,
        margin_m=5.0,
    ),
    _engaging(
        "arming_refused",
        "PX4 does not arm",
        Reason.ENGAGE_REFUSED,
        before=(AnswerToArming(Answer.REFUSED),),
        engaged=False,
        armed=False,
        limit_s=30.0,
    ),
    _engaging(
        "arming_ignored",
        "PX4 says it armed and did not",
        Reason.ENGAGE_REFUSED,
        before=(AnswerToArming(Answer.EMPTY),),
        engaged=False,
        armed=False,
        limit_s=30.0,
    ),
    _engaging(
        "offboard_refused",
        "PX4 does not change to OFFBOARD",
        Reason.ENGAGE_REFUSED,
        before=(AnswerTo(FlightMode.OFFBOARD, Answer.REFUSED),),
        engaged=False,
        limit_s=60.0,
    ),
    _engaging(
        "offboard_ignored",
        "PX4 says it changed to OFFBOARD and did not",
        Reason.ENGAGE_REFUSED,
        before=(AnswerTo(FlightMode.OFFBOARD, Answer.EMPTY),),
        engaged=False,
        limit_s=60.0,
    ),
    _engaging(
        "offboard_late",
        "PX4 takes 1.5 s to change to OFFBOARD",
        DONE,
        before=(AnswerTo(FlightMode.OFFBOARD, Answer.LATE, 1.5),),
        limit_s=60.0,
    ),
)
