"""PX4's flight modes and answers as plain values. The numbers are those of `companion.mavlink.px4`."""

from __future__ import annotations

from typing import Final

from pymavlink.dialects.v20 import development as mavlink

from companion.mavlink.px4 import Mode, Result, mode_name

__all__ = ["BY_STICKS", "Mode", "Result", "killed", "mode_name"]

# Modes that somebody with sticks chooses. Hold, Return, Land and the like a failsafe chooses too.
BY_STICKS: Final = frozenset(
    {
        Mode.MANUAL,
        Mode.STABILIZED,
        Mode.ACRO,
        Mode.ALTITUDE,
        Mode.ALTITUDE_CRUISE,
        Mode.POSITION,
        Mode.POSITION_SLOW,
    }
)


def killed(mode: int, system_status: int) -> bool:
    """Kill switch or flight termination. PX4 tells both as MAV_STATE_FLIGHT_TERMINATION in its HEARTBEAT.

    A kill leaves the mode as it is; PX4 disarms five seconds later. Source: `streams/HEARTBEAT.hpp`, `Commander.cpp`.
    """
    return mode == Mode.TERMINATION or system_status == mavlink.MAV_STATE_FLIGHT_TERMINATION
