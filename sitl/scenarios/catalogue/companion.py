"""Scenarios of the companion itself: a second one beside it, a gain that is changed, a restart in flight."""

from __future__ import annotations

from typing import Final

from companion.flight.authority.states import Reason
from sitl.autopilot.modes import FlightMode
from sitl.scenarios.actors import AlreadyInOffboard, OperatorStops, PilotTakes, Rival, SetParameter
from sitl.scenarios.catalogue.flight import BY_ITSELF, DONE, HOVER
from sitl.scenarios.faults import Mute
from sitl.scenarios.scenario import Scenario

_CURRENT_MODE: Final = 436
_GAIN: Final = ("vehicle.parameters={MC_ROLL_P: 4.0}", "plant.parameters={MC_ROLL_P: 4.0}")

COMPANION: Final = (
    Scenario(
        "second_companion",
        "another companion of the same name is on the link",
        Reason.SECOND_COMPANION,
        overrides=HOVER,
        before=(Rival(same_name=True),),
        pilot=False,
        own_clock=True,
        engaged=False,
        streams=False,
        coast_s=0.1,
        events=("second_companion",),
    ),
    Scenario(
        "second_stream",
        "somebody else streams set-points to the vehicle",
        Reason.SECOND_COMPANION,
        overrides=HOVER,
        before=(Rival(same_name=False),),
        pilot=False,
        own_clock=True,
        engaged=False,
        streams=False,
        coast_s=0.1,
        events=("second_companion",),
    ),
    Scenario(
        "second_stream_later",
        "somebody else begins to stream: it is told, and control goes on",
        DONE,
        ((2.0, Rival(same_name=False)),),
        overrides=HOVER,
        stays_within_m=0.3,
        events=("second_companion",),
    ),
    Scenario(
        "gain_changed",
        "a gain is changed at stand-by: the certificate is not for it",
        Reason.CERTIFICATE_STALE,
        ((5.0, SetParameter("MC_ROLL_P", 6.5)),),
        overrides=(*HOVER, *_GAIN),
        pilot=False,
        own_clock=True,
        engaged=False,
        coast_s=0.1,
        events=("standby", "parameter_changed"),
    ),
    Scenario(
        "gain_changed_later",
        "a gain is changed in control: it is told, and control goes on",
        DONE,
        ((1.0, SetParameter("MC_ROLL_P", 6.5)),),
        overrides=(*HOVER, *_GAIN, "mission.duration_s=3"),
        own_clock=True,
        stays_within_m=0.3,
        coast_s=0.5,
        events=("parameter_changed",),
    ),
    Scenario(
        "restart",
        "the companion comes back while OFFBOARD is intended: it touches nothing",
        Reason.OPERATOR,
        ((3.0, OperatorStops()),),
        overrides=HOVER,
        pilot=False,
        before=(AlreadyInOffboard(),),
        own_clock=True,
        engaged=False,
        streams=False,
        ends_in=BY_ITSELF,
        coast_s=0.2,
    ),
    Scenario(
        "restart_untold",
        "the same on a PX4 that does not tell what is intended: its Return is taken for no pilot's",
        Reason.OPERATOR,
        ((8.0, OperatorStops()),),
        overrides=HOVER,
        pilot=False,
        before=(AlreadyInOffboard(), Mute(_CURRENT_MODE)),
        own_clock=True,
        engaged=False,
        streams=False,
        ends_in=BY_ITSELF,
        coast_s=0.2,
    ),
    Scenario(
        "restart_and_again",
        "after a restart the pilot chooses Hold, and OFFBOARD again",
        Reason.OPERATOR,
        ((2.5, PilotTakes(FlightMode.HOLD)), (4.0, PilotTakes(FlightMode.OFFBOARD)), (5.5, OperatorStops())),
        overrides=HOVER,
        pilot=False,
        before=(AlreadyInOffboard(),),
        own_clock=True,
        coast_s=0.5,
    ),
)
