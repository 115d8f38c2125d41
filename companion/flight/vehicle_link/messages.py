"""What the vehicle tells, as plain records: a row for each message that is more than pose, mode or time.

To add a message: its record, its decoder, its row. Whoever uses it names the record among its handlers.

Source: https://mavlink.io/en/messages/common.html
"""

from __future__ import annotations

from collections.abc import Callable
from enum import IntEnum, IntFlag
from typing import Final, NamedTuple

from pymavlink.dialects.v20 import development as mavlink

from companion.mavlink.codec import Layout
from companion.mavlink.px4 import Parameter, parameter

__all__ = ["Parameter", "parameter"]

ESTIMATOR_STATUS: Final = Layout("ESTIMATOR_STATUS")
EXTENDED_SYS_STATE: Final = Layout("EXTENDED_SYS_STATE")
COMMAND_ACK: Final = Layout("COMMAND_ACK")
AUTOPILOT_VERSION: Final = Layout("AUTOPILOT_VERSION")
ATTITUDE_TARGET: Final = Layout("ATTITUDE_TARGET")

_FLAGS: Final = ESTIMATOR_STATUS.index("flags")
_LANDED_STATE: Final = EXTENDED_SYS_STATE.index("landed_state")
_COMMAND: Final = COMMAND_ACK.index("command")
_RESULT: Final = COMMAND_ACK.index("result")
_TARGET: Final = COMMAND_ACK.index("target_system"), COMMAND_ACK.index("target_component")
_THRUST: Final = ATTITUDE_TARGET.index("thrust")
_VERSION: Final = AUTOPILOT_VERSION.index("flight_sw_version")


class Heartbeat(NamedTuple):
    """The vehicle lives. What it says is in the link's `mode`, `armed` and `killed`."""


class ModeReport(NamedTuple):
    """The vehicle's mode, told for itself."""

    changed: bool  # against what was heard last
    intended: bool  # whether it tells what it was told to be in


class EstimatorFlag(IntFlag):
    """Solutions of the estimator that may be good. Source: #ESTIMATOR_STATUS_FLAGS."""

    ATTITUDE = mavlink.ESTIMATOR_ATTITUDE
    VELOCITY_HORIZONTAL = mavlink.ESTIMATOR_VELOCITY_HORIZ
    VELOCITY_VERTICAL = mavlink.ESTIMATOR_VELOCITY_VERT
    POSITION_HORIZONTAL = mavlink.ESTIMATOR_POS_HORIZ_REL | mavlink.ESTIMATOR_POS_HORIZ_ABS  # either will do
    POSITION_VERTICAL = mavlink.ESTIMATOR_POS_VERT_ABS


class EstimatorStatus(NamedTuple):
    """ESTIMATOR_STATUS."""

    flags: int  # see EstimatorFlag


class LandedState(NamedTuple):
    """EXTENDED_SYS_STATE, from a vehicle that knows."""

    landed: bool
    taking_off: bool = False  # PX4 says so seconds before it has left the ground


class FlownThrust(NamedTuple):
    """ATTITUDE_TARGET: the normalised thrust that the vehicle flies; in OFFBOARD what it was told."""

    thrust: float


class Firmware(NamedTuple):
    """AUTOPILOT_VERSION: major, minor and patch of the autopilot's software."""

    version: tuple[int, int, int]


class Command(IntEnum):
    """Commands whose answers are looked at."""

    ARM = mavlink.MAV_CMD_COMPONENT_ARM_DISARM
    SET_MODE = mavlink.MAV_CMD_DO_SET_MODE


class Answer(NamedTuple):
    """COMMAND_ACK. PX4 accepts a mode first and decides afterwards, so the last answer counts."""

    command: int  # see Command
    result: int  # see companion.flight.vehicle_link.modes.Result
    target: tuple[int, int] = (0, 0)  # system and component that it is for; 0 any

    def is_for(self, own: tuple[int, int]) -> bool:
        """Whether it answers us. On a shared link everybody's answers are heard."""
        return all(wanted in (0, ours) for wanted, ours in zip(self.target, own, strict=True))


class Row(NamedTuple):
    """One message: how its payload becomes a record, and how often it is asked for before stand-by."""

    message_id: int
    decode: Callable[[bytes], NamedTuple | None]  # None: nothing that can be used
    rate_hz: float | None = None  # None: it comes unasked
    flying: bool = False  # of what flies alone: not asked of a rig


def estimator_status(payload: bytes) -> EstimatorStatus:
    """An ESTIMATOR_STATUS."""
    return EstimatorStatus(ESTIMATOR_STATUS.unpack(payload)[_FLAGS])


def landed_state(payload: bytes) -> LandedState | None:
    """An EXTENDED_SYS_STATE."""
    state = EXTENDED_SYS_STATE.unpack(payload)[_LANDED_STATE]
    if state == mavlink.MAV_LANDED_STATE_UNDEFINED:
        return None
    return LandedState(state == mavlink.MAV_LANDED_STATE_ON_GROUND, state == mavlink.MAV_LANDED_STATE_TAKEOFF)


def flown_thrust(payload: bytes) -> FlownThrust:
    """An ATTITUDE_TARGET."""
    return FlownThrust(ATTITUDE_TARGET.unpack(payload)[_THRUST])


def firmware(payload: bytes) -> Firmware:
    """An AUTOPILOT_VERSION. Its lowest byte says whether it is a release; that is left out."""
    number = AUTOPILOT_VERSION.unpack(payload)[_VERSION]
    return Firmware((number >> 24 & 0xFF, number >> 16 & 0xFF, number >> 8 & 0xFF))


def answer(payload: bytes) -> Answer:
    """A COMMAND_ACK."""
    values = COMMAND_ACK.unpack(payload)
    return Answer(values[_COMMAND], values[_RESULT], (values[_TARGET[0]], values[_TARGET[1]]))


ROWS: Final = (
    Row(ESTIMATOR_STATUS.message_id, estimator_status, 5.0),
    # Who lifts off and switches at once is seen in time: unasked they come at 5 and 10 Hz.
    Row(EXTENDED_SYS_STATE.message_id, landed_state, 20.0, flying=True),
    Row(ATTITUDE_TARGET.message_id, flown_thrust, 20.0, flying=True),
    Row(mavlink.MAVLINK_MSG_ID_PARAM_VALUE, parameter),
    Row(AUTOPILOT_VERSION.message_id, firmware),
    Row(COMMAND_ACK.message_id, answer),
)
