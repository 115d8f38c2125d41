"""PX4 as a companion computer meets it, without sockets and without a wall clock.

`Autopilot` steps a vehicle through simulated time and answers set-points and commands as PX4 v1.17 does: `commander`
decides which mode flies, `navigator` flies it. What PX4 does that surprises is written where it is done.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from typing import Final, NamedTuple

from companion.mavlink.px4 import Result
from sitl.commander import Commander
from sitl.geodesy import GlobalPosition, to_local
from sitl.modes import AUTO_MODES, STICK_MODES, LandedState, Mode, Severity, from_main_sub
from sitl.navigator import Home, Navigator
from sitl.parameters import Parameters
from sitl.position_hold import AttitudeThrust, attitude_from_acceleration
from sitl.vehicle import Vehicle, VehicleState

PHYSICS_DT_US: Final = 1_000
CONTROL_DT_US: Final = 10_000
LAND_DETECTION_US: Final = 1_000_000
LANDED_THRUST_SHARE: Final = 0.3  # of hover thrust: below, a vehicle on the ground counts as landed

ATTITUDE_IGNORE: Final = 0x80  # ATTITUDE_TARGET_TYPEMASK
THROTTLE_IGNORE: Final = 0x40
THRUST_BODY_SET: Final = 0x20
ROLL_OR_PITCH_RATE_IGNORE: Final = 0x03

FORCE: Final = 21196  # MAV_CMD_COMPONENT_ARM_DISARM, parameter 2
CUSTOM_MODE_ENABLED: Final = 1  # MAV_MODE_FLAG


class Notice(NamedTuple):
    """One STATUSTEXT."""

    severity: Severity
    text: str


class Command(NamedTuple):
    """A MAV_CMD with its seven parameters; 5 and 6 in degrees where they are a place."""

    number: int
    p1: float = 0.0
    p2: float = 0.0
    p3: float = 0.0
    p4: float = 0.0
    p5: float = 0.0
    p6: float = 0.0
    p7: float = 0.0


class Autopilot:
    """One autopilot with its vehicle.

    Attributes:
        time_us: simulated time since boot; moves in steps of the physics.
        setpoint: attitude and thrust that the attitude loop follows now.
        commander: arming and modes.
        home: where it was armed last.
        reset_counter: of the estimator, for ODOMETRY.
        notices: status texts nobody has taken yet.
        estimate: what the autopilot believes about its state; the truth unless replaced.
    """

    def __init__(self, vehicle: Vehicle, parameters: Parameters | None = None) -> None:
        self.vehicle = vehicle
        self.parameters = parameters or Parameters({"MPC_THR_HOVER": vehicle.hover_thrust})
        self.time_us = 0
        self.reset_counter = 0
        self.notices: deque[Notice] = deque(maxlen=32)
        self.estimate: Callable[[], VehicleState] = lambda: vehicle.state
        self.commander = Commander(self.parameters, vehicle.can_fly, self._notify)
        self.navigator = Navigator(self.parameters, vehicle.hover_thrust, vehicle.can_fly)
        self.home = Home(vehicle.state.position_ned_m, vehicle.state.q_wxyz, 0)
        self.setpoint = AttitudeThrust(vehicle.state.q_wxyz, 0.0)
        self._next_control_us = 0
        self._flying_mode = self.commander.mode
        self._takeoff_altitude_m: float | None = None
        self._contact_since_us: int | None = 0
        self._commands: dict[int, Callable[[Command], tuple[Result, ...]]] = {
            20: lambda _: self._switch(Mode.RTL),
            21: lambda _: self._switch(Mode.LAND, force=True),
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

    # --- time -------------------------------------------------------------------------------------------------------

    def advance(self, to_time_us: int) -> None:
        """Run up to a simulated time, as far as whole physics steps go."""
        step = self.vehicle.step
        dt_s = 1e-6 * PHYSICS_DT_US
        now = self.time_us
        last = to_time_us - PHYSICS_DT_US
        while now <= last:
            if now >= self._next_control_us:
                self.time_us = now
                self._control()
                self._next_control_us = now + CONTROL_DT_US
            q_wxyz, thrust = self.setpoint
            until = min(last, self._next_control_us - PHYSICS_DT_US)
            while now <= until:
                step(q_wxyz, thrust, dt_s)
                now += PHYSICS_DT_US
        self.time_us = now

    def _control(self) -> None:
        commander, vehicle = self.commander, self.vehicle
        self._detect_landing()
        commander.update(self.time_us)
        if not commander.armed or commander.mode is Mode.TERMINATION:
            self._follow_mode()
            self.setpoint = AttitudeThrust(self.setpoint.q_wxyz, 0.0)
            return
        self._follow_mode()
        if self.navigator.takeoff_reached and commander.mode is Mode.TAKEOFF:
            commander.request(Mode.HOLD, self.time_us, force=True)
            self._follow_mode()
        mode = commander.mode
        if mode is Mode.OFFBOARD:
            return  # the last set-point stands until another comes or COM_OF_LOSS_T has passed
        if mode in STICK_MODES and mode is not Mode.POSCTL:
            level = attitude_from_acceleration(0.0, 0.0, 0.0, self.navigator.yaw_rad)
            self.setpoint = AttitudeThrust(level, 0.0 if commander.landed else vehicle.hover_thrust)
            return
        self.setpoint = self.navigator.step(
            self.estimate(),
            self.home,
            self.time_us,
            1e-6 * CONTROL_DT_US,
            on_ground=vehicle.on_ground(),
            armed_at_us=commander.armed_at_us,
        )

    def _follow_mode(self) -> None:
        mode = self.commander.mode
        if mode is not self._flying_mode:
            self._flying_mode = mode
            altitude, self._takeoff_altitude_m = self._takeoff_altitude_m, None
            self.navigator.enter(mode, self.estimate(), self.home, self.time_us, altitude)

    def _detect_landing(self) -> None:
        commander, now = self.commander, self.time_us
        if not self.vehicle.can_fly:  # a rig counts as flying while its motors carry it
            commander.landed = not commander.armed or commander.mode is Mode.LAND
            return
        if not self.vehicle.on_ground():
            if commander.landed and commander.armed:
                self._notify(Severity.INFO, "Takeoff detected")
            commander.landed = False
            self._contact_since_us = None
        elif commander.landed or self.setpoint.thrust > LANDED_THRUST_SHARE * self.vehicle.hover_thrust:
            self._contact_since_us = None
        elif self._contact_since_us is None:
            self._contact_since_us = now
        elif now - self._contact_since_us >= LAND_DETECTION_US:
            commander.landed = True
            self._notify(Severity.INFO, "Landing detected")

    # --- what it tells ----------------------------------------------------------------------------------------------

    @property
    def landed_state(self) -> LandedState:
        """EXTENDED_SYS_STATE.landed_state."""
        if self.commander.landed:
            return LandedState.ON_GROUND
        if self.commander.mode is Mode.TAKEOFF:
            return LandedState.TAKEOFF
        return LandedState.LANDING if self.navigator.landing else LandedState.IN_AIR

    @property
    def base_mode(self) -> int:
        """HEARTBEAT.base_mode (MAV_MODE_FLAG)."""
        mode = self.commander.mode
        flags = CUSTOM_MODE_ENABLED | (128 if self.commander.armed else 0)
        if mode in AUTO_MODES:
            return flags | 4 | 8 | 16
        if mode in STICK_MODES:
            return flags | 16 | 64
        return flags | 16 if mode is Mode.OFFBOARD else flags

    @property
    def system_status(self) -> int:
        """HEARTBEAT.system_status (MAV_STATE)."""
        commander = self.commander
        if commander.mode is Mode.TERMINATION:
            return 8
        if commander.armed:
            return 5 if commander.failsafe else 4
        return 3 if commander.can_arm(self.time_us) else 0

    # --- what it is told --------------------------------------------------------------------------------------------

    def on_attitude_target(
        self, q_wxyz: tuple[float, float, float, float], thrust: float, type_mask: int = 0x07
    ) -> None:
        """SET_ATTITUDE_TARGET, executed on arrival: PX4 neither validates it nor looks at its time stamp.

        A throttle-ignore bit means zero thrust. A set-point that is no number keeps OFFBOARD alive, but motors told
        nothing finite stand still, so it too means zero thrust here. Body rates alone keep OFFBOARD alive; the plant
        does not fly them.
        """
        attitude = not type_mask & ATTITUDE_IGNORE
        if not attitude and type_mask & ROLL_OR_PITCH_RATE_IGNORE:
            return
        commander = self.commander
        commander.setpoint_arrived(self.time_us)
        if commander.user_mode is Mode.OFFBOARD and commander.mode is not Mode.OFFBOARD:
            commander.update(self.time_us)  # the stream is back: OFFBOARD again, from whatever the failsafe flew
        if not attitude or commander.mode is not Mode.OFFBOARD or not commander.armed:
            return
        if type_mask & (THROTTLE_IGNORE | THRUST_BODY_SET):
            thrust = 0.0
        w, x, y, z = q_wxyz
        norm = math.sqrt(w * w + x * x + y * y + z * z)
        if not (0.0 < norm < math.inf) or math.isnan(thrust):
            self.setpoint = AttitudeThrust(self.setpoint.q_wxyz, 0.0)
            return
        thrust = 0.0 if thrust < 0.0 else min(thrust, 1.0)  # what motors can do
        self.setpoint = AttitudeThrust((w / norm, x / norm, y / norm, z / norm), thrust)

    def on_command(self, command: Command) -> tuple[Result, ...]:
        """Execute a command; every answer PX4 sends, in order.

        DO_SET_MODE has two: the link says ACCEPTED before the commander decides.
        """
        execute = self._commands.get(command.number)
        if execute is None:
            return (Result.UNSUPPORTED,)
        results = execute(command)
        self._follow_mode()
        self._takeoff_altitude_m = None
        return results

    def set_mode(self, base_mode: int, main_mode: int, sub_mode: int) -> Result:
        """The decision on DO_SET_MODE, and on the SET_MODE message."""
        if not base_mode & CUSTOM_MODE_ENABLED:
            mode: Mode | None = Mode.POSCTL if base_mode & 64 else None
        else:
            mode = from_main_sub(main_mode, sub_mode)
        if mode is None:
            return Result.TEMPORARILY_REJECTED
        return self._switch(mode, force=mode is Mode.LAND)[0]

    def _switch(self, mode: Mode, *, force: bool = False) -> tuple[Result]:
        granted = self.commander.request(mode, self.time_us, force=force)
        return (Result.ACCEPTED if granted else Result.TEMPORARILY_REJECTED,)

    def _set_mode(self, command: Command) -> tuple[Result, ...]:
        return Result.ACCEPTED, self.set_mode(_whole(command.p1), _whole(command.p2), _whole(command.p3))

    def _take_off(self, command: Command) -> tuple[Result, ...]:
        if math.isfinite(command.p7) and command.p7 > 0.0:
            down = to_local(GlobalPosition(0.0, 0.0, command.p7))[2]
            self._takeoff_altitude_m = self.home.position_ned_m[2] - down
        return self._switch(Mode.TAKEOFF)

    def _arm_disarm(self, command: Command) -> tuple[Result, ...]:
        now, force = self.time_us, _whole(command.p2) == FORCE
        action = _whole(command.p1)
        if action == 1:
            was_armed = self.commander.armed
            done = self.commander.arm(now)  # by command the checks run even if forced
            if done and not was_armed:
                state = self.estimate()
                self.home = Home(state.position_ned_m, state.q_wxyz, now)
                self.navigator.enter(self.commander.mode, state, self.home, now)
        elif action == 0:
            done = self.commander.disarm(now, "command", force=force)
        else:
            return (Result.UNSUPPORTED,)
        return (Result.ACCEPTED if done else Result.TEMPORARILY_REJECTED,)

    def _terminate(self, command: Command) -> tuple[Result, ...]:
        if command.p1 <= 0.5 or not self.commander.armed:
            return (Result.DENIED,)
        return self._switch(Mode.TERMINATION, force=True)

    def _reposition(self, command: Command) -> tuple[Result, ...]:
        if _whole(command.p2) != 1:
            return (Result.UNSUPPORTED,)
        result = self._switch(Mode.HOLD)
        if result[0] is Result.ACCEPTED:
            self._follow_mode()
            here = self.navigator.target_ned_m
            place = to_local(GlobalPosition(command.p5, command.p6, command.p7))
            target = [wanted if math.isfinite(wanted) else now for wanted, now in zip(place, here, strict=True)]
            self.navigator.go_to((target[0], target[1], target[2]), command.p4 if math.isfinite(command.p4) else None)
        return result

    def _set_home(self, command: Command) -> tuple[Result, ...]:
        position = self.estimate().position_ned_m
        if command.p1 <= 0.5:
            position = to_local(GlobalPosition(command.p5, command.p6, command.p7))
            if not all(map(math.isfinite, position)):
                return (Result.DENIED,)
        self.home = Home(position, self.estimate().q_wxyz, self.time_us)
        return (Result.ACCEPTED,)

    def _storage(self, _: Command) -> tuple[Result, ...]:
        return (Result.TEMPORARILY_REJECTED if self.commander.armed else Result.ACCEPTED,)

    def _reboot(self, command: Command) -> tuple[Result, ...]:
        return (Result.ACCEPTED if _whole(command.p1) == 0 else Result.DENIED,)

    def _notify(self, severity: Severity, text: str) -> None:
        self.notices.append(Notice(severity, text))


def _whole(value: float) -> int:
    return round(value) if math.isfinite(value) else -1
