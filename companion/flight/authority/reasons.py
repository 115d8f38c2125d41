"""Every way out of control, by name, and what each means to the person who reads it."""

from __future__ import annotations

from enum import StrEnum
from typing import Final


class Reason(StrEnum):
    """Every way out of control."""

    # somebody else has it
    MODE_CHANGED = "mode_changed"
    DISARMED = "disarmed"
    KILLED = "killed"
    # it is over, as wished or before
    OPERATOR = "operator"
    MISSION_COMPLETE = "mission_complete"
    NOT_CALM = "not_calm"
    # what we are told
    POSE_STALE = "pose_stale"
    POSE_INVALID = "pose_invalid"
    POSE_RATE = "pose_rate"
    CLOCK_JUMP = "clock_jump"
    HEARTBEAT_LOST = "heartbeat_lost"
    LINK_LOST = "link_lost"
    LINK_DELAY = "link_delay"
    LINK_JITTER = "link_jitter"
    # where the estimator thinks we are
    ESTIMATOR_FLAGS = "estimator_flags"
    POSITION_VARIANCE = "position_variance"
    ESTIMATOR_JUMP = "estimator_jump"
    VELOCITY_CONSISTENCY = "velocity_consistency"
    # how it flies
    FENCE = "fence"
    ENVELOPE = "envelope"
    TRACKING_ERROR = "tracking_error"
    TILT = "tilt"
    TILT_ERROR = "tilt_error"
    ATTITUDE_RESPONSE = "attitude_response"
    HOVER_THRUST = "hover_thrust"
    WEIGHTS_ON_BOUND = "weights_on_bound"
    THRUST_SATURATION = "thrust_saturation"
    FLIGHT_TIME = "flight_time"
    # ourselves
    SETPOINT_INVALID = "setpoint_invalid"
    TICK_OVERRUN = "tick_overrun"
    INTERNAL_ERROR = "internal_error"
    # it never began
    NO_VEHICLE = "no_vehicle"
    RATE_TOO_LOW = "rate_too_low"
    CERTIFICATE_STALE = "certificate_stale"
    SECOND_COMPANION = "second_companion"
    ENGAGE_REFUSED = "engage_refused"


MEANING: Final = {
    Reason.MODE_CHANGED: "the vehicle left OFFBOARD: the pilot or its failsafe has control",
    Reason.DISARMED: "the vehicle was disarmed",
    Reason.KILLED: "the vehicle was killed or its flight terminated",
    Reason.OPERATOR: "stopped by the operator",
    Reason.MISSION_COMPLETE: "the mission is over",
    Reason.NOT_CALM: "the vehicle did not come to rest for the next doublet: fly in calm air, or with a longer pause_s",
    Reason.POSE_STALE: "no odometry, or only the same, within guards.pose_age_s: look at the link",
    Reason.POSE_INVALID: "the odometry was not finite numbers with a unit quaternion",
    Reason.POSE_RATE: "odometry came below guards.pose_rate_hz, what the certificate is for: look at the link",
    Reason.CLOCK_JUMP: "the odometry's time stamps jumped",
    Reason.HEARTBEAT_LOST: "no heartbeat within guards.heartbeat_age_s",
    Reason.LINK_LOST: "the link has gone",
    Reason.LINK_DELAY: "the link was slower than guards.link_delay_s: mend it, or certify a longer delay_s",
    Reason.LINK_JITTER: "odometry came later than usual by more than guards.link_jitter_s: look at the link's load",
    Reason.ESTIMATOR_FLAGS: "the estimator gave up position, velocity or attitude: look at its GPS or camera",
    Reason.POSITION_VARIANCE: "the estimator is unsure where it is by more than guards.position_variance_m2",
    Reason.ESTIMATOR_JUMP: "the estimator reset its position by more than guards.estimator_jump_m",
    Reason.VELOCITY_CONSISTENCY: "position moved otherwise than velocity said: the estimator slid without counting it",
    Reason.FENCE: "outside guards.fence",
    Reason.ENVELOPE: "outside controller.envelope, for which the adaptation rate was checked",
    Reason.TRACKING_ERROR: "further from the reference than guards.tracking_error_m: wind, load, hover thrust",
    Reason.TILT: "tilted by more than guards.tilt_deg",
    Reason.TILT_ERROR: "the thrust direction was off its set-point by more than guards.tilt_error_deg",
    Reason.ATTITUDE_RESPONSE: "the attitude loop answered otherwise than certified: check motors, identify it again",
    Reason.HOVER_THRUST: "it hovers at another thrust than vehicle.hover_thrust: the loop's gain is off with it",
    Reason.WEIGHTS_ON_BOUND: "adaptive weights rested on their bounds: the disturbance is more than they can answer",
    Reason.THRUST_SATURATION: "thrust was at its limit too much of the time: battery, load, vehicle.hover_thrust",
    Reason.FLIGHT_TIME: "in control for longer than guards.flight_time_s",
    Reason.SETPOINT_INVALID: "the controller's answer was not finite; it was not sent",
    Reason.TICK_OVERRUN: "a tick took longer than guards.tick_overrun_s: the computer is too busy",
    Reason.INTERNAL_ERROR: "an error in the companion itself",
    Reason.NO_VEHICLE: "no heartbeat of the configured vehicle within link.connect_timeout_s",
    Reason.RATE_TOO_LOW: "odometry arrives below tick.floor_hz",
    Reason.CERTIFICATE_STALE: "the vehicle's gains are not those its attitude response was identified with",
    Reason.SECOND_COMPANION: "another companion is there, or somebody else streams to the vehicle: stop one of the two",
    Reason.ENGAGE_REFUSED: "the vehicle did not arm, take off or accept OFFBOARD",
}
