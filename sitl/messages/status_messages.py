"""The messages of the plant that go out rarely, as PX4 fills them (`mavlink/streams/*.hpp`), by pymavlink."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final

from pymavlink.dialects.v20 import development as mavlink

from companion.control import attitude
from sitl.autopilot.autopilot import Autopilot
from sitl.autopilot.geodesy import ORIGIN, to_global
from sitl.autopilot.modes import custom_mode
from sitl.autopilot.status import base_mode, landed_state, system_status

Build = Callable[[int], bytes]

NAN: Final = math.nan
_LARGEST_FLOAT32: Final = 3.4028234e38
_PRESENT: Final = (
    mavlink.MAV_SYS_STATUS_SENSOR_3D_GYRO
    | mavlink.MAV_SYS_STATUS_SENSOR_3D_ACCEL
    | mavlink.MAV_SYS_STATUS_SENSOR_3D_MAG
    | mavlink.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE
    | mavlink.MAV_SYS_STATUS_SENSOR_GPS
    | mavlink.MAV_SYS_STATUS_SENSOR_XY_POSITION_CONTROL
    | mavlink.MAV_SYS_STATUS_LOGGING
    | mavlink.MAV_SYS_STATUS_SENSOR_BATTERY
)
_HEALTHY: Final = (
    _PRESENT
    | mavlink.MAV_SYS_STATUS_SENSOR_DIFFERENTIAL_PRESSURE
    | mavlink.MAV_SYS_STATUS_SENSOR_ATTITUDE_STABILIZATION
    | mavlink.MAV_SYS_STATUS_SENSOR_MOTOR_OUTPUTS
    | mavlink.MAV_SYS_STATUS_AHRS
)
_RELEASE: Final = 255  # FIRMWARE_VERSION_TYPE
_CAPABILITIES: Final = (
    mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_INT
    | mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_FLOAT
    | mavlink.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
    | mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE
    | mavlink.MAV_PROTOCOL_CAPABILITY_SET_ATTITUDE_TARGET
    | mavlink.MAV_PROTOCOL_CAPABILITY_FLIGHT_TERMINATION
    | mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2
)
_BATTERY_V: Final = 16.2


class StatusMessages:
    """Builders of the seldom messages.

    Args: `autopilot` is what is told of; `system_id` and `component_id` are who tells; `unix_epoch_us` is the wall time
    at simulated time zero, for SYSTEM_TIME.
    Attributes: `builders` by message id; each takes the sequence number and returns the frame.
    """

    def __init__(self, autopilot: Autopilot, system_id: int, component_id: int, unix_epoch_us: int) -> None:
        self._autopilot = autopilot
        self._epoch_us = unix_epoch_us
        self._mav = mavlink.MAVLink(None, srcSystem=system_id, srcComponent=component_id)
        self.builders: dict[int, Build] = {
            mavlink.MAVLINK_MSG_ID_HEARTBEAT: self.heartbeat,
            mavlink.MAVLINK_MSG_ID_SYS_STATUS: self.sys_status,
            mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: self.system_time,
            mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: self.gps_raw_int,
            mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: self.gps_global_origin,
            mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: self.battery_status,
            mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION: self.autopilot_version,
            mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: self.estimator_status,
            mavlink.MAVLINK_MSG_ID_HOME_POSITION: self.home_position,
            mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: self.extended_sys_state,
        }

    def pack(self, message: Any, sequence: int) -> bytes:
        """A pymavlink message as one frame of this autopilot."""
        self._mav.seq = sequence
        return bytes(message.pack(self._mav))

    def heartbeat(self, sequence: int) -> bytes:
        autopilot = self._autopilot
        message = mavlink.MAVLink_heartbeat_message(
            type=mavlink.MAV_TYPE_QUADROTOR,
            autopilot=mavlink.MAV_AUTOPILOT_PX4,
            base_mode=base_mode(autopilot),
            custom_mode=custom_mode(autopilot.commander.mode),
            system_status=system_status(autopilot),
            mavlink_version=3,
        )
        return self.pack(message, sequence)

    def sys_status(self, sequence: int) -> bytes:
        commander = self._autopilot.commander
        healthy = _HEALTHY
        if commander.can_arm(self._now_us):
            healthy |= mavlink.MAV_SYS_STATUS_PREARM_CHECK
        if not commander.position_valid:
            healthy &= ~(mavlink.MAV_SYS_STATUS_SENSOR_GPS | mavlink.MAV_SYS_STATUS_SENSOR_XY_POSITION_CONTROL)
        enabled = _PRESENT
        if commander.manual_control:
            healthy |= mavlink.MAV_SYS_STATUS_SENSOR_RC_RECEIVER
        else:
            enabled |= mavlink.MAV_SYS_STATUS_SENSOR_RC_RECEIVER
        message = mavlink.MAVLink_sys_status_message(
            onboard_control_sensors_present=_PRESENT,
            onboard_control_sensors_enabled=enabled,
            onboard_control_sensors_health=healthy,
            load=100,
            voltage_battery=int(1e3 * _BATTERY_V),
            current_battery=-1,
            battery_remaining=100,
            drop_rate_comm=0,
            errors_comm=0,
            errors_count1=0,
            errors_count2=0,
            errors_count3=0,
            errors_count4=0,
            onboard_control_sensors_health_extended=1,
        )
        return self.pack(message, sequence)

    def system_time(self, sequence: int) -> bytes:
        message = mavlink.MAVLink_system_time_message(
            time_unix_usec=self._epoch_us + self._now_us, time_boot_ms=self._now_ms
        )
        return self.pack(message, sequence)

    def gps_raw_int(self, sequence: int) -> bytes:
        position, velocity, *_ = self._autopilot.estimate()
        place = to_global(position)
        speed = math.hypot(velocity[0], velocity[1])
        altitude = whole(1e3 * place.altitude_m, 31)
        message = mavlink.MAVLink_gps_raw_int_message(
            time_usec=self._now_us,
            fix_type=mavlink.GPS_FIX_TYPE_3D_FIX,
            lat=whole(1e7 * place.latitude_deg, 31),
            lon=whole(1e7 * place.longitude_deg, 31),
            alt=altitude,
            eph=70,
            epv=110,
            vel=whole(100.0 * speed, 15),
            cog=whole(100.0 * (math.degrees(math.atan2(velocity[1], velocity[0])) % 360.0), 31) % 36000,
            satellites_visible=10,
            alt_ellipsoid=altitude,
            h_acc=900,
            v_acc=1780,
            vel_acc=400,
            hdg_acc=0,
            yaw=0,
        )
        return self.pack(message, sequence)

    def gps_global_origin(self, sequence: int) -> bytes:
        message = mavlink.MAVLink_gps_global_origin_message(
            latitude=round(1e7 * ORIGIN.latitude_deg),
            longitude=round(1e7 * ORIGIN.longitude_deg),
            altitude=round(1e3 * ORIGIN.altitude_m),
            time_usec=0,
        )
        return self.pack(message, sequence)

    def home_position(self, sequence: int) -> bytes:
        home = self._autopilot.home
        place = to_global(home.position_ned_m)
        message = mavlink.MAVLink_home_position_message(
            latitude=whole(1e7 * place.latitude_deg, 31),
            longitude=whole(1e7 * place.longitude_deg, 31),
            altitude=whole(1e3 * place.altitude_m, 31),
            x=real(home.position_ned_m[0]),
            y=real(home.position_ned_m[1]),
            z=real(home.position_ned_m[2]),
            q=list(home.q_wxyz),
            approach_x=0.0,
            approach_y=0.0,
            approach_z=0.0,
            time_usec=home.time_us,
        )
        return self.pack(message, sequence)

    def battery_status(self, sequence: int) -> bytes:
        message = mavlink.MAVLink_battery_status_message(
            id=0,
            battery_function=mavlink.MAV_BATTERY_FUNCTION_ALL,
            type=mavlink.MAV_BATTERY_TYPE_LIPO,
            temperature=32767,
            voltages=[int(1e3 * _BATTERY_V)] + [65535] * 9,
            current_battery=-1,
            current_consumed=-1,
            energy_consumed=-1,
            battery_remaining=100,
            time_remaining=0,
            charge_state=mavlink.MAV_BATTERY_CHARGE_STATE_OK,
        )
        return self.pack(message, sequence)

    def estimator_status(self, sequence: int) -> bytes:
        health = self._autopilot.health
        message = mavlink.MAVLink_estimator_status_message(
            time_usec=self._now_us,
            flags=health.flags,
            vel_ratio=0.03,
            pos_horiz_ratio=0.05,
            pos_vert_ratio=0.01,
            mag_ratio=0.1,
            hagl_ratio=0.004,
            tas_ratio=NAN,
            pos_horiz_accuracy=math.sqrt(2.0 * health.horizontal_m2),
            pos_vert_accuracy=math.sqrt(health.vertical_m2),
        )
        return self.pack(message, sequence)

    def extended_sys_state(self, sequence: int) -> bytes:
        message = mavlink.MAVLink_extended_sys_state_message(
            vtol_state=mavlink.MAV_VTOL_STATE_UNDEFINED, landed_state=int(landed_state(self._autopilot))
        )
        return self.pack(message, sequence)

    def autopilot_version(self, sequence: int) -> bytes:
        major, minor = map(int, self._autopilot.parameters.version.split("."))
        version = major << 24 | minor << 16 | _RELEASE
        message = mavlink.MAVLink_autopilot_version_message(
            capabilities=_CAPABILITIES,
            flight_sw_version=version,
            middleware_sw_version=version,
            os_sw_version=0,
            board_version=0,
            flight_custom_version=[0] * 8,
            middleware_custom_version=[0] * 8,
            os_custom_version=[0] * 8,
            vendor_id=0,
            product_id=0,
            uid=self._mav.srcSystem,
            uid2=[self._mav.srcSystem] + [0] * 17,
        )
        return self.pack(message, sequence)

    @property
    def _now_us(self) -> int:
        return self._autopilot.time_us

    @property
    def _now_ms(self) -> int:
        return self._autopilot.time_us // 1000 & 0xFFFFFFFF


def heading_deg(q_wxyz: tuple[float, float, float, float]) -> float:
    """Compass heading of an attitude, 0 to 360 degrees."""
    return math.degrees(attitude.yaw(*q_wxyz)) % 360.0


def whole(value: float, bits: int) -> int:
    """A value rounded into a signed field of `bits` plus sign; what is no number is the largest."""
    limit = (1 << bits) - 1
    return round(min(max(value, -limit), limit)) if not math.isnan(value) else limit


def real(value: float) -> float:
    """A value that fits float32, as a vehicle that has diverged may not."""
    return value if math.isnan(value) else min(max(value, -_LARGEST_FLOAT32), _LARGEST_FLOAT32)
