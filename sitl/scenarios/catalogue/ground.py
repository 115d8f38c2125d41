"""Scenarios of the ground and of what carries the vehicle: where control may begin, with what thrust, and a landing."""

from __future__ import annotations

from functools import partial
from typing import Final

from companion.flight.authority.states import Reason
from sitl.autopilot.modes import FlightMode
from sitl.scenarios.actors import LiftsOffAndSwitches
from sitl.scenarios.catalogue.flight import DONE, HOVER, RATE
from sitl.scenarios.faults import Mute
from sitl.scenarios.scenario import Scenario

_EXTENDED_SYS_STATE: Final = 245
_DOWN: Final = (RATE, "mission.duration_s=30", "mission.waypoints=[{at_s: 1, offset_ned_m: [0, 0, 6]}]")
_NOISE: Final = "plant.sensors={position_m: 0.01, velocity_m_s: 0.02, attitude_deg: 0.2}"

_heavy = partial(Scenario, reason=DONE, stays_within_m=0.05)
# Landed in Land, PX4 disarms and is in the mode before it.
_landing = partial(
    Scenario,
    reason=Reason.LANDED,
    ends_in=(FlightMode.OFFBOARD,),
    armed=False,
    limit_s=30.0,
    coast_s=10.0,
    stays_within_m=6.0,
    error_m=6.0,
)

GROUND: Final = (
    _heavy(
        "heavy_take_over",
        "20 % heavier than believed, it is taken over with the thrust that PX4 flies",
        overrides=(*HOVER, "plant.mismatch={mass: 1.2}"),
    ),
    _heavy(
        "heavy_take_over_config",
        "the same where the hover thrust of the config is kept",
        overrides=(
            *HOVER,
            "plant.mismatch={mass: 1.2}",
            "vehicle.hover_thrust_source=config",
            "guards.hover_thrust.enabled=false",
        ),
    ),
    _heavy(
        "light_take_over",
        "20 % lighter than believed",
        overrides=(*HOVER, "plant.mismatch={mass: 0.8}"),
    ),
    _heavy(
        "hover_thrust_untrue",
        "MPC_THR_HOVER is 0.35 where 0.49 carries it: it is not believed",
        overrides=(*HOVER, "plant.parameters={MPC_THR_HOVER: 0.35}"),
        events=("remark",),
    ),
    Scenario(
        "switched_while_lifting_off",
        "the pilot lifts off and switches at 0.4 m: no control yet, and no fall",
        Reason.ON_GROUND,
        overrides=HOVER,
        airborne=False,
        pilot=False,
        before=(LiftsOffAndSwitches(0.4),),
        engaged=False,
        least_thrust=0.45,
    ),
    Scenario(
        "landed_state_untold",
        "a vehicle that does not tell whether it flies is not flown",
        Reason.ON_GROUND,
        overrides=HOVER,
        before=(Mute(_EXTENDED_SYS_STATE),),
        engaged=False,
        least_thrust=0.45,
    ),
    _landing(
        "lands_in_control",
        "the mission goes below the ground: it lands, control ends, and PX4 disarms",
        overrides=(*_DOWN, _NOISE),
    ),
    _landing(
        "lands_by_px4",
        "the same where only PX4 looks for the ground",
        overrides=(
            *_DOWN,
            _NOISE,
            *(
                f"guards.{name}.enabled=false"
                for name in ("ground_contact", "unexplained_motion_m_s", "thrust_saturation", "hover_thrust")
            ),
        ),
    ),
)
