"""AVAILABLE_MODES of a multicopter, in the order of PX4's navigation states.

Source: PX4 v1.17 `msg/versioned/VehicleStatus.msg`, `px4_custom_mode.h`.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

from pymavlink.dialects.v20 import development as mavlink

_AUTO: Final = 4
_NOT_BY_USER: Final = mavlink.MAV_MODE_PROPERTY_NOT_USER_SELECTABLE
_ADVANCED: Final = mavlink.MAV_MODE_PROPERTY_ADVANCED


class AvailableMode(NamedTuple):
    """One mode: its name, its number on the wire, the MAV_STANDARD_MODE it is, MAV_MODE_PROPERTY."""

    name: str
    main: int
    sub: int = 0
    standard: int = 0
    properties: int = 0


AVAILABLE_MODES: Final = (
    AvailableMode("Manual", 1),
    AvailableMode("Altitude", 2, standard=4),
    AvailableMode("Position", 3, standard=1),
    AvailableMode("Mission", _AUTO, 4, standard=6),
    AvailableMode("Hold", _AUTO, 3),
    AvailableMode("Return", _AUTO, 5, standard=5),
    AvailableMode("Position Slow", 3, 2),
    AvailableMode("Acro", 5),
    AvailableMode("Descend", _AUTO, 6, properties=_NOT_BY_USER),
    AvailableMode("Termination", 10, properties=_NOT_BY_USER),
    AvailableMode("Offboard", 6, properties=_ADVANCED),
    AvailableMode("Stabilized", 7),
    AvailableMode("Takeoff", _AUTO, 2, standard=8),
    AvailableMode("Land", _AUTO, 6, standard=7),
    AvailableMode("Follow Target", _AUTO, 8, properties=_ADVANCED),
    AvailableMode("Precision Landing", _AUTO, 9, properties=_ADVANCED),
    AvailableMode("Orbit", 3, 1, standard=2),
    AvailableMode("VTOL Takeoff", _AUTO, 10, properties=_ADVANCED),
    *(AvailableMode(f"External {n}", _AUTO, 10 + n, properties=_NOT_BY_USER) for n in range(1, 9)),
)


def available_modes(index: float) -> list[Any]:
    """The messages that answer a request for one mode, from 1, or for all of them, 0."""
    number = len(AVAILABLE_MODES)
    return [
        mavlink.MAVLink_available_modes_message(
            number_modes=number,
            mode_index=place,
            standard_mode=mode.standard,
            custom_mode=mode.main << 16 | mode.sub << 24,
            properties=mode.properties,
            mode_name=mode.name.encode(),
        )
        for place, mode in enumerate(AVAILABLE_MODES, 1)
        if index in (0, place)
    ]
