"""What the autopilot is asked to do: PX4's MAV_CMDs, each with every answer that PX4 v1.17 gives."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Final, NamedTuple

from companion.mavlink.px4 import Result
from sitl.autopilot.geodesy import GlobalPosition, to_local
from sitl.autopilot.modes import FlightMode, from_main_sub
from sitl.autopilot.navigator import Home
from sitl.autopilot.request_faults import Answer

if TYPE_CHECKING:
    from sitl.autopilot.autopilot import Autopilot

FORCE: Final = 21196  # MAV_CMD_COMPONENT_ARM_DISARM, parameter 2
CUSTOM_MODE_ENABLED: Final = 1  # MAV_MODE_FLAG


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


class Requests:
    """Executes commands on one autopilot."""

    def __init__(self, autopilot: Autopilot) -> None:
        self._autopilot = autopilot
        self._takeoff_altitude_m: float | None = None
        self._commands: dict[int, Callable[[VehicleCommand], tuple[Result, ...]]] = {
            20: lambda _: (self.switch(FlightMode.RTL),),
            21: lambda _: (self.switch(FlightMode.LAND, force=True),),
            22: self._take_off,
            176: self._set_mode,
            179: self._set_home,
            185: self._terminate,
            192: self._reposition,
            245: self._storage,
            246: self._reboot,
            400: self._arm_disarm,
            401: lambda _: (Result.ACCEPTED,),
        }

    def execute(self, command: VehicleCommand) -> tuple[Result, ...]:
        """Execute a command; every answer PX4 sends, in order.

        DO_SET_MODE has two: the link says ACCEPTED before the commander decides.
        """
        execute = self._commands.get(command.number)
        if execute is None:
            return (Result.UNSUPPORTED,)
        results = execute(command)
        self._autopilot.follow_mode(self._takeoff_altitude_m)
        self._takeoff_altitude_m = None
        return results

    def set_mode(self, base_mode: int, main_mode: int, sub_mode: int) -> Result:
        """The decision on DO_SET_MODE, and on the SET_MODE message."""
        if not base_mode & CUSTOM_MODE_ENABLED:
            mode: FlightMode | None = FlightMode.POSCTL if base_mode & 64 else None
        else:
            mode = from_main_sub(main_mode, sub_mode)
        if mode is None:
            return Result.TEMPORARILY_REJECTED
        return self.switch(mode, force=mode is FlightMode.LAND)

    def switch(self, mode: FlightMode, *, force: bool = False) -> Result:
        """A request for a mode: taken as the autopilot's obedience has it, or else to its commander."""
        autopilot = self._autopilot
        if autopilot.obedience is not None:
            answer = autopilot.obedience.asked(mode, autopilot.time_us)
            if answer is not None:
                return Result.TEMPORARILY_REJECTED if answer is Answer.REFUSED else Result.ACCEPTED
        granted = autopilot.commander.request(mode, autopilot.time_us, force=force)
        return Result.ACCEPTED if granted else Result.TEMPORARILY_REJECTED

    def _set_mode(self, command: VehicleCommand) -> tuple[Result, ...]:
        return Result.ACCEPTED, self.set_mode(_whole(command.p1), _whole(command.p2), _whole(command.p3))

    def _take_off(self, command: VehicleCommand) -> tuple[Result, ...]:
        if math.isfinite(command.p7) and command.p7 > 0.0:
            down = to_local(GlobalPosition(0.0, 0.0, command.p7))[2]
            self._takeoff_altitude_m = self._autopilot.home.position_ned_m[2] - down
        return (self.switch(FlightMode.TAKEOFF),)

    def _arm_disarm(self, command: VehicleCommand) -> tuple[Result, ...]:
        now, force = self._autopilot.time_us, _whole(command.p2) == FORCE
        action = _whole(command.p1)
        if action == 1:
            obedience = self._autopilot.obedience
            if obedience is not None and obedience.arming is not None:
                refused = obedience.arming is Answer.REFUSED
                return (Result.TEMPORARILY_REJECTED if refused else Result.ACCEPTED,)
            was_armed = self._autopilot.commander.armed
            done = self._autopilot.commander.arm(now)  # by command the checks run even if forced
            if done and not was_armed:
                state = self._autopilot.estimate()
                self._autopilot.home = Home(state.position_ned_m, state.q_wxyz, now)
                self._autopilot.navigator.enter(self._autopilot.commander.mode, state, self._autopilot.home, now)
        elif action == 0:
            done = self._autopilot.commander.disarm(now, "command", force=force)
        else:
            return (Result.UNSUPPORTED,)
        return (Result.ACCEPTED if done else Result.TEMPORARILY_REJECTED,)

    def _terminate(self, command: VehicleCommand) -> tuple[Result, ...]:
        if command.p1 <= 0.5 or not self._autopilot.commander.armed:
            return (Result.DENIED,)
        return (self.switch(FlightMode.TERMINATION, force=True),)

    def _reposition(self, command: VehicleCommand) -> tuple[Result, ...]:
        if _whole(command.p2) != 1:
            return (Result.UNSUPPORTED,)
        result = self.switch(FlightMode.HOLD)
        if result is Result.ACCEPTED:
            self._autopilot.follow_mode()
            here = self._autopilot.navigator.target_ned_m
            place = to_local(GlobalPosition(command.p5, command.p6, command.p7))
            target = [wanted if math.isfinite(wanted) else now for wanted, now in zip(place, here, strict=True)]
            self._autopilot.navigator.go_to(
                (target[0], target[1], target[2]), command.p4 if math.isfinite(command.p4) else None
            )
        return (result,)

    def _set_home(self, command: VehicleCommand) -> tuple[Result, ...]:
        position = self._autopilot.estimate().position_ned_m
        if command.p1 <= 0.5:
            position = to_local(GlobalPosition(command.p5, command.p6, command.p7))
            if not all(map(math.isfinite, position)):
                return (Result.DENIED,)
        self._autopilot.home = Home(position, self._autopilot.estimate().q_wxyz, self._autopilot.time_us)
        return (Result.ACCEPTED,)

    def _storage(self, _: VehicleCommand) -> tuple[Result, ...]:
        return (Result.TEMPORARILY_REJECTED if self._autopilot.commander.armed else Result.ACCEPTED,)

    def _reboot(self, command: VehicleCommand) -> tuple[Result, ...]:
        return (Result.ACCEPTED if _whole(command.p1) == 0 else Result.DENIED,)


def _whole(value: float) -> int:
    return round(value) if math.isfinite(value) else -1
