"""The autopilot's own position controller: it flies Hold, Take-off, Land and Return.

Position error to velocity, velocity error with an integral to acceleration, acceleration to attitude and thrust. The
structure is PX4's (`mc_pos_control`), the gains are lower, so that it stays stable on attitude loops as slow as a first
order of 3 rad/s, where PX4's own gains would not be.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from companion.control import attitude
from companion.control.types import GRAVITY_M_S2
from sitl.vehicles.rotation import Quaternion
from sitl.vehicles.vehicle import VehicleState

POSITION_GAIN_PER_S: Final = 0.45
VELOCITY_GAIN_PER_S: Final = 1.3
INTEGRAL_GAIN_PER_S2: Final = 0.15
VERTICAL_POSITION_GAIN_PER_S: Final = 1.0
VERTICAL_VELOCITY_GAIN_PER_S: Final = 3.0
VERTICAL_INTEGRAL_GAIN_PER_S2: Final = 1.0
HORIZONTAL_ACCELERATION_LIMIT_M_S2: Final = 3.0
VERTICAL_ACCELERATION_LIMIT_M_S2: Final = 4.0
HORIZONTAL_INTEGRAL_LIMIT_M_S2: Final = 1.5
VERTICAL_INTEGRAL_LIMIT_M_S2: Final = 4.0


class AttitudeThrust(NamedTuple):
    """What the attitude loop is told."""

    q_wxyz: Quaternion  # body FRD to NED
    thrust: float  # normalised, 0 to 1


class PositionHold:
    """Position and velocity controller of one vehicle.

    Args: `hover_thrust` normalised thrust that carries the vehicle's weight; `thrust_min`, `thrust_max` its limits in
    flight.
    """

    def __init__(self, hover_thrust: float, thrust_min: float, thrust_max: float) -> None:
        self.hover_thrust = hover_thrust
        self.thrust_min = thrust_min
        self.thrust_max = thrust_max
        self._integral = [0.0, 0.0, 0.0]

    def reset(self) -> None:
        """Forget the integrals; for a vehicle that takes off anew."""
        self._integral = [0.0, 0.0, 0.0]

    def step(
        self,
        state: VehicleState,
        target_ned_m: tuple[float, float, float],
        yaw_rad: float,
        dt_s: float,
        *,
        cruise_m_s: float,
        climb_m_s: float,
        descend_m_s: float,
    ) -> AttitudeThrust:
        """One step towards a target in NED, no faster than the given speeds; `z` may be infinite to keep sinking."""
        x, y, z = state.position_ned_m
        vx, vy, vz = state.velocity_ned_m_s
        vx_sp = POSITION_GAIN_PER_S * (target_ned_m[0] - x)
        vy_sp = POSITION_GAIN_PER_S * (target_ned_m[1] - y)
        speed = math.hypot(vx_sp, vy_sp)
        if speed > cruise_m_s:
            vx_sp *= cruise_m_s / speed
            vy_sp *= cruise_m_s / speed
        ax, ay = self._horizontal(vx_sp - vx, vy_sp - vy, dt_s)
        vz_sp = min(max(VERTICAL_POSITION_GAIN_PER_S * (target_ned_m[2] - z), -climb_m_s), descend_m_s)
        return self._actuate(state, ax, ay, self._vertical(vz_sp - vz, dt_s), yaw_rad)

    def step_on_guide(
        self, state: VehicleState, target_ned_m: tuple[float, float, float], yaw_rad: float, dt_s: float
    ) -> AttitudeThrust:
        """One step of a rig: as `step` in the horizontal, but with hover thrust, since guides carry no altitude."""
        x, y, _ = state.position_ned_m
        vx, vy, _ = state.velocity_ned_m_s
        vx_sp = POSITION_GAIN_PER_S * (target_ned_m[0] - x)
        vy_sp = POSITION_GAIN_PER_S * (target_ned_m[1] - y)
        ax, ay = self._horizontal(vx_sp - vx, vy_sp - vy, dt_s)
        return AttitudeThrust(attitude_from_acceleration(ax, ay, 0.0, yaw_rad), self.hover_thrust)

    def _horizontal(self, error_x_m_s: float, error_y_m_s: float, dt_s: float) -> tuple[float, float]:
        integral = self._integral
        ax = VELOCITY_GAIN_PER_S * error_x_m_s + integral[0]
        ay = VELOCITY_GAIN_PER_S * error_y_m_s + integral[1]
        demand = math.hypot(ax, ay)
        if demand > HORIZONTAL_ACCELERATION_LIMIT_M_S2:
            ax *= HORIZONTAL_ACCELERATION_LIMIT_M_S2 / demand
            ay *= HORIZONTAL_ACCELERATION_LIMIT_M_S2 / demand
        else:  # no wind-up against the limit
            gain = INTEGRAL_GAIN_PER_S2 * dt_s
            integral[0] = _clamp(integral[0] + gain * error_x_m_s, HORIZONTAL_INTEGRAL_LIMIT_M_S2)
            integral[1] = _clamp(integral[1] + gain * error_y_m_s, HORIZONTAL_INTEGRAL_LIMIT_M_S2)
        return ax, ay

    def _vertical(self, error_m_s: float, dt_s: float) -> float:
        integral = self._integral
        az = VERTICAL_VELOCITY_GAIN_PER_S * error_m_s + integral[2]
        if abs(az) > VERTICAL_ACCELERATION_LIMIT_M_S2:
            return math.copysign(VERTICAL_ACCELERATION_LIMIT_M_S2, az)
        gain = VERTICAL_INTEGRAL_GAIN_PER_S2 * dt_s
        integral[2] = _clamp(integral[2] + gain * error_m_s, VERTICAL_INTEGRAL_LIMIT_M_S2)
        return az

    def _actuate(self, state: VehicleState, ax: float, ay: float, az: float, yaw_rad: float) -> AttitudeThrust:
        _, qx, qy, _ = state.q_wxyz
        upright = max(1.0 - 2.0 * (qx * qx + qy * qy), 0.5)  # the present tilt, not the wanted one, costs lift
        thrust = self.hover_thrust * (GRAVITY_M_S2 - az) / (GRAVITY_M_S2 * upright)
        thrust = min(max(thrust, self.thrust_min), self.thrust_max)
        return AttitudeThrust(attitude_from_acceleration(ax, ay, az, yaw_rad), thrust)


def attitude_from_acceleration(ax: float, ay: float, az: float, yaw_rad: float) -> Quaternion:
    """Attitude whose thrust axis gives the NED acceleration (m/s², gravity compensated), turned to a yaw (rad).

    The smallest tilt from upright, in the yawed frame; `az` must stay below gravity.
    """
    cos_yaw, sin_yaw = math.cos(yaw_rad), math.sin(yaw_rad)
    fx = -(cos_yaw * ax + sin_yaw * ay)
    fy = -(-sin_yaw * ax + cos_yaw * ay)
    fz = GRAVITY_M_S2 - az
    norm = math.sqrt(fx * fx + fy * fy + fz * fz)
    zx, zy, zz = fx / norm, fy / norm, fz / norm  # body z (down) in the yawed frame
    w, x, y = 1.0 + zz, -zy, zx
    norm = math.sqrt(w * w + x * x + y * y)
    w, x, y = w / norm, x / norm, y / norm
    c, s = math.cos(0.5 * yaw_rad), math.sin(0.5 * yaw_rad)
    return c * w, c * x - s * y, c * y + s * x, s * w


def yaw_of(q_wxyz: Quaternion) -> float:
    """Yaw of an attitude in rad."""
    return attitude.yaw(*q_wxyz)


def _clamp(value: float, limit: float) -> float:
    return min(max(value, -limit), limit)
