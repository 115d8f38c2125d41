"""Scenarios of an estimate that is wrong in one quantity, or whose own account of itself cannot be believed.

Wind and noise are on, and a fence of 2 m. `benchmarks/lies.py` flies each kind on each quantity.
"""

from __future__ import annotations

import math
from typing import Final

from companion.flight.authority.states import Reason
from sitl.scenarios.catalogue.flight import DONE, RATE
from sitl.scenarios.faults import Blow, SlowClock
from sitl.scenarios.lies import Blink, CountResets, Fail, Hold, TellLie
from sitl.scenarios.scenario import Scenario
from sitl.world.environment import Turbulence, Wind
from sitl.world.lies import Kind

FENCED: Final = (
    RATE,
    "mission.duration_s=30",
    "mission.waypoints=[]",
    "guards.fence={enabled: true, radius_m: 2, lower_ned_m: [-2, -2, -2], upper_ned_m: [2, 2, 2]}",
)
NOISY: Final = (*FENCED, "plant.sensors={position_m: 0.02, velocity_m_s: 0.03, attitude_deg: 0.3}")
AIDED: Final = (*FENCED, "plant.sensors={preset: motion_capture}", "estimator={preset: motion_capture}")
_WIND: Final = (0.8, Blow(Wind((4.0, 3.0, 0.0), None, Turbulence(7.7, 6.0))))
_NOT_LEFT_M: Final = 5.0  # the fence, and 3 m
_FALLS_AWAY: Final = 20.0  # in the autopilot's own hands, which believes the same

LIES: Final = (
    Scenario(
        "stuck_x_and_vx",
        "north, and velocity north, keep their values; all others move",
        Reason.ESTIMATE_STUCK,
        (_WIND, (3.0, TellLie(Kind.STUCK, ("x", "vx"))),),
        overrides=NOISY,
        by_s=3.4,
        stays_within_m=1.0,
        margin_m=_FALLS_AWAY,
    ),
    Scenario(
        "stuck_position",
        "position keeps its value, velocity is noise of 1 cm/s",
        Reason.ESTIMATE_STUCK,
        (_WIND, (3.0, TellLie(Kind.STUCK, ("x", "y", "z"))), (3.0, TellLie(Kind.NOISE, ("vx", "vy", "vz"), 0.01))),
        overrides=NOISY,
        by_s=3.4,
        stays_within_m=1.0,
        margin_m=_FALLS_AWAY,
    ),
    Scenario(
        "steps_uncounted",
        "position steps by 0.45 m each second and nobody counts it",
        Reason.ESTIMATOR_STEPS,
        (_WIND, (3.0, TellLie(Kind.STEP, ("x",), 0.45)),),
        overrides=NOISY,
        by_s=6.2,
        stays_within_m=2.0,
        margin_m=_FALLS_AWAY,
        error_m=1.5,
    ),
    Scenario(
        "slide_slow",
        "position slides by 0.3 m/s under motion capture, velocity does not know",
        Reason.POSITION_SLIDE,
        (_WIND, (3.0, TellLie(Kind.SLIDE, ("x",), 0.3)),),
        overrides=AIDED,
        stays_within_m=_NOT_LEFT_M,
        margin_m=_FALLS_AWAY,
        limit_s=40.0,
    ),
    Scenario(
        "slide_vertical",
        "height slides by 1 m/s, vertical velocity does not know",
        Reason.HEIGHT_SLIDE,
        (_WIND, (3.0, TellLie(Kind.SLIDE, ("z",), -1.0)),),
        overrides=NOISY,
        stays_within_m=_NOT_LEFT_M,
        margin_m=_FALLS_AWAY,
        error_m=1.5,
    ),
    Scenario(
        "drift_sudden",
        "position and velocity agree that it sinks at 9 m/s, which no thrust has made",
        Reason.UNEXPLAINED_MOTION,
        (_WIND, (3.0, TellLie(Kind.DRIFT, ("z",), 9.0)),),
        overrides=(
            *NOISY,
            "guards.fence.enabled=false",
            "guards.tracking_error_m.enabled=false",
            "guards.envelope.enabled=false",
            "guards.thrust_saturation.enabled=false",
        ),
        by_s=4.0,
        stays_within_m=_NOT_LEFT_M,
        margin_m=_FALLS_AWAY,
        error_m=6.0,
    ),
    Scenario(
        "variance_blinks",
        "a variance of 5 m2 that is no number for 50 ms in each 250",
        Reason.POSITION_VARIANCE,
        (_WIND, (2.0, Blink(5.0, math.nan)),),
        overrides=NOISY,
        by_s=2.5,
        stays_within_m=0.5,
    ),
    Scenario(
        "variance_of_zero",
        "the variance that was told is zero",
        Reason.POSITION_VARIANCE,
        (_WIND, (2.0, Blink(0.0, 0.0)),),
        overrides=NOISY,
        by_s=2.5,
        stays_within_m=0.5,
    ),
    Scenario(
        "odometry_failed",
        "the odometry says that it has failed",
        Reason.ESTIMATOR_FLAGS,
        (_WIND, (2.0, Fail()),),
        overrides=NOISY,
        by_s=2.5,
        stays_within_m=0.5,
    ),
    Scenario(
        "content_slow",
        "the pose changes four times a second under 125 stamps",
        Reason.POSE_RATE,
        (_WIND, (2.0, Hold(4.0)),),
        overrides=(*NOISY, "guards.estimate_stuck_s.enabled=false"),
        by_s=4.0,
        stays_within_m=1.0,
        margin_m=6.0,
    ),
    Scenario(
        "counter_runs",
        "the reset counter changes with every step of the estimator",
        Reason.ESTIMATOR_STEPS,
        (_WIND, (2.0, CountResets()),),
        overrides=NOISY,
        by_s=2.3,
        stays_within_m=0.5,
        events=("reseated",),
    ),
    Scenario(
        "clock_fast",
        "the vehicle's clock runs 10 % faster than ours",
        Reason.CLOCK_RATE,
        (_WIND, (2.0, SlowClock(1.1)),),
        overrides=(*NOISY, "attitude.x.delay_s=[0.02, 0.2]", "attitude.y.delay_s=[0.02, 0.2]"),
        own_clock=True,
        by_s=8.0,
        stays_within_m=1.0,
        limit_s=20.0,
    ),
    Scenario(
        "honest",
        "none of it: the same wind and noise by GPS, for a minute",
        DONE,
        (_WIND,),
        overrides=(*FENCED, "plant.sensors={preset: gps}", "estimator={preset: gps}", "mission.duration_s=60",
                   "controller.estimate_correction={}"),
        stays_within_m=3.0,
        error_m=2.0,
        limit_s=70.0,
    ),
)  # fmt: skip
