"""Why control ends: every reason by name, and the `guards` section, a row for each guard. One place for both.

From here follow the schema and its defaults, the order of the checks, which guards can go blind, and the tables of
`docs/guards.md`. What a guard measures stands in `companion/flight/guards/measures.py`; the recipe for one more is
`docs/recipes/add_a_guard.md`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Final

from pydantic import Field, model_validator

from companion.config.base import Section
from companion.config.guards.declaration import Blind, Group, Guard, ReasonRow, Row
from companion.config.guards.fence import FenceSection
from companion.config.guards.sections import (
    CountGuardSection,
    DerivedGuardSection,
    EnvelopeGuardSection,
    EventGuardSection,
    GuardSection,
)


class Reason(ReasonRow):
    """Every way out of control: name, group, what it means to the person who reads it, and what to look at then."""

    # fmt: off
    MODE_CHANGED = (
        "mode_changed", Group.OVER,
        "the vehicle left OFFBOARD: the pilot or its failsafe has control",
        "select Offboard again; after a failsafe of PX4 (the detail says so), find out why first",
    )
    DISARMED = "disarmed", Group.OVER, "the vehicle was disarmed", ""
    KILLED = "killed", Group.OVER, "the vehicle was killed or its flight terminated", ""
    OPERATOR = "operator", Group.OVER, "stopped by the operator", "Ctrl-C or SIGTERM"
    MISSION_COMPLETE = (
        "mission_complete", Group.OVER,
        "the mission is over", "`mission.duration_s`, or the last doublet of `--identify`",
    )
    LANDED = (
        "landed", Group.FLIGHT,
        "the vehicle has landed: on the ground nothing is left to control",
        "the mission or a command below the ground, a downdraft; the companion asks for Land, and PX4 disarms",
    )
    NOT_CALM = (
        "not_calm", Group.OVER,
        "the vehicle did not come to rest for the next doublet: fly in calm air, or with a longer pause_s",
        "wind; it waits for 20 s",
    )

    POSE_STALE = (
        "pose_stale", Group.TOLD,
        "no odometry, or only the same, within guards.pose_age_s: look at the link",
        "the cable, the link's load, a hung estimator",
    )
    POSE_INVALID = (
        "pose_invalid", Group.TOLD,
        "the odometry was not finite numbers with a unit quaternion", "the estimator",
    )
    POSE_RATE = (
        "pose_rate", Group.TOLD,
        "odometry came below guards.pose_rate_hz, what the certificate is for: look at the link",
        "`MAV_1_RATE`, other streams on the line",
    )
    CLOCK_JUMP = (
        "clock_jump", Group.TOLD,
        "the odometry's time stamps jumped",
        "the flight controller rebooted, or messages were lost: power, the cable",
    )
    HEARTBEAT_LOST = "heartbeat_lost", Group.TOLD, "no heartbeat within guards.heartbeat_age_s", "the cable"
    LINK_LOST = "link_lost", Group.TOLD, "the link has gone", "the device, the cable"
    LINK_DELAY = (
        "link_delay", Group.TOLD,
        "the link was slower than guards.link_delay_s: mend it, or certify a longer delay_s",
        "radio links, CPU load",
    )
    LINK_JITTER = (
        "link_jitter", Group.TOLD,
        "odometry came later than usual by more than guards.link_jitter_s: look at the link's load",
        "radio links, CPU load",
    )
    CLOCK_RATE = (
        "clock_rate", Group.TOLD,
        "the vehicle's clock ran faster than ours: what it says of time and speed is wrong",
        "a simulation faster than real time; the flight controller's oscillator",
    )

    ESTIMATOR_FLAGS = (
        "estimator_flags", Group.ESTIMATOR,
        "the estimator gave up position, velocity or attitude: look at its GPS or camera",
        "GPS, flow, motion capture; it may also have stopped telling",
    )
    POSITION_VARIANCE = (
        "position_variance", Group.ESTIMATOR,
        "the estimator is unsure where it is by more than guards.position_variance_m2",
        "GPS, flow, motion capture: the first to tell when GPS is lost",
    )
    ESTIMATOR_JUMP = (
        "estimator_jump", Group.ESTIMATOR,
        "the estimator reset its position by more than guards.estimator_jump_m",
        "GPS, flow, motion capture; magnetometer",
    )
    ESTIMATE_STUCK = (
        "estimate_stuck", Group.ESTIMATOR,
        "one of the estimate's numbers stopped while the others moved",
        "a hung sensor or driver; whoever forwards the odometry",
    )
    VELOCITY_CONSISTENCY = (
        "velocity_consistency", Group.ESTIMATOR,
        "position moved otherwise than velocity said: the estimator slid without counting it",
        "a GPS that came back",
    )
    ESTIMATOR_STEPS = (
        "estimator_steps", Group.ESTIMATOR,
        "the estimator's steps within a minute, counted or not, are more than guards.estimator_steps_m",
        "GPS, flow, motion capture; many small resets",
    )
    POSITION_SLIDE = (
        "position_slide", Group.ESTIMATOR,
        "position slid for seconds against velocity, farther than the estimator is wrong by",
        "GPS, flow, motion capture; which of both was right",
    )
    HEIGHT_SLIDE = (
        "height_slide", Group.ESTIMATOR,
        "height slid for seconds against vertical velocity", "barometer, range finder, GPS",
    )

    FENCE = "fence", Group.FLIGHT, "outside guards.fence", "wind, mission"
    ENVELOPE = (
        "envelope", Group.FLIGHT,
        "outside controller.envelope, for which the adaptation rate was checked",
        "`controller.envelope`, `limits.speed_m_s`",
    )
    TRACKING_ERROR = (
        "tracking_error", Group.FLIGHT,
        "further from the reference than guards.tracking_error_m: wind, load, hover thrust",
        "wind, load, hover thrust",
    )
    TILT = "tilt", Group.FLIGHT, "tilted by more than guards.tilt_deg", "a motor, a propeller, attitude tuning"
    TILT_ERROR = (
        "tilt_error", Group.FLIGHT,
        "the thrust direction was off its set-point by more than guards.tilt_error_deg",
        "a motor, a propeller, attitude tuning",
    )
    UNEXPLAINED_MOTION = (
        "unexplained_motion", Group.FLIGHT,
        "velocity changed otherwise than attitude and thrust say: pushed, or an estimate that is not the vehicle's",
        "a gust, a blow, a motor; GPS, flow, motion capture",
    )
    ATTITUDE_RESPONSE = (
        "attitude_response", Group.FLIGHT,
        "the attitude loop answered otherwise than certified: check motors, identify it again",
        "changed gains, payload, a motor: identify again",
    )
    HOVER_THRUST = (
        "hover_thrust", Group.FLIGHT,
        "it hovers at another thrust than vehicle.hover_thrust: the loop's gain is off with it",
        "`vehicle.hover_thrust_source: estimated` finds it in flight",
    )
    WEIGHTS_ON_BOUND = (
        "weights_on_bound", Group.FLIGHT,
        "adaptive weights rested on their bounds: the disturbance is more than they can answer",
        "load, wind beyond `bias.bound`",
    )
    THRUST_SATURATION = (
        "thrust_saturation", Group.FLIGHT,
        "thrust was at its limit too much of the time: battery, load, vehicle.hover_thrust",
        "battery, load, `vehicle.hover_thrust`",
    )
    FLIGHT_TIME = "flight_time", Group.FLIGHT, "in control for longer than guards.flight_time_s", ""

    SETPOINT_INVALID = (
        "setpoint_invalid", Group.ITSELF,
        "the controller's answer was not finite; it was not sent", "report it, with the flight folder",
    )
    TICK_OVERRUN = (
        "tick_overrun", Group.ITSELF,
        "a tick took longer than guards.tick_overrun_s: the computer is too busy",
        "other work on the board; `service.realtime_priority`",
    )
    INTERNAL_ERROR = (
        "internal_error", Group.ITSELF,
        "an error in the companion itself", "report it, with the flight folder: its traceback is in the log",
    )

    NO_VEHICLE = (
        "no_vehicle", Group.NEVER_BEGAN,
        "no heartbeat of the configured vehicle within link.connect_timeout_s", "link, baud rate, `vehicle.system_id`",
    )
    RATE_TOO_LOW = (
        "rate_too_low", Group.NEVER_BEGAN,
        "odometry arrives below tick.floor_hz", "baud rate, `MAV_1_RATE`, other streams on the line",
    )
    NOT_SETTLED = (
        "not_settled", Group.NEVER_BEGAN,
        "the estimate did not settle: position slid by more than guards.estimate_settled_m, or a solution is missing",
        "GPS, flow, motion capture: wait outside, away from walls",
    )
    CERTIFICATE_STALE = (
        "certificate_stale", Group.NEVER_BEGAN,
        "the vehicle's PX4 or gains are not those its attitude response was identified with, or it does not tell them",
        "identify again, or set them back; they may have changed in stand-by",
    )
    IMPLAUSIBLE = (
        "implausible", Group.NEVER_BEGAN,
        "the config makes no sense beside this vehicle: its hover thrust, or a rig's config on a vehicle that flies",
        "`vehicle.hover_thrust` and MPC_THR_HOVER, `vehicle.kind`; `--anyway` insists",
    )
    SECOND_COMPANION = (
        "second_companion", Group.NEVER_BEGAN,
        "another companion is there, or somebody else streams to the vehicle: stop one of the two", "",
    )
    ON_GROUND = (
        "on_ground", Group.NEVER_BEGAN,
        "switched to OFFBOARD on the ground: take off first and switch in the air, or start with --engage",
        "it streams no thrust there; the vehicle says where it is by EXTENDED_SYS_STATE",
    )
    ENGAGE_REFUSED = (
        "engage_refused", Group.NEVER_BEGAN,
        "the vehicle did not arm, take off or accept OFFBOARD", "PX4's own reason is at the ground station",
    )
    # fmt: on


class Guards(Section):
    """Every guard, a row each. Those of one look are heard in this order."""

    # where it happens: what is stale, invalid or jumps must not reach the controller
    pose_age_s: Annotated[
        GuardSection, Row(Reason.POSE_STALE, "s"), Field(description="age of the odometry; the same again is not news")
    ] = GuardSection(limit=0.25)
    heartbeat_age_s: Annotated[
        GuardSection, Row(Reason.HEARTBEAT_LOST, "s"), Field(description="age of the vehicle's heartbeat")
    ] = GuardSection(limit=3.0)
    clock_jump_s: Annotated[
        EventGuardSection,
        Row(Reason.CLOCK_JUMP, "s"),
        Field(description="from one time stamp of the odometry to the next; never above 1 s"),
    ] = EventGuardSection(limit=0.25)
    estimator_jump_m: Annotated[
        EventGuardSection,
        Row(Reason.ESTIMATOR_JUMP, "m", blind=Blind("resets are counted in ODOMETRY alone")),
        Field(
            description="a counted reset; smaller ones move reference, anchor and mission along and are flown through"
        ),
    ] = EventGuardSection(limit=0.5)
    tick_overrun_s: Annotated[
        EventGuardSection, Row(Reason.TICK_OVERRUN, "s"), Field(description="one tick of the companion")
    ] = EventGuardSection(limit=0.2)

    estimate_settled_m: Annotated[
        GuardSection,
        Row(Reason.NOT_SETTLED, "m"),
        Field(
            description="before control begins: how far position may slide against velocity, leaking with 0.5 s; the "
            "timeout must have passed without it, and is waited for a minute"
        ),
    ] = GuardSection(limit=0.3, timeout_s=2.0)

    # 50 times a second, after the set-point has gone
    position_variance_m2: Annotated[
        GuardSection,
        Row(
            Reason.POSITION_VARIANCE,
            "m2",
            blind=Blind("not in the odometry", 2.0, "the estimator no longer answers: no variance in its odometry"),
        ),
        Field(description="largest variance of the estimated position"),
    ] = GuardSection(limit=0.5, timeout_s=0.3)
    estimator_flags: Annotated[
        CountGuardSection,
        Row(
            Reason.ESTIMATOR_FLAGS,
            blind=Blind("no ESTIMATOR_STATUS", 2.0, "the estimator no longer answers: no ESTIMATOR_STATUS"),
        ),
        Field(description="solutions missing of the five that are needed"),
    ] = CountGuardSection(limit=0, timeout_s=0.3)
    estimate_stuck_s: Annotated[
        GuardSection,
        Row(Reason.ESTIMATE_STUCK, "s"),
        Field(description="for how long one quantity that should move is the same to the last bit"),
    ] = GuardSection(limit=0.25)
    velocity_consistency_m: Annotated[
        GuardSection,
        Row(Reason.VELOCITY_CONSISTENCY, "m"),
        Field(description="how far position slides against velocity, leaking with 0.5 s"),
    ] = GuardSection(limit=1.0)
    estimator_steps_m: Annotated[
        DerivedGuardSection,
        Row(Reason.ESTIMATOR_STEPS, "m"),
        Field(
            description="all steps of the position within a minute, counted or not; a counted one takes 0.1 m at "
            "least; without a limit, twice that of `estimator_jump_m`"
        ),
    ] = DerivedGuardSection()
    position_slide_m: Annotated[
        DerivedGuardSection,
        Row(Reason.POSITION_SLIDE, "m"),
        Field(
            description="how far north or east slides against velocity, leaking with 10 s, or 3.2 times that with "
            "2 s; without a limit, six times what `estimator` is wrong by: 7.2 m by GPS"
        ),
    ] = DerivedGuardSection()
    height_slide_m: Annotated[
        GuardSection,
        Row(Reason.HEIGHT_SLIDE, "m"),
        Field(
            description="how far height slides against velocity, leaking with 10 s, or twice that with 2 s; a real PX4 "
            "reached 2.1 m by GPS"
        ),
    ] = GuardSection(limit=3.0)
    fence: Annotated[
        FenceSection,
        Row(Reason.FENCE),
        Field(description="a cylinder or a box around where control began; needed for live commands"),
    ] = FenceSection()
    tilt_deg: Annotated[
        GuardSection, Row(Reason.TILT, "deg"), Field(description="of the thrust direction from the vertical")
    ] = GuardSection(limit=60.0, timeout_s=0.2)
    unexplained_motion_m_s: Annotated[
        GuardSection,
        Row(Reason.UNEXPLAINED_MOTION, "m_s"),
        Field(
            description="what velocity changes beyond attitude, thrust and steady wind, leaking with 1 s; on its "
            "worst axis"
        ),
    ] = GuardSection(limit=4.0, timeout_s=0.5)
    attitude_response_deg: Annotated[
        GuardSection,
        Row(Reason.ATTITUDE_RESPONSE, "deg", blind=Blind("a transfer function"), certified=True),
        Field(description="how far outside the band of the responses certified under `attitude`"),
    ] = GuardSection(limit=8.0, timeout_s=0.5)
    tilt_error_deg: Annotated[
        GuardSection, Row(Reason.TILT_ERROR, "deg"), Field(description="thrust direction, set-point to measured")
    ] = GuardSection(limit=25.0, timeout_s=0.5)
    ground_contact: Annotated[
        GuardSection,
        Row(Reason.LANDED, least=True),
        Field(
            description="share of the weight that the thrust carries, by how it moves up and down: the ground carries "
            "the rest. When it is in control and says for 0.3 s that it has landed, it has too"
        ),
    ] = GuardSection(limit=0.5, timeout_s=0.5)
    hover_thrust: Annotated[
        GuardSection,
        Row(Reason.HOVER_THRUST, certified=True),
        Field(description="average of vertical thrust over the believed hover thrust, less one"),
    ] = GuardSection(limit=0.2, timeout_s=3.0)
    thrust_saturation: Annotated[
        GuardSection, Row(Reason.THRUST_SATURATION), Field(description="share of the last second's ticks")
    ] = GuardSection(limit=0.5, timeout_s=1.0)
    weights_on_bound: Annotated[
        CountGuardSection,
        Row(Reason.WEIGHTS_ON_BOUND, certified=True),  # the sampled adaptation is certified for regressors held still
        Field(description="adaptive weights that rest on a bound of their projection"),
    ] = CountGuardSection(limit=2, timeout_s=10.0)
    tracking_error_m: Annotated[
        GuardSection,
        Row(Reason.TRACKING_ERROR, "m"),
        Field(description="from the reference that the controller tracks"),
    ] = GuardSection(limit=1.5, timeout_s=0.5)
    envelope: Annotated[
        EnvelopeGuardSection,
        Row(Reason.ENVELOPE, certified=True),
        Field(description="outside `controller.envelope`: distance from the set-point, or speed"),
    ] = EnvelopeGuardSection(timeout_s=1.0)
    link_delay_s: Annotated[
        DerivedGuardSection,
        Row(Reason.LINK_DELAY, "s", blind=Blind("no answer to TIMESYNC", 3.0), certified=True),
        Field(
            description="round trip; without a limit, what the certified `attitude.*.delay_s` leaves to the link; "
            "where that is 0, what the certificate does"
        ),
    ] = DerivedGuardSection(timeout_s=1.0)
    link_jitter_s: Annotated[
        GuardSection,
        Row(Reason.LINK_JITTER, "s", certified=True),
        Field(description="how much later than usual; never above the limit of `link_delay_s`"),
    ] = GuardSection(limit=0.15, timeout_s=1.0)
    pose_rate_hz: Annotated[
        DerivedGuardSection,
        Row(Reason.POSE_RATE, "hz", least=True, certified=True),
        Field(description="least rate of the odometry, less 1 %; without a limit, `tick.floor_hz`"),
    ] = DerivedGuardSection(timeout_s=1.0)
    clock_rate: Annotated[
        GuardSection,
        Row(Reason.CLOCK_RATE),
        Field(description="seconds of the vehicle in one of ours; a slow clock is only told"),
    ] = GuardSection(limit=1.05, timeout_s=2.0)
    flight_time_s: Annotated[GuardSection, Row(Reason.FLIGHT_TIME, "s"), Field(description="in control")] = (
        GuardSection(enabled=False, limit=600.0)
    )

    @model_validator(mode="before")
    @classmethod
    def _over_the_defaults(cls, data: Any) -> Any:
        """What a file leaves out of a guard keeps its default."""
        if not isinstance(data, Mapping):
            return data
        fields = cls.model_fields
        return {
            key: {**fields[key].default.model_dump(), **given}
            if key in fields and isinstance(given, Mapping)
            else given
            for key, given in data.items()
        }


GUARDS: Final = {  # in the order of their checks
    Reason[row.reason.name]: Guard(key, field.description or "", row)
    for key, field in Guards.model_fields.items()
    for row in field.metadata
    if isinstance(row, Row)
}
