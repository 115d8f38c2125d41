"""PX4 as a companion computer meets it, without sockets and without a wall clock.

`Autopilot` steps a vehicle through simulated time and answers set-points and commands as PX4 does: `commander`
decides which mode flies, `navigator` flies it, `commands` acts on both. What PX4 does that surprises is written where
it is done.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Final, NamedTuple

from sitl.autopilot import offboard
from sitl.autopilot.attitude_gains import AttitudeGains
from sitl.autopilot.attitude_reference import AttitudeReference
from sitl.autopilot.commander import Commander
from sitl.autopilot.land_detector import LandDetector
from sitl.autopilot.modes import STICK_MODES, FlightMode, Severity
from sitl.autopilot.navigator import Home, Navigator
from sitl.autopilot.offboard import PositionFlight
from sitl.autopilot.parameters import Parameters, Px4Version
from sitl.autopilot.position_control import PositionControlSetpoint
from sitl.autopilot.position_hold import AttitudeThrust, attitude_from_acceleration, yaw_of
from sitl.autopilot.request_faults import RequestFaults
from sitl.vehicles.rotation import Quaternion, turned
from sitl.vehicles.vehicle import Quadrotor, Vehicle, VehicleState
from sitl.world.estimator_status import NOMINAL

PHYSICS_DT_US: Final = 1_000
CONTROL_DT_US: Final = 10_000
RESETS_AT_START: Final = 11  # of EKF2, each time it has found itself on the ground
RESET_CLIMB_M: Final = 1.5  # and once more so far above home
COMPANION_LOST_US: Final = 6_500_000  # COM_OBC_LOSS_T after its heartbeats are missed


class Notice(NamedTuple):
    """One STATUSTEXT."""

    severity: Severity
    text: str


class Autopilot:
    """One autopilot with its vehicle.

    Attributes:
        time_us: simulated time since boot; moves in steps of the physics.
        setpoint: attitude and thrust that are flown now; in v1.18 the attitude loop follows a reference model of it. An
            attitude that is no number leaves the rotation uncontrolled.
        told: the last attitude and thrust that OFFBOARD was told, as they were sent; for ATTITUDE_TARGET.
        commander: arming and modes.
        home: where it was armed last.
        like_px4: whether ODOMETRY and CURRENT_MODE come when PX4 sends them, and resets are counted as EKF2 does.
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

    def __init__(self, vehicle: Vehicle, parameters: Parameters | None = None, *, like_px4: bool = False) -> None:
        self.vehicle = vehicle
        self.like_px4 = like_px4
        self.parameters = parameters or Parameters({"MPC_THR_HOVER": vehicle.hover_thrust})
        self.time_us = 0
        self.reset_counter = RESETS_AT_START if like_px4 else 0
        self._counts_climb = like_px4
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
        v1_17 = self.parameters.version is Px4Version.V1_17
        self._reference = None if v1_17 else AttitudeReference(self.parameters)
        self.told: AttitudeThrust | None = None
        self._position_flight = PositionFlight()
        self._next_control_us = 0
        self._flying_mode = self.commander.mode
        self._land_detector = LandDetector(self.parameters, vehicle.hover_thrust)
        self._gains = AttitudeGains(self.parameters)
        self._companion_heard_us: int | None = None

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
        self._gains.follow(self.parameters, vehicle)
        self._look_for_companion()
        if self._counts_climb and self.home.position_ned_m[2] - vehicle.state.position_ned_m[2] > RESET_CLIMB_M:
            self._counts_climb = False
            self.reset_counter += 1
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
            if self._position_flight.target is not None:
                self.setpoint = self._position_flight.step(self.estimate(), vehicle.hover_thrust, 1e-6 * CONTROL_DT_US)
            return
        self._position_flight.rest()
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
            landed=commander.landed,
            armed_at_us=commander.armed_at_us,
        )

    def _look_for_companion(self) -> None:
        heard_us = self._companion_heard_us
        if heard_us is not None and self.time_us - heard_us >= COMPANION_LOST_US:
            self._companion_heard_us = None
            self._notify(Severity.CRITICAL, "Connection to mission computer lost")

    def _detect_landing(self) -> None:
        commander = self.commander
        if not self.vehicle.can_fly:  # a rig counts as flying while its motors carry it
            commander.landed = not commander.armed or commander.mode is FlightMode.LAND
            return
        was_landed = commander.landed
        commander.landed = self._land_detector.step(
            self.time_us,
            self.setpoint.thrust,
            armed=commander.armed,
            by_attitude=commander.mode is FlightMode.OFFBOARD and self._position_flight.target is None,
            on_ground=self.vehicle.on_ground(),
        )
        if commander.armed and commander.landed is not was_landed:
            self._notify(Severity.INFO, "Landing detected" if commander.landed else "Takeoff detected")

    def start_in_air(self, altitude_m: float, settle_s: float = 0.0) -> None:
        """Begin in Hold, armed, at an altitude over the ground, so that a flight need not begin with a take-off.

        `settle_s`: for how long Hold has flown already, which settles its integrals. A rig starts where it stands.
        """
        now_us, self.time_us = self.time_us, self.time_us - round(1e6 * settle_s)
        self._next_control_us = self.time_us
        self.commander.start_in_air(self.time_us)
        self._land_detector.landed = False
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
    def next_control_us(self) -> int:
        """When the autopilot's turn comes next."""
        return self._next_control_us

    @property
    def told_us(self) -> int:
        """What its own clock says the time is, as ODOMETRY and TIMESYNC tell it."""
        return self.time_us if self.stamp_us is None else self.stamp_us(self.time_us)

    # --- what it tells ----------------------------------------------------------------------------------------------

    def truth(self) -> VehicleState:
        """The vehicle's true state, which it does not know."""
        return self.vehicle.state

    # --- what it is told --------------------------------------------------------------------------------------------

    def on_companion_heartbeat(self) -> None:
        """A heartbeat of MAV_TYPE_ONBOARD_CONTROLLER has come."""
        self._companion_heard_us = self.time_us

    @property
    def attitude_target(self) -> AttitudeThrust:
        """What ATTITUDE_TARGET tells: what OFFBOARD was told, unchanged; in other modes what is flown."""
        flown_as_told = self.commander.mode is FlightMode.OFFBOARD and self._position_flight.target is None
        return self.told if flown_as_told and self.told is not None else self.setpoint

    def on_attitude_target(
        self, q_wxyz: Quaternion, thrust: float, type_mask: int = 0x07, yaw_rate_rad_s: float = 0.0
    ) -> None:
        """SET_ATTITUDE_TARGET, executed on arrival: PX4 neither validates it nor looks at its time stamp.

        Body rates alone keep OFFBOARD alive; the plant does not fly them.
        """
        if self.on_setpoint is not None:
            self.on_setpoint(q_wxyz, thrust, type_mask)
        if not offboard.is_signal(type_mask, self.parameters.version):
            return
        self._position_flight.target = None
        self._stream_arrived()
        commander = self.commander
        flown = commander.mode is FlightMode.OFFBOARD and commander.armed and not commander.killed
        if flown and offboard.has_attitude(type_mask):
            yaw_gain_1_s = self.parameters.number("MC_YAW_P")
            self.told = offboard.told(q_wxyz, thrust, type_mask)
            self.setpoint = offboard.by_attitude(q_wxyz, thrust, type_mask, yaw_rate_rad_s, yaw_gain_1_s)

    def on_position_target(self, setpoint: PositionControlSetpoint, yaw_rad: float | None) -> None:
        """A position set-point, flown by PX4's own position controller for as long as OFFBOARD is.

        `yaw_rad`: `None` keeps the heading.
        """
        target = self._position_flight.target
        if yaw_rad is None:
            yaw_rad = yaw_of(self.estimate().q_wxyz) if target is None else target[1]
        self._position_flight.target = setpoint, yaw_rad
        self._stream_arrived()

    def _stream_arrived(self) -> None:
        commander = self.commander
        commander.setpoint_arrived(self.time_us)
        if commander.user_mode is FlightMode.OFFBOARD and commander.mode is not FlightMode.OFFBOARD:
            commander.update(self.time_us)  # the stream is back: OFFBOARD again, from whatever the failsafe flew

    def follow_mode(self, takeoff_altitude_m: float | None = None) -> None:
        """Let the navigator begin what the commander has decided. `takeoff_altitude_m`: above home."""
        mode = self.commander.mode
        if mode is not self._flying_mode:
            self._flying_mode = mode
            self.navigator.enter(mode, self.estimate(), self.home, self.time_us, takeoff_altitude_m)

    def _notify(self, severity: Severity, text: str) -> None:
        self.notices.append(Notice(severity, text))
