"""PX4 as a companion computer meets it, without sockets and without a wall clock.

`Autopilot` steps a vehicle through simulated time and answers set-points and commands as PX4 does: `commander`
decides which mode flies, `navigator` flies it, `commands` acts on both. What PX4 does that surprises is written where
it is done.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from typing import Final, NamedTuple

from companion.control.types import GRAVITY_M_S2
from sitl.autopilot import position_control
from sitl.autopilot.attitude_reference import AttitudeReference
from sitl.autopilot.commander import Commander
from sitl.autopilot.modes import AUTO_MODES, CUSTOM_MODE_ENABLED, STICK_MODES, FlightMode, LandedState, Severity
from sitl.autopilot.navigator import Home, Navigator
from sitl.autopilot.parameters import Parameters, Px4Version
from sitl.autopilot.position_control import PositionControlParams, PositionControlSetpoint, PositionControlState
from sitl.autopilot.position_hold import AttitudeThrust, attitude_from_acceleration
from sitl.autopilot.request_faults import RequestFaults
from sitl.vehicles.rotation import turned
from sitl.vehicles.vehicle import Quadrotor, Vehicle, VehicleState
from sitl.world.estimator_status import NOMINAL

PHYSICS_DT_US: Final = 1_000
CONTROL_DT_US: Final = 10_000
_PX4_POSITION_CONTROL: Final = PositionControlParams()
LAND_DETECTION_US: Final = 1_000_000
LANDED_THRUST_SHARE: Final = 0.3  # of hover thrust: below, a vehicle on the ground counts as landed

ATTITUDE_IGNORE: Final = 0x80  # ATTITUDE_TARGET_TYPEMASK
THROTTLE_IGNORE: Final = 0x40
THRUST_BODY_SET: Final = 0x20
ROLL_OR_PITCH_RATE_IGNORE: Final = 0x03


class Notice(NamedTuple):
    """One STATUSTEXT."""

    severity: Severity
    text: str


class Autopilot:
    """One autopilot with its vehicle.

    Attributes:
        time_us: simulated time since boot; moves in steps of the physics.
        setpoint: attitude and thrust that are flown now; in v1.18 the attitude loop follows a reference model of it.
        commander: arming and modes.
        home: where it was armed last.
        reset_counter: of the estimator, for ODOMETRY.
        notices: status texts nobody has taken yet.
        estimate: what the autopilot believes about its state; the truth unless replaced.
        heading_error_rad: of the estimate, which the attitude loop turns the vehicle by.
        health: what the estimator says of itself.
        stamp_us: what ODOMETRY and TIMESYNC say the time is, from the time; the time itself unless replaced.
        request_faults: what it does wrong with requests; `None` for a healthy autopilot.
        on_control, on_setpoint: called with the time at every control step, and with every set-point that is executed
            (attitude, thrust, type mask), before they take effect.
    """

    def __init__(self, vehicle: Vehicle, parameters: Parameters | None = None) -> None:
        self.vehicle = vehicle
        self.parameters = parameters or Parameters({"MPC_THR_HOVER": vehicle.hover_thrust})
        self.time_us = 0
        self.reset_counter = 0
        self.notices: deque[Notice] = deque(maxlen=32)
        self.estimate: Callable[[], VehicleState] = self.truth
        self.heading_error_rad = 0.0
        self.health = NOMINAL
        self.stamp_us: Callable[[int], int] | None = None
        self.request_faults: RequestFaults | None = None
        self.on_control: Callable[[int], None] | None = None
        self.on_setpoint: Callable[[tuple[float, float, float, float], float, int], None] | None = None
        self.commander = Commander(self.parameters, vehicle.can_fly, self._notify)
        self.navigator = Navigator(self.parameters, vehicle.hover_thrust, vehicle.can_fly)
        self.home = Home(vehicle.state.position_ned_m, vehicle.state.q_wxyz, 0)
        self.setpoint = AttitudeThrust(vehicle.state.q_wxyz, 0.0)
        self._v1_17 = self.parameters.version is Px4Version.V1_17
        self._reference = None if self._v1_17 else AttitudeReference(self.parameters)
        self._position_target: tuple[PositionControlSetpoint, float] | None = None  # with its yaw
        self._position_control = PositionControlState()
        self._next_control_us = 0
        self._flying_mode = self.commander.mode
        self._contact_since_us: int | None = 0

    # --- time -------------------------------------------------------------------------------------------------------

    def advance(self, to_time_us: int) -> None:
        """Run up to a simulated time, as far as whole physics steps go."""
        step = self.vehicle.step
        now = self.time_us
        last = to_time_us - PHYSICS_DT_US
        while now <= last:
            if now >= self._next_control_us:
                self.time_us = now
                self._control()
                self._next_control_us = now + CONTROL_DT_US
            q_wxyz, thrust = self.setpoint
            if self._reference is not None:
                q_wxyz = self._reference.follow(q_wxyz, now)
            if self.heading_error_rad:
                q_wxyz = turned(q_wxyz, -self.heading_error_rad)
            until = min(last, self._next_control_us - PHYSICS_DT_US)
            while now <= until:
                step(q_wxyz, thrust)
                now += PHYSICS_DT_US
        self.time_us = now

    def _control(self) -> None:
        commander, vehicle = self.commander, self.vehicle
        if self.on_control is not None:
            self.on_control(self.time_us)
        if self.request_faults is not None:
            for late in self.request_faults.due(self.time_us):
                commander.request(late, self.time_us)
        self._detect_landing()
        commander.update(self.time_us)
        if not commander.armed or commander.mode is FlightMode.TERMINATION or commander.killed:
            self.follow_mode()
            self.setpoint = AttitudeThrust(self.setpoint.q_wxyz, 0.0)
            return
        self.follow_mode()
        if self.navigator.takeoff_reached and commander.mode is FlightMode.TAKEOFF:
            commander.request(FlightMode.HOLD, self.time_us, force=True)
            self.follow_mode()
        mode = commander.mode
        if mode is FlightMode.OFFBOARD:  # the last set-point stands until another comes or COM_OF_LOSS_T has passed
            if self._position_target is not None:
                self._fly_to(*self._position_target)
            return
        self._position_control = PositionControlState()
        if mode in STICK_MODES and mode is not FlightMode.POSCTL:
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

    def _detect_landing(self) -> None:
        commander, now = self.commander, self.time_us
        if not self.vehicle.can_fly:  # a rig counts as flying while its motors carry it
            commander.landed = not commander.armed or commander.mode is FlightMode.LAND
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

    def start_in_air(self, altitude_m: float, settle_s: float = 0.0) -> None:
        """Begin in Hold, armed, at an altitude over the ground, so that a flight need not begin with a take-off.

        `settle_s`: for how long Hold has flown already, which settles its integrals. A rig starts where it stands.
        """
        now_us, self.time_us = self.time_us, self.time_us - round(1e6 * settle_s)
        self._next_control_us = self.time_us
        self.commander.start_in_air(self.time_us)
        if isinstance(self.vehicle, Quadrotor):
            self.home = Home(self.vehicle.state.position_ned_m, self.vehicle.state.q_wxyz, now_us)
            self.vehicle.lift_to(-altitude_m)
        self._flying_mode = FlightMode.HOLD
        self.navigator.enter(FlightMode.HOLD, self.estimate(), self.home, self.time_us)
        self.advance(now_us)

    def now_us(self) -> int:
        """Simulated time since boot."""
        return self.time_us

    @property
    def told_us(self) -> int:
        """What its own clock says the time is, as ODOMETRY and TIMESYNC tell it."""
        return self.time_us if self.stamp_us is None else self.stamp_us(self.time_us)

    # --- what it tells ----------------------------------------------------------------------------------------------

    def truth(self) -> VehicleState:
        """The vehicle's true state, which it does not know."""
        return self.vehicle.state

    @property
    def landed_state(self) -> LandedState:
        """EXTENDED_SYS_STATE.landed_state."""
        if self.commander.landed:
            return LandedState.ON_GROUND
        if self.commander.mode is FlightMode.TAKEOFF:
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
        return flags | 16 if mode is FlightMode.OFFBOARD else flags

    @property
    def system_status(self) -> int:
        """HEARTBEAT.system_status (MAV_STATE)."""
        commander = self.commander
        if commander.mode is FlightMode.TERMINATION or commander.killed:
            return 8
        if commander.armed:
            return 5 if commander.failsafe else 4
        return 3 if commander.can_arm(self.time_us) else 0

    # --- what it is told --------------------------------------------------------------------------------------------

    def on_attitude_target(
        self, q_wxyz: tuple[float, float, float, float], thrust: float, type_mask: int = 0x07
    ) -> None:
        """SET_ATTITUDE_TARGET, executed on arrival: PX4 neither validates it nor looks at its time stamp.

        A throttle-ignore bit means zero thrust in v1.17; in v1.18 such a set-point is none, and does not keep OFFBOARD
        alive. A set-point that is no number keeps OFFBOARD alive, but motors told nothing finite stand still, so it too
        means zero thrust here. Body rates alone keep OFFBOARD alive; the plant does not fly them.
        """
        if self.on_setpoint is not None:
            self.on_setpoint(q_wxyz, thrust, type_mask)
        attitude = not type_mask & ATTITUDE_IGNORE
        if not attitude and type_mask & ROLL_OR_PITCH_RATE_IGNORE:
            return
        if type_mask & THROTTLE_IGNORE and not type_mask & THRUST_BODY_SET and not self._v1_17:
            return
        commander = self.commander
        self._position_target = None
        commander.setpoint_arrived(self.time_us)
        if commander.user_mode is FlightMode.OFFBOARD and commander.mode is not FlightMode.OFFBOARD:
            commander.update(self.time_us)  # the stream is back: OFFBOARD again, from whatever the failsafe flew
        if not attitude or commander.mode is not FlightMode.OFFBOARD or not commander.armed or commander.killed:
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

    def on_position_target(self, setpoint: PositionControlSetpoint, yaw_rad: float) -> None:
        """A position set-point, flown by PX4's own position controller for as long as OFFBOARD is.

        What SET_POSITION_TARGET_LOCAL_NED asks for; the links of the plant do not take that message yet.
        """
        self._position_target = setpoint, yaw_rad
        self.commander.setpoint_arrived(self.time_us)

    def _fly_to(self, setpoint: PositionControlSetpoint, yaw_rad: float) -> None:
        at = self.estimate()
        self._position_control, thrust = position_control.step(
            _PX4_POSITION_CONTROL,
            self._position_control,
            at.position_ned_m,
            at.velocity_ned_m_s,
            setpoint,
            self.vehicle.hover_thrust,
            1e-6 * CONTROL_DT_US,
        )
        size = math.hypot(*thrust)
        ax, ay, az = (GRAVITY_M_S2 * part / size for part in thrust)
        self.setpoint = AttitudeThrust(attitude_from_acceleration(ax, ay, az + GRAVITY_M_S2, yaw_rad), min(size, 1.0))

    def follow_mode(self, takeoff_altitude_m: float | None = None) -> None:
        """Let the navigator begin what the commander has decided. `takeoff_altitude_m`: above home."""
        mode = self.commander.mode
        if mode is not self._flying_mode:
            self._flying_mode = mode
            self.navigator.enter(mode, self.estimate(), self.home, self.time_us, takeoff_altitude_m)

    def _notify(self, severity: Severity, text: str) -> None:
        self.notices.append(Notice(severity, text))
