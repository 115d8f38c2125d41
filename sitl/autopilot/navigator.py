"""Where Hold, Take-off, Land and Return fly to (PX4: `navigator/`, `flight_mode_manager/`)."""

from __future__ import annotations

import math
from enum import Enum, auto
from typing import Final, NamedTuple

from sitl.autopilot.modes import FlightMode
from sitl.autopilot.parameters import Parameters
from sitl.autopilot.position_hold import AttitudeThrust, PositionHold, attitude_from_acceleration, yaw_of
from sitl.vehicles.vehicle import VehicleState

Vector = tuple[float, float, float]

RETURN_ACCEPTANCE_M: Final = 0.5


class Home(NamedTuple):
    """Where the vehicle was armed."""

    position_ned_m: Vector
    q_wxyz: tuple[float, float, float, float]
    time_us: int


class _Return(Enum):
    CLIMB = auto()
    TRAVEL = auto()
    DESCEND = auto()
    LAND = auto()


class Navigator:
    """Turns a mode into attitude and thrust.

    Attributes: `takeoff_reached`; `target_ned_m`, `yaw_rad` where it flies to.
    """

    def __init__(self, parameters: Parameters, hover_thrust: float, can_fly: bool) -> None:
        self._parameters = parameters
        self._can_fly = can_fly
        self._hold = PositionHold(hover_thrust, parameters.number("MPC_THR_MIN"), parameters.number("MPC_THR_MAX"))
        self._mode = FlightMode.HOLD
        self._return = _Return.LAND
        self._lift_off_us = 0
        self.takeoff_reached = False
        self.target_ned_m: Vector = (0.0, 0.0, 0.0)
        self.yaw_rad = 0.0

    @property
    def landing(self) -> bool:
        """Whether the vehicle is on its way to the ground."""
        return self._mode is FlightMode.LAND or (self._mode is FlightMode.RTL and self._return is _Return.LAND)

    def enter(
        self, mode: FlightMode, state: VehicleState, home: Home, now_us: int, altitude_m: float | None = None
    ) -> None:
        """A mode starts to fly. `altitude_m`: of a take-off, above the home position; by default MIS_TAKEOFF_ALT."""
        keep_target = mode is FlightMode.HOLD and self._mode is FlightMode.TAKEOFF and self.takeoff_reached
        self._mode = mode
        if keep_target:
            return
        x, y, z = state.position_ned_m
        self.target_ned_m = (x, y, z)
        self.yaw_rad = yaw_of(state.q_wxyz)
        self.takeoff_reached = False
        if mode is FlightMode.TAKEOFF:
            rise = home.position_ned_m[2] - altitude_m if altitude_m is not None else z - self._value("MIS_TAKEOFF_ALT")
            self.target_ned_m = (x, y, min(rise, z))
            self._lift_off_us = now_us
            self._hold.reset()
        elif mode is FlightMode.RTL:
            self._start_return(state, home)

    def go_to(self, target_ned_m: Vector, yaw_rad: float | None) -> None:
        """Move the place that Hold holds."""
        self.target_ned_m = target_ned_m
        if yaw_rad is not None:
            self.yaw_rad = yaw_rad

    def step(
        self,
        state: VehicleState,
        home: Home,
        now_us: int,
        dt_s: float,
        *,
        on_ground: bool,
        landed: bool,
        armed_at_us: int,
    ) -> AttitudeThrust:
        """Attitude and thrust for the next `dt_s`. `on_ground`: the truth; `landed`: what PX4 believes."""
        if not self._can_fly:
            return self._step_rig(state, dt_s)
        if self._mode is FlightMode.TAKEOFF:
            return self._step_takeoff(state, now_us, dt_s, on_ground=on_ground, armed_at_us=armed_at_us)
        if on_ground and (landed or self.landing):  # nothing but a take-off lifts off
            self._hold.reset()
            return AttitudeThrust(attitude_from_acceleration(0.0, 0.0, 0.0, self.yaw_rad), 0.0)
        if self._mode is FlightMode.RTL:
            self._advance_return(state, home)
        return self._fly(state, home, dt_s)

    def _step_rig(self, state: VehicleState, dt_s: float) -> AttitudeThrust:
        if self._mode is FlightMode.LAND:
            return AttitudeThrust(attitude_from_acceleration(0.0, 0.0, 0.0, self.yaw_rad), 0.0)
        return self._hold.step_on_guide(state, self.target_ned_m, self.yaw_rad, dt_s)

    def _step_takeoff(
        self, state: VehicleState, now_us: int, dt_s: float, *, on_ground: bool, armed_at_us: int
    ) -> AttitudeThrust:
        spool_up_end = armed_at_us + int(1e6 * self._value("COM_SPOOLUP_TIME"))
        if on_ground and now_us < spool_up_end:
            self._lift_off_us = now_us
            return AttitudeThrust(attitude_from_acceleration(0.0, 0.0, 0.0, self.yaw_rad), self._value("MPC_THR_MIN"))
        ramp_s = self._value("MPC_TKO_RAMP_T")
        risen = 1.0 if ramp_s <= 0.0 else min(1e-6 * (now_us - self._lift_off_us) / ramp_s, 1.0)
        if state.position_ned_m[2] - self.target_ned_m[2] <= self._value("NAV_MC_ALT_RAD") and not on_ground:
            self.takeoff_reached = True
        return self._hold.step(
            state,
            self.target_ned_m,
            self.yaw_rad,
            dt_s,
            cruise_m_s=self._value("MPC_XY_CRUISE"),
            climb_m_s=risen * self._value("MPC_TKO_SPEED"),
            descend_m_s=self._value("MPC_Z_V_AUTO_DN"),
        )

    def _fly(self, state: VehicleState, home: Home, dt_s: float) -> AttitudeThrust:
        target, descend = self.target_ned_m, self._value("MPC_Z_V_AUTO_DN")
        if self.landing:
            target = (target[0], target[1], math.inf)
            descend = self._landing_speed(home.position_ned_m[2] - state.position_ned_m[2])
        return self._hold.step(
            state,
            target,
            self.yaw_rad,
            dt_s,
            cruise_m_s=self._value("MPC_XY_CRUISE"),
            climb_m_s=self._value("MPC_Z_V_AUTO_UP"),
            descend_m_s=descend,
        )

    def _landing_speed(self, height_m: float) -> float:
        """From MPC_Z_V_AUTO_DN at MPC_LAND_ALT1 down to MPC_LAND_SPEED at MPC_LAND_ALT2."""
        slow, fast = self._value("MPC_LAND_SPEED"), self._value("MPC_Z_V_AUTO_DN")
        high, low = self._value("MPC_LAND_ALT1"), self._value("MPC_LAND_ALT2")
        share = min(max((height_m - low) / max(high - low, 1e-3), 0.0), 1.0)
        return slow + share * (fast - slow)

    def _start_return(self, state: VehicleState, home: Home) -> None:
        x, y, z = state.position_ned_m
        hx, hy, hz = home.position_ned_m
        if math.hypot(x - hx, y - hy) <= self._value("RTL_MIN_DIST"):
            self._return = _Return.LAND
            self.target_ned_m = (hx, hy, z)
        else:
            self._return = _Return.CLIMB
            self.target_ned_m = (x, y, min(z, hz - self._value("RTL_RETURN_ALT")))

    def _advance_return(self, state: VehicleState, home: Home) -> None:
        x, y, z = state.position_ned_m
        hx, hy, hz = home.position_ned_m
        tx, ty, tz = self.target_ned_m
        if self._return is _Return.CLIMB and z - tz < RETURN_ACCEPTANCE_M:
            self._return, self.target_ned_m = _Return.TRAVEL, (hx, hy, tz)
        elif self._return is _Return.TRAVEL and math.hypot(x - tx, y - ty) < RETURN_ACCEPTANCE_M:
            self._return = _Return.DESCEND
            self.target_ned_m = (hx, hy, max(tz, hz - self._value("RTL_DESCEND_ALT")))
        elif self._return is _Return.DESCEND and abs(z - tz) < RETURN_ACCEPTANCE_M:
            self._return = _Return.LAND

    def _value(self, name: str) -> float:
        return self._parameters.number(name)
