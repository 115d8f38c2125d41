"""Scenarios of the link: late, lossy, garbled, silent, gone."""

from __future__ import annotations

from typing import Final

from companion.flight.authority import Reason
from sitl.faults import Impair, Mute, Thin
from sitl.impairments import Impairments
from sitl.modes import Mode
from sitl.people import Forge, Stall, Unplug
from sitl.scenario import Scenario
from sitl.scenarios_flight import DONE, HOVER, LONG_HOVER, STEP

_HEARTBEAT: Final = 0
_TIMESYNC: Final = 111
_ODOMETRY: Final = 331
_CURRENT_MODE: Final = 436
# PX4 without a stream: COM_OBL_RC_ACT is Position, there are no sticks, NAV_RCL_ACT is Return.
_BY_ITSELF: Final = (Mode.RTL,)

_BURSTS: Final = Impairments(burst_begins=0.01, burst_ends=0.2)
_BAD: Final = Impairments(0.004, 0.004, 0.02, 0.002, 0.3, 0.02, 0.02, 0.01, 0.01)

LINK: Final = (
    Scenario(
        "link_late",
        "5 ms each way and 3 ms of jitter",
        DONE,
        ((0.5, Impair(Impairments(0.005, 0.003), Impairments(0.005, 0.003))),),
        overrides=STEP,
        stays_within_m=1.4,
    ),
    Scenario(
        "link_lossy",
        "5 % of the frames are lost, each way",
        DONE,
        ((0.5, Impair(Impairments(loss=0.05), Impairments(loss=0.05))),),
        overrides=STEP,
        stays_within_m=1.4,
    ),
    Scenario(
        "link_bursts",
        "losses come in bursts of five frames",
        DONE,
        ((0.5, Impair(_BURSTS, _BURSTS)),),
        overrides=STEP,
        stays_within_m=1.4,
    ),
    Scenario(
        "link_repeats",
        "a fifth of the frames come twice",
        DONE,
        ((0.5, Impair(Impairments(0.002, 0.002, duplication=0.2), Impairments(duplication=0.2))),),
        overrides=STEP,
        stays_within_m=1.4,
    ),
    Scenario(
        "link_reorders",
        "a tenth of the frames are overtaken",
        DONE,
        ((0.5, Impair(Impairments(reordering=0.1), Impairments(reordering=0.1))),),
        overrides=STEP,
        stays_within_m=1.4,
    ),
    Scenario(
        "link_garbles",
        "bits flip in a twentieth of the frames",
        DONE,
        ((0.5, Impair(Impairments(corruption=0.05), Impairments(corruption=0.05))),),
        overrides=STEP,
        stays_within_m=1.4,
    ),
    Scenario(
        "link_bad",
        "late, lossy, garbled and out of order at once",
        DONE,
        ((0.5, Impair(_BAD, _BAD)),),
        overrides=STEP,
        stays_within_m=1.4,
    ),
    Scenario(
        "outage_short",
        "nothing comes up for 0.6 s: PX4 flies on with the last set-point",
        DONE,
        ((2.5, Mute(for_s=0.6, upwards=True)),),
        overrides=HOVER,
        stays_within_m=1.0,
    ),
    Scenario(
        "outage_up",
        "nothing comes up for 3 s: PX4 fails safe, and is not fought",
        Reason.MODE_CHANGED,
        ((2.0, Mute(for_s=3.0, upwards=True)),),
        overrides=HOVER,
        stays_within_m=3.0,
        ends_in=_BY_ITSELF,
        by_s=3.5,
        coast_s=4.0,
    ),
    Scenario(
        "stream_resumes",
        "PX4 fails safe for a moment and comes back to OFFBOARD with the stream, all unheard",
        DONE,
        ((2.0, Mute(for_s=1.2, upwards=True)), (2.0, Mute(_HEARTBEAT, 1.6)), (2.0, Mute(_CURRENT_MODE, 1.6))),
        overrides=HOVER,
        stays_within_m=1.5,
    ),
    Scenario(
        "pose_stale",
        "no ODOMETRY any more",
        Reason.POSE_STALE,
        ((0.5, Mute(_ODOMETRY)),),
        overrides=HOVER,
        realtime=True,
        stays_within_m=0.5,
        by_s=1.0,
        coast_s=0.5,
    ),
    Scenario(
        "outage_down",
        "nothing comes down any more: Hold is asked for, blindly",
        Reason.POSE_STALE,
        ((0.5, Mute()),),
        overrides=HOVER,
        realtime=True,
        stays_within_m=0.5,
        by_s=1.0,
        coast_s=0.2,
    ),
    Scenario(
        "outage",
        "nothing comes through either way: silence, and PX4 fails safe",
        Reason.POSE_STALE,
        ((0.5, Mute()), (0.5, Mute(upwards=True))),
        overrides=HOVER,
        realtime=True,
        stays_within_m=1.0,
        by_s=1.0,
        coast_s=0.2,
        ends_in=_BY_ITSELF,
    ),
    Scenario(
        "frozen",
        "the process does not run for 1.6 s: PX4 fails safe meanwhile",
        Reason.POSE_STALE,
        ((0.5, Stall(1.6)),),
        overrides=HOVER,
        realtime=True,
        stays_within_m=3.0,
        coast_s=0.5,
        ends_in=_BY_ITSELF,
    ),
    Scenario(
        "heartbeat_lost",
        "no heartbeat any more",
        Reason.HEARTBEAT_LOST,
        ((1.0, Mute(_HEARTBEAT)),),
        overrides=HOVER,
        stays_within_m=0.3,
        by_s=5.5,
    ),
    Scenario(
        "pose_rate",
        "every other ODOMETRY is missing",
        Reason.POSE_RATE,
        ((1.0, Thin(_ODOMETRY, 2)),),
        overrides=HOVER,
        stays_within_m=0.3,
        by_s=4.0,
    ),
    Scenario(
        "link_delay",
        "the link takes 80 ms each way",
        Reason.LINK_DELAY,
        ((1.0, Impair(Impairments(0.08), Impairments(0.08))),),
        overrides=(*LONG_HOVER, "guards.link_jitter_s.enabled=false"),
        stays_within_m=0.5,
    ),
    Scenario(
        "timesync_silent",
        "TIMESYNC is not answered any more: that nobody sees the link's delay is told, and it flies on",
        DONE,
        ((1.0, Mute(_TIMESYNC)),),
        overrides=HOVER,
        stays_within_m=0.3,
        events=("blind",),
    ),
    Scenario(
        "link_jitter",
        "the link takes up to 0.4 s more, now and then",
        Reason.LINK_JITTER,
        ((1.0, Impair(Impairments(0.0, 0.2), Impairments(0.0, 0.2))),),
        overrides=(*LONG_HOVER, "guards.link_delay_s.enabled=false", "guards.pose_rate_hz.enabled=false"),
        stays_within_m=1.0,
    ),
    Scenario(
        "forged",
        "another system claims that the vehicle is disarmed and in Hold",
        DONE,
        ((1.0, Forge(1, 3.0)),),
        overrides=STEP,
        stays_within_m=1.2,
        error_m=0.1,
    ),
    Scenario(
        "flooded",
        "4000 foreign frames a second",
        DONE,
        ((1.0, Forge(20, 3.0)),),
        overrides=STEP,
        stays_within_m=1.2,
        error_m=0.1,
    ),
    Scenario(
        "unplugged",
        "the companion's end of the link is pulled: PX4 fails safe",
        Reason.LINK_LOST,
        ((2.0, Unplug()),),
        overrides=HOVER,
        stays_within_m=3.0,
        ends_in=_BY_ITSELF,
    ),
    Scenario(
        "no_vehicle",
        "nobody is there",
        Reason.NO_VEHICLE,
        overrides=(*HOVER, "link.connect_timeout_s=1"),
        before=(Mute(),),
        realtime=True,
        engaged=False,
        streams=False,
        coast_s=0.1,
    ),
    Scenario(
        "certificate_stale",
        "the vehicle's gains are not those that its response was identified with",
        Reason.CERTIFICATE_STALE,
        overrides=(*HOVER, "vehicle.parameters={MC_ROLL_P: 4.0}", "plant.parameters={MC_ROLL_P: 6.5}"),
        realtime=True,
        engaged=False,
        streams=False,
        coast_s=0.1,
    ),
    Scenario(
        "rate_too_low",
        "three of four ODOMETRY are missing from the start",
        Reason.RATE_TOO_LOW,
        overrides=HOVER,
        before=(Thin(_ODOMETRY, 4),),
        engaged=False,
        pilot=False,
    ),
)
