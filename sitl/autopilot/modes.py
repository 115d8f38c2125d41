"""PX4's flight modes, their number on the wire, and the answers an autopilot gives.

Numbers are those of PX4 v1.17 (`msg/versioned/VehicleStatus.msg`, `commander/px4_custom_mode.h`) and of MAVLink
(MAV_RESULT, MAV_LANDED_STATE, MAV_STANDARD_MODE: https://mavlink.io/en/messages/development.html).
"""

from __future__ import annotations

from enum import IntEnum
from typing import Final


class Mode(IntEnum):
    """Flight modes that the plant knows, numbered as PX4's navigation state."""

    MANUAL = 0
    ALTCTL = 1
    POSCTL = 2
    MISSION = 3
    HOLD = 4  # AUTO.LOITER
    RTL = 5
    ACRO = 10
    TERMINATION = 13
    OFFBOARD = 14
    STABILIZED = 15
    TAKEOFF = 17
    LAND = 18


class LandedState(IntEnum):
    """MAV_LANDED_STATE."""

    ON_GROUND = 1
    IN_AIR = 2
    TAKEOFF = 3
    LANDING = 4


class Severity(IntEnum):
    """MAV_SEVERITY, as far as used."""

    CRITICAL = 2
    WARNING = 4
    INFO = 6


STICK_MODES: Final = frozenset({Mode.MANUAL, Mode.ALTCTL, Mode.POSCTL, Mode.ACRO, Mode.STABILIZED})
"""Modes that need a pilot's sticks."""

AUTO_MODES: Final = frozenset({Mode.MISSION, Mode.HOLD, Mode.RTL, Mode.TAKEOFF, Mode.LAND})
"""Modes that the autopilot flies by itself."""

PREVENT_ARMING: Final = frozenset({Mode.RTL, Mode.LAND, Mode.TERMINATION})
"""Modes in which PX4 refuses to arm (`ModeUtil/mode_requirements.cpp`)."""

_MAIN_AUTO: Final = 4
_MAIN_SUB: Final[dict[Mode, tuple[int, int]]] = {
    Mode.MANUAL: (1, 0),
    Mode.ALTCTL: (2, 0),
    Mode.POSCTL: (3, 0),
    Mode.TAKEOFF: (_MAIN_AUTO, 2),
    Mode.HOLD: (_MAIN_AUTO, 3),
    Mode.MISSION: (_MAIN_AUTO, 4),
    Mode.RTL: (_MAIN_AUTO, 5),
    Mode.LAND: (_MAIN_AUTO, 6),
    Mode.ACRO: (5, 0),
    Mode.OFFBOARD: (6, 0),
    Mode.STABILIZED: (7, 0),
    Mode.TERMINATION: (10, 0),
}
_FROM_WIRE: Final = {wire: mode for mode, wire in _MAIN_SUB.items() if mode is not Mode.TERMINATION}
_STANDARD: Final = {
    Mode.POSCTL: 1,
    Mode.ALTCTL: 4,
    Mode.RTL: 5,
    Mode.MISSION: 6,
    Mode.LAND: 7,
    Mode.TAKEOFF: 8,
}


def custom_mode(mode: Mode) -> int:
    """HEARTBEAT.custom_mode of a mode: main mode in the third byte, sub mode in the fourth."""
    main, sub = _MAIN_SUB[mode]
    return main << 16 | sub << 24


def standard_mode(mode: Mode) -> int:
    """MAV_STANDARD_MODE of a mode; 0 (non-standard) for Hold and OFFBOARD, as PX4 reports them."""
    return _STANDARD.get(mode, 0)


def from_main_sub(main: int, sub: int) -> Mode | None:
    """The mode that DO_SET_MODE names by its parameters 2 and 3; `None` for one that the plant does not know."""
    if main == _MAIN_AUTO and sub == 0:
        return Mode.MISSION
    if main == _MAIN_SUB[Mode.POSCTL][0]:
        return Mode.POSCTL
    return _FROM_WIRE.get((main, sub if main == _MAIN_AUTO else 0))
