"""What OFFBOARD makes of a set-point: by attitude as it comes, by position through PX4's own position controller."""

from __future__ import annotations

import math
from typing import Final

from companion.control.types import GRAVITY_M_S2
from sitl.autopilot import position_control
from sitl.autopilot.parameters import Px4Version
from sitl.autopilot.position_control import PositionControlParams, PositionControlSetpoint, PositionControlState
from sitl.autopilot.position_hold import AttitudeThrust, attitude_from_acceleration
from sitl.vehicles.rotation import UNCONTROLLED, Quaternion, turned
from sitl.vehicles.vehicle import VehicleState

ATTITUDE_IGNORE: Final = 0x80  # ATTITUDE_TARGET_TYPEMASK
THROTTLE_IGNORE: Final = 0x40
THRUST_BODY_SET: Final = 0x20
YAW_RATE_IGNORE: Final = 0x04
ROLL_OR_PITCH_RATE_IGNORE: Final = 0x03

_PX4_POSITION_CONTROL: Final = PositionControlParams()


def has_attitude(type_mask: int) -> bool:
    """Whether a SET_ATTITUDE_TARGET holds an attitude to fly."""
    return not type_mask & ATTITUDE_IGNORE


def is_signal(type_mask: int, version: Px4Version) -> bool:
    """Whether a SET_ATTITUDE_TARGET keeps OFFBOARD alive: it has an attitude or body rates, and in v1.18 a thrust."""
    no_thrust = bool(type_mask & THROTTLE_IGNORE) and not type_mask & THRUST_BODY_SET
    if no_thrust and version is not Px4Version.V1_17:
        return False
    return has_attitude(type_mask) or not type_mask & ROLL_OR_PITCH_RATE_IGNORE


def told(q_wxyz: Quaternion, thrust: float, type_mask: int) -> AttitudeThrust:
    """What ATTITUDE_TARGET tells of a set-point: the attitude as it was sent, and the length of the thrust vector."""
    return AttitudeThrust(q_wxyz, 0.0 if type_mask & (THROTTLE_IGNORE | THRUST_BODY_SET) else abs(thrust))


def by_attitude(
    q_wxyz: Quaternion, thrust: float, type_mask: int, yaw_rate_rad_s: float, yaw_gain_1_s: float
) -> AttitudeThrust:
    """What is flown of a set-point: PX4 validates none.

    A throttle-ignore bit means zero thrust, and so does a thrust that is negative or no finite number. With an attitude
    that is zero or no number the thrust stays and nothing controls the rotation. The yaw rate is fed forward past
    the yaw gain, which makes it an offset.
    """
    if type_mask & (THROTTLE_IGNORE | THRUST_BODY_SET) or not 0.0 < thrust < math.inf:
        thrust = 0.0
    thrust = min(thrust, 1.0)  # what motors can do
    w, x, y, z = q_wxyz
    norm = math.sqrt(w * w + x * x + y * y + z * z)
    if not 0.0 < norm < math.inf:
        return AttitudeThrust(UNCONTROLLED, thrust)
    attitude = (w / norm, x / norm, y / norm, z / norm)
    if yaw_rate_rad_s and not type_mask & YAW_RATE_IGNORE and math.isfinite(yaw_rate_rad_s):
        attitude = turned(attitude, yaw_rate_rad_s / yaw_gain_1_s)
    return AttitudeThrust(attitude, thrust)


class PositionFlight:
    """Flies the last position set-point, for as long as it is the last. Attribute: `target`, None for none."""

    def __init__(self) -> None:
        self.target: tuple[PositionControlSetpoint, float] | None = None  # with its yaw, rad
        self._state = PositionControlState()

    def rest(self) -> None:
        """Another mode flies: the integrals begin anew."""
        self._state = PositionControlState()

    def step(self, at: VehicleState, hover_thrust: float, dt_s: float) -> AttitudeThrust:
        """One step towards the target, which there must be."""
        assert self.target is not None
        setpoint, yaw_rad = self.target
        self._state, thrust = position_control.step(
            _PX4_POSITION_CONTROL,
            self._state,
            at.position_ned_m,
            at.velocity_ned_m_s,
            setpoint,
            hover_thrust,
            dt_s,
        )
        size = math.hypot(*thrust)
        ax, ay, az = (GRAVITY_M_S2 * part / size for part in thrust)
        return AttitudeThrust(attitude_from_acceleration(ax, ay, az + GRAVITY_M_S2, yaw_rad), min(size, 1.0))
