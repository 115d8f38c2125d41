"""PX4's flight modes, their number on the wire, and the answers an autopilot gives.

Numbers are those of PX4 v1.17 and v1.18 (`msg/versioned/VehicleStatus.msg`, `commander/px4_custom_mode.h`) and of
MAVLink (MAV_RESULT, MAV_LANDED_STATE, MAV_STANDARD_MODE: https://mavlink.io/en/messages/development.html).
"""

from __future__ import annotations

from enum import IntEnum
from typing import Final

from sitl.autopilot.parameters import Px4Version


class FlightMode(IntEnum):
    """Flight modes that the plant knows, numbered as PX4's navigation state."""

    MANUAL = 0
    ALTCTL = 1
    POSCTL = 2
    MISSION = 3
    HOLD = 4  # AUTO.LOITER
    RTL = 5
    GUIDED_COURSE = 7  # from v1.18
    ALTITUDE_CRUISE = 8
    ACRO = 10
    TERMINATION = 13
    OFFBOARD = 14
    STABILIZED = 15
    TAKEOFF = 17
    LAND = 18
    EXTERNAL_1 = 23  # modes that a companion may register (px4-ros2-interface-lib); nobody does here
    EXTERNAL_2 = 24
    EXTERNAL_3 = 25
    EXTERNAL_4 = 26
    EXTERNAL_5 = 27
    EXTERNAL_6 = 28
    EXTERNAL_7 = 29
    EXTERNAL_8 = 30


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


STICK_MODES: Final = frozenset(
    {
        FlightMode.MANUAL,
        FlightMode.ALTCTL,
        FlightMode.ALTITUDE_CRUISE,
        FlightMode.POSCTL,
        FlightMode.ACRO,
        FlightMode.STABILIZED,
    }
)
"""Modes that need a pilot's sticks."""

EXTERNAL_MODES: Final = tuple(mode for mode in FlightMode if mode.name.startswith("EXTERNAL_"))
"""Modes that somebody outside the autopilot flies, in the order of their numbers."""

AUTO_MODES: Final = frozenset(
    {
        FlightMode.MISSION,
        FlightMode.HOLD,
        FlightMode.RTL,
        FlightMode.TAKEOFF,
        FlightMode.LAND,
        FlightMode.GUIDED_COURSE,
    }
)
"""Modes that the autopilot flies by itself."""

PREVENT_ARMING: Final = frozenset({FlightMode.RTL, FlightMode.LAND, FlightMode.TERMINATION})
"""Modes in which PX4 refuses to arm (`ModeUtil/mode_requirements.cpp`)."""

CUSTOM_MODE_ENABLED: Final = 1
"""MAV_MODE_FLAG: the mode is PX4's own number, not one that MAVLink names."""

_MAIN_AUTO: Final = 4
_MAIN_SUB: Final[dict[FlightMode, tuple[int, int]]] = {
    FlightMode.MANUAL: (1, 0),
    FlightMode.ALTCTL: (2, 0),
    FlightMode.POSCTL: (3, 0),
    FlightMode.TAKEOFF: (_MAIN_AUTO, 2),
    FlightMode.HOLD: (_MAIN_AUTO, 3),
    FlightMode.MISSION: (_MAIN_AUTO, 4),
    FlightMode.RTL: (_MAIN_AUTO, 5),
    FlightMode.LAND: (_MAIN_AUTO, 6),
    FlightMode.ACRO: (5, 0),
    FlightMode.OFFBOARD: (6, 0),
    FlightMode.STABILIZED: (7, 0),
    FlightMode.TERMINATION: (10, 0),
    FlightMode.ALTITUDE_CRUISE: (11, 0),
    **{mode: (_MAIN_AUTO, 11 + place) for place, mode in enumerate(EXTERNAL_MODES)},
    FlightMode.GUIDED_COURSE: (_MAIN_AUTO, 19),
}
_FROM_WIRE: Final = {wire: mode for mode, wire in _MAIN_SUB.items() if mode is not FlightMode.TERMINATION}
_STANDARD: Final = {
    FlightMode.POSCTL: 1,
    FlightMode.ALTCTL: 4,
    FlightMode.RTL: 5,
    FlightMode.MISSION: 6,
    FlightMode.LAND: 7,
    FlightMode.TAKEOFF: 8,
}


MAIN_MODES: Final = frozenset(main for main, _ in _MAIN_SUB.values())
"""Main modes that there are."""


def from_standard(standard: int) -> FlightMode | None:
    """The mode that DO_SET_STANDARD_MODE names; `None` for one that the plant does not know."""
    return next((mode for mode, number in _STANDARD.items() if number == standard), None)


def custom_mode(mode: FlightMode) -> int:
    """HEARTBEAT.custom_mode of a mode: main mode in the third byte, sub mode in the fourth."""
    main, sub = _MAIN_SUB[mode]
    return main << 16 | sub << 24


def standard_mode(mode: FlightMode) -> int:
    """MAV_STANDARD_MODE of a mode; 0 (non-standard) for Hold and OFFBOARD, as PX4 reports them."""
    return _STANDARD.get(mode, 0)


def from_main_sub(main: int, sub: int, version: Px4Version = Px4Version.V1_17) -> FlightMode | None:
    """The mode that DO_SET_MODE names by its parameters 2 and 3; `None` for one that this PX4 does not know."""
    if (main, sub) == _MAIN_SUB[FlightMode.GUIDED_COURSE] and version is Px4Version.V1_17:
        return None
    if main == _MAIN_AUTO and sub == 0:
        return FlightMode.MISSION
    if main == _MAIN_SUB[FlightMode.POSCTL][0]:
        return FlightMode.POSCTL
    return _FROM_WIRE.get((main, sub if main == _MAIN_AUTO else 0))
