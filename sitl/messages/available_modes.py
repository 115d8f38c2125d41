"""AVAILABLE_MODES of a multicopter without VTOL, in the order of PX4's navigation states, as both versions answered.

A standard mode has no name, and the eight external modes are listed although nobody has registered one.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

from pymavlink.dialects.v20 import development as mavlink

from sitl.autopilot.parameters import Px4Version

_AUTO: Final = 4
_EXTERNAL_1: Final = 11
_NOT_BY_USER: Final = mavlink.MAV_MODE_PROPERTY_NOT_USER_SELECTABLE
_ADVANCED: Final = mavlink.MAV_MODE_PROPERTY_ADVANCED


class AvailableMode(NamedTuple):
    """One mode: its name, its number on the wire, the MAV_STANDARD_MODE it is, MAV_MODE_PROPERTY."""

    name: str
    main: int
    sub: int = 0
    standard: int = 0
    properties: int = _ADVANCED


_BEFORE: Final = (
    AvailableMode("Manual", 1),
    AvailableMode("", 2, standard=4, properties=0),  # Altitude
    AvailableMode("", 3, standard=1, properties=0),  # Position
    AvailableMode("", _AUTO, 4, standard=6),  # Mission
    AvailableMode("Hold", _AUTO, 3),
    AvailableMode("", _AUTO, 5, standard=5),  # Return
    AvailableMode("Position Slow", 3, 2),
)
_BEHIND: Final = (
    AvailableMode("Acro", 5),
    AvailableMode("Termination", 10, properties=_ADVANCED | _NOT_BY_USER),
    AvailableMode("Offboard", 6),
    AvailableMode("Stabilized", 7),
    AvailableMode("", _AUTO, 2, standard=8),  # Takeoff
    AvailableMode("", _AUTO, 6, standard=7),  # Land
    AvailableMode("Follow Target", _AUTO, 8),
    AvailableMode("Precision Landing", _AUTO, 9),
    AvailableMode("", 3, 1, standard=2),  # Orbit
    AvailableMode("VTOL Takeoff", _AUTO, 10),
    *(
        AvailableMode("(Mode not available)", _AUTO, sub, properties=_NOT_BY_USER)
        for sub in range(_EXTERNAL_1, _EXTERNAL_1 + 8)
    ),
)
AVAILABLE_MODES: Final = {
    Px4Version.V1_17: (*_BEFORE, AvailableMode("Altitude Cruise", 11, properties=0), *_BEHIND),
    Px4Version.V1_18: (
        *_BEFORE,
        AvailableMode("Guided Course", _AUTO, 19),
        AvailableMode("Altitude Cruise", 11),
        *_BEHIND,
    ),
}


def available_modes(index: float, version: Px4Version) -> list[Any]:
    """The messages that answer a request for one mode, from 1, or for all of them, 0."""
    modes = AVAILABLE_MODES[version]
    return [
        mavlink.MAVLink_available_modes_message(
            number_modes=len(modes),
            mode_index=place,
            standard_mode=mode.standard,
            custom_mode=mode.main << 16 | mode.sub << 24,
            properties=mode.properties,
            mode_name=mode.name.encode(),
        )
        for place, mode in enumerate(modes, 1)
        if index in (0, place)
    ]
