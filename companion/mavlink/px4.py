"""PX4's words in MAVLink: flight modes, the commands we send, and what its state messages mean.

Source: PX4 `px4_custom_mode.h` of v1.17 and v1.18, which differ in GUIDED_COURSE alone;
https://mavlink.io/en/messages/common.html and development.html (CURRENT_MODE).
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from enum import IntEnum
from typing import Any, Final, NamedTuple

from pymavlink.dialects.v20 import development as mavlink

from companion.errors import printable

ATTITUDE_TYPE_MASK: Final = 0x07  # ignore the body rates only; the throttle-ignore bit would mean zero thrust

_MAIN_AUTO = 4
_PARAM_VALUE_BYTES: Final = 25  # value, how many there are, which it is, name, type
_PARAM_NAME: Final = slice(8, 24)
_PARAM_TYPE: Final = 24
_PARAM_FORMATS: Final[Mapping[int, str]] = {
    mavlink.MAV_PARAM_TYPE_UINT8: "<Bxxx",
    mavlink.MAV_PARAM_TYPE_INT8: "<bxxx",
    mavlink.MAV_PARAM_TYPE_UINT16: "<Hxx",
    mavlink.MAV_PARAM_TYPE_INT16: "<hxx",
    mavlink.MAV_PARAM_TYPE_UINT32: "<I",
    mavlink.MAV_PARAM_TYPE_INT32: "<i",
    mavlink.MAV_PARAM_TYPE_REAL32: "<f",
}


class Mode(IntEnum):
    """PX4 flight modes as `custom_mode` of HEARTBEAT and CURRENT_MODE: main mode << 16, sub mode << 24.

    Descend has no number of its own: PX4 tells it as LAND.
    """

    MANUAL = 1 << 16
    ALTITUDE = 2 << 16
    POSITION = 3 << 16
    ORBIT = 3 << 16 | 1 << 24
    POSITION_SLOW = 3 << 16 | 2 << 24
    ACRO = 5 << 16
    OFFBOARD = 6 << 16
    STABILIZED = 7 << 16
    TAKEOFF = _MAIN_AUTO << 16 | 2 << 24
    HOLD = _MAIN_AUTO << 16 | 3 << 24
    MISSION = _MAIN_AUTO << 16 | 4 << 24
    RETURN = _MAIN_AUTO << 16 | 5 << 24
    LAND = _MAIN_AUTO << 16 | 6 << 24
    FOLLOW_TARGET = _MAIN_AUTO << 16 | 8 << 24
    PRECISION_LAND = _MAIN_AUTO << 16 | 9 << 24
    VTOL_TAKEOFF = _MAIN_AUTO << 16 | 10 << 24
    EXTERNAL_1 = _MAIN_AUTO << 16 | 11 << 24  # modes that a companion registers
    EXTERNAL_2 = _MAIN_AUTO << 16 | 12 << 24
    EXTERNAL_3 = _MAIN_AUTO << 16 | 13 << 24
    EXTERNAL_4 = _MAIN_AUTO << 16 | 14 << 24
    EXTERNAL_5 = _MAIN_AUTO << 16 | 15 << 24
    EXTERNAL_6 = _MAIN_AUTO << 16 | 16 << 24
    EXTERNAL_7 = _MAIN_AUTO << 16 | 17 << 24
    EXTERNAL_8 = _MAIN_AUTO << 16 | 18 << 24
    GUIDED_COURSE = _MAIN_AUTO << 16 | 19 << 24  # from v1.18
    TERMINATION = 10 << 16
    ALTITUDE_CRUISE = 11 << 16


def mode_name(custom_mode: int) -> str:
    """A mode as PX4's users know it; its number where it has no name here."""
    return Mode(custom_mode).name if custom_mode in set(Mode) else f"mode {custom_mode:#x}"


class Result(IntEnum):
    """MAV_RESULT of COMMAND_ACK."""

    ACCEPTED = 0
    TEMPORARILY_REJECTED = 1
    DENIED = 2
    UNSUPPORTED = 3
    FAILED = 4
    IN_PROGRESS = 5
    CANCELLED = 6


def command(system_id: int, component_id: int, number: int, *params: float) -> Any:
    """A COMMAND_LONG to the vehicle; parameters left out are zero."""
    padded = (*params, *([0.0] * (7 - len(params))))
    return mavlink.MAVLink_command_long_message(system_id, component_id, number, 0, *padded)


def set_mode(system_id: int, component_id: int, mode: Mode) -> Any:
    """DO_SET_MODE with PX4's custom mode in its main and sub parts."""
    return command(
        system_id,
        component_id,
        mavlink.MAV_CMD_DO_SET_MODE,
        mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED,
        mode >> 16 & 0xFF,
        mode >> 24 & 0xFF,
    )


def message_interval(system_id: int, component_id: int, message_id: int, rate_hz: float) -> Any:
    """SET_MESSAGE_INTERVAL; a rate of zero asks for the vehicle's default."""
    interval_us = 1e6 / rate_hz if rate_hz > 0 else 0.0
    return command(system_id, component_id, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, message_id, interval_us)


def request_message(system_id: int, component_id: int, message_id: int) -> Any:
    """REQUEST_MESSAGE: one message now, out of turn."""
    return command(system_id, component_id, mavlink.MAV_CMD_REQUEST_MESSAGE, message_id)


def arm(system_id: int, component_id: int) -> Any:
    """Arm, with PX4's checks: never the forced form."""
    return command(system_id, component_id, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)


def heartbeat(status: int) -> Any:
    """The companion's own heartbeat: an onboard controller that is no autopilot."""
    return mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_ONBOARD_CONTROLLER, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, status, 3
    )


class Parameter(NamedTuple):
    """PARAM_VALUE: one parameter as the vehicle stores it."""

    name: str
    value: int | float


def parameter(payload: bytes) -> Parameter | None:
    """A PARAM_VALUE; None for one of a type that PX4 does not have.

    An int32 travels bytewise in the float field (https://mavlink.io/en/services/parameter.html#parameter-encoding), so
    the four bytes are read as they came: as a float an int32 that looks like a NaN would not survive. A tool beside a
    flight may ask for all of a thousand, so this is cheap.
    """
    payload = payload.ljust(_PARAM_VALUE_BYTES, b"\0")
    layout = _PARAM_FORMATS.get(payload[_PARAM_TYPE])
    if layout is None:
        return None
    (value,) = struct.unpack(layout, payload[:4])
    name, _, _ = payload[_PARAM_NAME].partition(b"\0")
    return Parameter(printable(name.decode("ascii", "replace")), value)


def read_parameter(system_id: int, component_id: int, name: str) -> Any:
    """PARAM_REQUEST_READ by name. PX4 answers one that it has not with silence, from v1.18 on with PARAM_ERROR."""
    return mavlink.MAVLink_param_request_read_message(system_id, component_id, name.encode(), -1)
