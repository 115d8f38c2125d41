"""What the autopilot is asked to do: PX4's MAV_CMDs, each with every answer that PX4 gives."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final, NamedTuple

from companion.mavlink.px4 import Result
from sitl.autopilot.autopilot import Autopilot
from sitl.autopilot.geodesy import GlobalPosition, to_local
from sitl.autopilot.modes import CUSTOM_MODE_ENABLED, MAIN_MODES, FlightMode, from_main_sub, from_standard
from sitl.autopilot.navigator import Home
from sitl.autopilot.parameters import Px4Version
from sitl.autopilot.request_faults import Answer

FORCE: Final = 21196  # MAV_CMD_COMPONENT_ARM_DISARM, parameter 2


class VehicleCommand(NamedTuple):
    """A MAV_CMD with its seven parameters; 5 and 6 in degrees where they are a place."""

    number: int
    p1: float = 0.0
    p2: float = 0.0
    p3: float = 0.0
    p4: float = 0.0
    p5: float = 0.0
    p6: float = 0.0
    p7: float = 0.0


Results = tuple[Result, ...]


def execute(autopilot: Autopilot, command: VehicleCommand) -> Results:
    """Execute a command; every answer PX4 sends, in order.

    DO_SET_MODE has two in v1.17, where the link says ACCEPTED before the commander decides; v1.18 sends the decision.
    """
    how = _COMMANDS.get(command.number)
    if how is None:
        return (Result.UNSUPPORTED,)
    results = how(autopilot, command)
    autopilot.follow_mode()
    return results


def set_mode(autopilot: Autopilot, base_mode: int, main_mode: int, sub_mode: int) -> Result:
    """The decision on DO_SET_MODE, and on the SET_MODE message. The navigator follows at the next control step."""
    version = autopilot.parameters.version
    custom = bool(base_mode & CUSTOM_MODE_ENABLED)
    named = main_mode in MAIN_MODES if custom else bool(base_mode & 64)
    if not named:  # nothing is done; v1.17 does not say so
        return Result.ACCEPTED if version is Px4Version.V1_17 else Result.TEMPORARILY_REJECTED
    mode = from_main_sub(main_mode, sub_mode, version) if custom else FlightMode.POSCTL
    if mode is None:
        return Result.TEMPORARILY_REJECTED
    return switch(autopilot, mode, force=mode is FlightMode.LAND)


def switch(autopilot: Autopilot, mode: FlightMode, *, force: bool = False) -> Result:
    """A request for a mode: taken as the autopilot's request faults have it, or else to its commander."""
    if autopilot.request_faults is not None:
        answer = autopilot.request_faults.asked(mode, autopilot.time_us)
        if answer is not None:
            return Result.TEMPORARILY_REJECTED if answer is Answer.REFUSED else Result.ACCEPTED
    granted = autopilot.commander.request(mode, autopilot.time_us, force=force)
    return Result.ACCEPTED if granted else Result.TEMPORARILY_REJECTED


def _return(autopilot: Autopilot, _: VehicleCommand) -> Results:
    return (switch(autopilot, FlightMode.RTL),)


def _land(autopilot: Autopilot, _: VehicleCommand) -> Results:
    return (switch(autopilot, FlightMode.LAND, force=True),)


def _set_mode(autopilot: Autopilot, command: VehicleCommand) -> Results:
    decision = set_mode(autopilot, _whole(command.p1), _whole(command.p2), _whole(command.p3))
    return (Result.ACCEPTED, decision) if autopilot.parameters.version is Px4Version.V1_17 else (decision,)


def _set_standard_mode(autopilot: Autopilot, command: VehicleCommand) -> Results:
    mode = from_standard(_whole(command.p1))
    if mode is None:
        return (Result.DENIED,)
    return (switch(autopilot, mode, force=mode is FlightMode.LAND),)


def _take_off(autopilot: Autopilot, command: VehicleCommand) -> Results:
    altitude_m = None
    if math.isfinite(command.p7) and command.p7 > 0.0:
        down = to_local(GlobalPosition(0.0, 0.0, command.p7))[2]
        altitude_m = autopilot.home.position_ned_m[2] - down
    result = switch(autopilot, FlightMode.TAKEOFF)
    autopilot.follow_mode(altitude_m)
    return (result,)


def _arm_disarm(autopilot: Autopilot, command: VehicleCommand) -> Results:
    now, force = autopilot.time_us, _whole(command.p2) == FORCE
    commander, faults = autopilot.commander, autopilot.request_faults
    action = _whole(command.p1)
    if action == 1:
        if faults is not None and faults.arming is not None:
            return (Result.TEMPORARILY_REJECTED if faults.arming is Answer.REFUSED else Result.ACCEPTED,)
        was_armed = commander.armed
        done = commander.arm(now)  # by command the checks run even if forced
        if done and not was_armed:
            state = autopilot.estimate()
            autopilot.home = Home(state.position_ned_m, state.q_wxyz, now)
            autopilot.navigator.enter(commander.mode, state, autopilot.home, now)
    elif action == 0:
        done = commander.disarm(now, "command", force=force)
    else:
        return ()  # neither: PX4 says nothing at all
    return (Result.ACCEPTED if done else Result.TEMPORARILY_REJECTED,)


def _terminate(autopilot: Autopilot, command: VehicleCommand) -> Results:
    if command.p1 <= 0.5 or not autopilot.commander.armed:
        return (Result.DENIED,)
    return (switch(autopilot, FlightMode.TERMINATION, force=True),)


def _reposition(autopilot: Autopilot, command: VehicleCommand) -> Results:
    if _whole(command.p2) != 1:
        return (Result.UNSUPPORTED,)
    result = switch(autopilot, FlightMode.HOLD)
    if result is Result.ACCEPTED:
        autopilot.follow_mode()
        here = autopilot.navigator.target_ned_m
        place = to_local(GlobalPosition(command.p5, command.p6, command.p7))
        x, y, z = (wanted if math.isfinite(wanted) else now for wanted, now in zip(place, here, strict=True))
        autopilot.navigator.go_to((x, y, z), command.p4 if math.isfinite(command.p4) else None)
    return (result,)


def _set_home(autopilot: Autopilot, command: VehicleCommand) -> Results:
    position = autopilot.estimate().position_ned_m
    if command.p1 <= 0.5:
        position = to_local(GlobalPosition(command.p5, command.p6, command.p7))
        if not all(map(math.isfinite, position)):
            return (Result.DENIED,)
    autopilot.home = Home(position, autopilot.estimate().q_wxyz, autopilot.time_us)
    return (Result.ACCEPTED,)


def _storage(autopilot: Autopilot, _: VehicleCommand) -> Results:
    return (Result.TEMPORARILY_REJECTED if autopilot.commander.armed else Result.ACCEPTED,)


def _reboot(_: Autopilot, command: VehicleCommand) -> Results:
    return (Result.ACCEPTED if _whole(command.p1) == 0 else Result.DENIED,)


def _change_speed(_: Autopilot, __: VehicleCommand) -> Results:
    return (Result.ACCEPTED,)  # the plant flies none but its own


def _calibrate(autopilot: Autopilot, _: VehicleCommand) -> Results:
    return (Result.TEMPORARILY_REJECTED if autopilot.commander.armed else Result.ACCEPTED,)


def _run_prearm_checks(_: Autopilot, __: VehicleCommand) -> Results:
    return (Result.ACCEPTED,)


def _whole(value: float) -> int:
    return round(value) if math.isfinite(value) else -1


_COMMANDS: Final[dict[int, Callable[[Autopilot, VehicleCommand], Results]]] = {  # by MAV_CMD
    20: _return,
    21: _land,
    22: _take_off,
    176: _set_mode,
    178: _change_speed,
    179: _set_home,
    185: _terminate,
    192: _reposition,
    241: _calibrate,
    245: _storage,
    246: _reboot,
    262: _set_standard_mode,
    400: _arm_disarm,
    401: _run_prearm_checks,
}
