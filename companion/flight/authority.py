"""Who is in control: a pure transition function over what is known. The pilot comes before everything."""

from __future__ import annotations

from enum import IntEnum, StrEnum
from typing import NamedTuple

from companion.mavlink.px4 import Mode


class State(IntEnum):
    """Where the companion stands with the vehicle."""

    CONNECTING = 0  # no autopilot heard yet
    CHECKING = 1  # heard; its odometry is being measured
    STANDBY = 2  # ready, streaming, not in control
    ENGAGED = 3  # in control
    RELEASED = 4  # control ended, for a named reason


class Reason(StrEnum):
    """Every way out of control."""

    MODE_CHANGED = "mode_changed"
    DISARMED = "disarmed"
    OPERATOR = "operator"
    MISSION_COMPLETE = "mission_complete"
    POSE_STALE = "pose_stale"
    POSE_INVALID = "pose_invalid"
    SETPOINT_INVALID = "setpoint_invalid"
    CLOCK_JUMP = "clock_jump"
    HEARTBEAT_LOST = "heartbeat_lost"
    LINK_LOST = "link_lost"
    NO_VEHICLE = "no_vehicle"
    RATE_TOO_LOW = "rate_too_low"
    ENGAGE_REFUSED = "engage_refused"
    INTERNAL_ERROR = "internal_error"


MEANING = {
    Reason.MODE_CHANGED: "the vehicle left OFFBOARD: the pilot or its failsafe has control",
    Reason.DISARMED: "the vehicle was disarmed",
    Reason.OPERATOR: "stopped by the operator",
    Reason.MISSION_COMPLETE: "the mission is over",
    Reason.POSE_STALE: "no odometry within guards.pose_age_s",
    Reason.POSE_INVALID: "the odometry was not finite numbers with a unit quaternion",
    Reason.SETPOINT_INVALID: "the controller's answer was not finite; it was not sent",
    Reason.CLOCK_JUMP: "the odometry's time stamps jumped",
    Reason.HEARTBEAT_LOST: "no heartbeat within guards.heartbeat_age_s",
    Reason.LINK_LOST: "the link has gone",
    Reason.NO_VEHICLE: "no heartbeat of the configured vehicle within link.connect_timeout_s",
    Reason.RATE_TOO_LOW: "odometry arrives below tick.floor_hz",
    Reason.ENGAGE_REFUSED: "the vehicle did not arm, take off or accept OFFBOARD",
    Reason.INTERNAL_ERROR: "an error in the companion itself",
}

# Control ended because somebody else took it: nothing is asked of the vehicle any more.
TAKEN: frozenset[Reason] = frozenset({Reason.MODE_CHANGED, Reason.DISARMED})


class Known(NamedTuple):
    """What the transition looks at."""

    connected: bool
    checked: bool  # odometry measured and fast enough
    mode: int  # custom_mode
    armed: bool
    fault: Reason | None  # of a guard, the operator or the mission


def advance(state: State, known: Known) -> tuple[State, Reason | None]:
    """The next state, and the reason where it is RELEASED."""
    if state is State.RELEASED:
        return state, None
    if state is State.ENGAGED:
        if known.mode != Mode.OFFBOARD:
            return State.RELEASED, Reason.MODE_CHANGED
        if not known.armed:
            return State.RELEASED, Reason.DISARMED
    if known.fault is not None:
        return State.RELEASED, known.fault
    if state is State.CONNECTING and known.connected:
        return State.CHECKING, None
    if state is State.CHECKING and known.checked:
        return State.STANDBY, None
    if state is State.STANDBY and known.mode == Mode.OFFBOARD and known.armed:
        return State.ENGAGED, None
    return state, None
