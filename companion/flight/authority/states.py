"""Who is in control: pure functions over what is known. The pilot comes before everything."""

from __future__ import annotations

from enum import IntEnum
from typing import Final, NamedTuple

from companion.config.guards.rows import Reason

__all__ = ["ORDINARY", "TAKEN", "Known", "Reason", "State", "advance", "hands_off"]


class State(IntEnum):
    """Where the companion stands with the vehicle."""

    CONNECTING = 0  # no autopilot heard yet
    CHECKING = 1  # heard; its odometry is being measured
    STANDBY = 2  # ready, streaming unless hands are off, not in control
    ENGAGED = 3  # in control
    RELEASED = 4  # control ended, for a named reason


# Control ended because somebody else took it: nothing is asked of the vehicle any more.
TAKEN: Final = frozenset({Reason.MODE_CHANGED, Reason.DISARMED, Reason.KILLED})
# Control ended as somebody wanted it; every other end is a fault. A failsafe of the vehicle's own is a fault too.
ORDINARY: Final = frozenset({Reason.MISSION_COMPLETE, Reason.OPERATOR, Reason.MODE_CHANGED, Reason.DISARMED})


class Known(NamedTuple):
    """What the transition looks at."""

    connected: bool
    checked: bool  # odometry measured and fast enough
    offboard: bool  # whether that is its mode
    armed: bool
    fault: Reason | None  # of a guard, the operator or the mission
    killed: bool = False
    hands_off: bool = False  # OFFBOARD was flown or set when we came
    on_ground: bool = False  # where OFFBOARD began


def advance(state: State, known: Known) -> tuple[State, Reason | None]:
    """The next state, and the reason where it is RELEASED."""
    if state is State.RELEASED:
        return state, None
    if state is State.ENGAGED:
        if known.killed:
            return State.RELEASED, Reason.KILLED
        if not known.offboard:
            return State.RELEASED, Reason.MODE_CHANGED
        if not known.armed:
            return State.RELEASED, Reason.DISARMED
    if known.fault is not None:
        return State.RELEASED, known.fault
    if state is State.CONNECTING and known.connected:
        return State.CHECKING, None
    if state is State.CHECKING and known.checked:
        return State.STANDBY, None
    wanted = known.offboard and known.armed and not known.killed
    if state is State.STANDBY and wanted and not known.hands_off:
        return (State.RELEASED, Reason.ON_GROUND) if known.on_ground else (State.ENGAGED, None)
    return state, None


def hands_off(before: bool | None, offboard: bool, intended: bool | None, *, armed: bool) -> bool | None:
    """Whether OFFBOARD was being flown by somebody before us, who may be ourselves before a restart.

    PX4 flies OFFBOARD again by itself as soon as a stream comes, even out of a failsafe, for as long as OFFBOARD is
    what was last asked for; and on the ground it stays in OFFBOARD when it has landed by itself and disarmed, so that
    arming it would be to fly. So a companion that comes up beside a vehicle with that intention sends nothing until
    somebody has chosen another mode; to disarm is enough only where that leaves OFFBOARD. None: not told yet (`before`
    at first contact; `intended`, whether OFFBOARD is what the vehicle was told to fly, until it says).
    Once it is False it stays so.
    """
    if before is False:
        return False
    if offboard or intended:
        return True
    if not armed:
        return False
    return before if intended is None else False
