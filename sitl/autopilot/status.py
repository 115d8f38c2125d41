"""What an autopilot says of itself in HEARTBEAT and EXTENDED_SYS_STATE."""

from __future__ import annotations

from sitl.autopilot.autopilot import Autopilot
from sitl.autopilot.modes import AUTO_MODES, CUSTOM_MODE_ENABLED, STICK_MODES, FlightMode, LandedState


def landed_state(autopilot: Autopilot) -> LandedState:
    """EXTENDED_SYS_STATE.landed_state."""
    if autopilot.commander.landed:
        return LandedState.ON_GROUND
    if autopilot.commander.mode is FlightMode.TAKEOFF:
        return LandedState.TAKEOFF
    return LandedState.LANDING if autopilot.navigator.landing else LandedState.IN_AIR


def base_mode(autopilot: Autopilot) -> int:
    """HEARTBEAT.base_mode (MAV_MODE_FLAG)."""
    mode = autopilot.commander.mode
    flags = CUSTOM_MODE_ENABLED | (128 if autopilot.commander.armed else 0)
    if mode in AUTO_MODES:
        return flags | 4 | 8 | 16
    if mode in STICK_MODES:
        return flags | 16 | 64
    return flags | 16 if mode is FlightMode.OFFBOARD else flags


def system_status(autopilot: Autopilot) -> int:
    """HEARTBEAT.system_status (MAV_STATE)."""
    commander = autopilot.commander
    if commander.mode is FlightMode.TERMINATION or commander.killed:
        return 8
    if commander.armed:
        return 5 if commander.failsafe else 4
    return 3 if commander.can_arm(autopilot.time_us) else 0
