"""What the autopilot says: one builder a message, values as PX4 v1.17 fills them (`mavlink/streams/*.hpp`).

Here stand the messages that go out often, written by the fast encoder; the others are in `status_messages`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final

from pymavlink.dialects.v20 import development as mavlink

from companion.mavlink.codec import Encoder, Layout
from sitl.autopilot.autopilot import Autopilot
from sitl.autopilot.geodesy import to_global
from sitl.autopilot.modes import custom_mode, standard_mode
from sitl.messages.px4_timing import MODE_INTERVAL_US
from sitl.messages.status_messages import Build, StatusMessages, heading_deg, real, whole
from sitl.vehicles.rotation import euler
from sitl.world.estimator_status import Health

NAN: Final = math.nan

_QUATERNION_VARIANCES: Final = (4e-4, 4e-4, 0.038)


def covariances(health: Health) -> list[float]:
    """ODOMETRY's two row-major upper triangles, pose and velocity: the diagonal, the rest unknown."""
    pose, velocity = [NAN] * 21, [NAN] * 21
    across, down = health.horizontal_m2, health.vertical_m2
    for place, variance in zip((0, 6, 11, 15, 18, 20), (across, across, down, *_QUATERNION_VARIANCES), strict=True):
        pose[place] = variance
    across, down = health.horizontal_velocity_m2_s2, health.vertical_velocity_m2_s2
    for place, variance in zip((0, 6, 11), (across, across, down), strict=True):
        velocity[place] = variance
    return pose + velocity


class Telemetry:
    """Builders of every message the plant sends by itself.

    Args: `autopilot` is what is told of; `system_id` and `component_id` are who tells; `unix_epoch_us` is the wall time
    at simulated time zero, for SYSTEM_TIME.
    Attributes: `builders` by message id; each takes the sequence number and returns the frame. `pack` frames a
    pymavlink message. `like_px4` of the autopilot.
    """

    def __init__(self, autopilot: Autopilot, system_id: int, component_id: int, unix_epoch_us: int) -> None:
        self._autopilot = autopilot
        self.like_px4 = autopilot.like_px4
        status = StatusMessages(autopilot, system_id, component_id, unix_epoch_us)
        self.pack: Callable[[Any, int], bytes] = status.pack

        def hot(name: str) -> Callable[..., bytes]:
            return _finite(Encoder(Layout(name), system_id, component_id).encode)

        self._odometry = hot("ODOMETRY")
        self._attitude_quaternion = hot("ATTITUDE_QUATERNION")
        self._attitude = hot("ATTITUDE")
        self._local_position = hot("LOCAL_POSITION_NED")
        self._global_position = hot("GLOBAL_POSITION_INT")
        self._highres_imu = hot("HIGHRES_IMU")
        self._attitude_target = hot("ATTITUDE_TARGET")
        self._timesync = hot("TIMESYNC")
        self._current_mode = hot("CURRENT_MODE")
        self._altitude = hot("ALTITUDE")
        self._vfr_hud = hot("VFR_HUD")
        self._health = autopilot.health
        self._odometry_tail = (*covariances(self._health), 1, 1)
        self.builders: dict[int, Build] = {
            **status.builders,
            mavlink.MAVLINK_MSG_ID_ATTITUDE: self.attitude,
            mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: self.attitude_quaternion,
            mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: self.local_position_ned,
            mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: self.global_position_int,
            mavlink.MAVLINK_MSG_ID_ATTITUDE_TARGET: self.attitude_target,
            mavlink.MAVLINK_MSG_ID_HIGHRES_IMU: self.highres_imu,
            mavlink.MAVLINK_MSG_ID_TIMESYNC: self.timesync,
            mavlink.MAVLINK_MSG_ID_CURRENT_MODE: self.current_mode,
            mavlink.MAVLINK_MSG_ID_ALTITUDE: self.altitude,
            mavlink.MAVLINK_MSG_ID_VFR_HUD: self.vfr_hud,
            mavlink.MAVLINK_MSG_ID_ODOMETRY: self.odometry,
        }

    def odometry(self, sequence: int) -> bytes:
        return self.odometry_of(sequence, self.odometry_sample())

    def odometry_sample(self) -> tuple[float, ...]:
        """The values of an ODOMETRY of now."""
        autopilot = self._autopilot
        position, velocity, q_wxyz, rates, _ = autopilot.estimate()
        if autopilot.health is not self._health:
            self._health = autopilot.health
            self._odometry_tail = (*covariances(self._health), 1, 1)
        return (
            autopilot.told_us,
            *position,
            *q_wxyz,
            *velocity,
            *rates,
            *self._odometry_tail,
            autopilot.reset_counter,
            mavlink.MAV_ESTIMATOR_TYPE_AUTOPILOT,
            self._health.quality,
        )

    def odometry_of(self, sequence: int, sample: tuple[float, ...]) -> bytes:
        """The frame of a sample."""
        return self._odometry(sequence, *sample)

    def attitude_quaternion(self, sequence: int) -> bytes:
        _, _, q_wxyz, rates, _ = self._autopilot.estimate()
        return self._attitude_quaternion(sequence, self._now_ms, *q_wxyz, *rates, 0.0, 0.0, 0.0, 0.0)

    def attitude(self, sequence: int) -> bytes:
        _, _, q_wxyz, rates, _ = self._autopilot.estimate()
        return self._attitude(sequence, self._now_ms, *euler(*q_wxyz), *rates)

    def local_position_ned(self, sequence: int) -> bytes:
        position, velocity, *_ = self._autopilot.estimate()
        return self._local_position(sequence, self._now_ms, *position, *velocity)

    def global_position_int(self, sequence: int) -> bytes:
        position, velocity, q_wxyz, *_ = self._autopilot.estimate()
        place = to_global(position)
        return self._global_position(
            sequence,
            self._now_ms,
            whole(1e7 * place.latitude_deg, 31),
            whole(1e7 * place.longitude_deg, 31),
            whole(1e3 * place.altitude_m, 31),
            whole(1e3 * (self._autopilot.home.position_ned_m[2] - position[2]), 31),
            *(whole(100.0 * v, 15) for v in velocity),
            whole(100.0 * heading_deg(q_wxyz), 31) % 36000,
        )

    def highres_imu(self, sequence: int) -> bytes:
        position, _, _, rates, force = self._autopilot.estimate()
        altitude = to_global(position).altitude_m
        pressure = 1013.25 * max(1.0 - 2.25577e-5 * altitude, 0.0) ** 5.25588  # hPa, standard atmosphere
        return self._highres_imu(
            sequence, self._now_us, *force, *rates, 0.21, 0.0, 0.43, pressure, 0.0, altitude, 15.0, 63, 0
        )

    def attitude_target(self, sequence: int) -> bytes:
        q_wxyz, thrust = self._autopilot.attitude_target
        return self._attitude_target(sequence, self._now_ms, *q_wxyz, 0.0, 0.0, 0.0, thrust, 0)

    def modes(self) -> tuple[int, int]:
        """What CURRENT_MODE tells: the mode that flies and the one intended."""
        commander = self._autopilot.commander
        return commander.mode, commander.user_mode

    def news(self, message_id: int) -> object:
        """What a message has to tell that is told only once: another value when there is something new.

        `None` for a message that always has something new.
        """
        if message_id == mavlink.MAVLINK_MSG_ID_HOME_POSITION:
            return self._autopilot.home
        if message_id == mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN:
            return message_id
        if message_id == mavlink.MAVLINK_MSG_ID_CURRENT_MODE:  # PX4 publishes its status twice a second
            return (*self.modes(), self._now_us // MODE_INTERVAL_US)
        return None

    def current_mode(self, sequence: int) -> bytes:
        commander = self._autopilot.commander
        mode = commander.mode
        return self._current_mode(sequence, custom_mode(mode), custom_mode(commander.user_mode), standard_mode(mode))

    def altitude(self, sequence: int) -> bytes:
        position, *_ = self._autopilot.estimate()
        above_sea_m = to_global(position).altitude_m
        above_home_m = self._autopilot.home.position_ned_m[2] - position[2]
        return self._altitude(sequence, self._now_us, above_sea_m, above_sea_m, -position[2], above_home_m, NAN, NAN)

    def vfr_hud(self, sequence: int) -> bytes:
        position, velocity, q_wxyz, *_ = self._autopilot.estimate()
        return self._vfr_hud(
            sequence,
            NAN,
            math.hypot(velocity[0], velocity[1]),
            to_global(position).altitude_m,
            -velocity[2],
            whole(heading_deg(q_wxyz), 15) % 360,
            whole(100.0 * self._autopilot.setpoint.thrust, 15),
        )

    def timesync(self, sequence: int) -> bytes:
        return self._timesync(sequence, 0, 1000 * self._autopilot.told_us)

    def timesync_reply(self, sequence: int, their_time_ns: int) -> bytes:
        """The answer to a TIMESYNC request that carried `their_time_ns`."""
        return self._timesync(sequence, 1000 * self._autopilot.told_us, their_time_ns)

    @property
    def _now_us(self) -> int:
        return self._autopilot.time_us

    @property
    def _now_ms(self) -> int:
        return self._autopilot.time_us // 1000 & 0xFFFFFFFF


def _finite(encode: Callable[..., bytes]) -> Callable[..., bytes]:
    def safe(sequence: int, *values: float) -> bytes:
        try:
            return encode(sequence, *values)
        except OverflowError:
            return encode(sequence, *(real(v) if isinstance(v, float) else v for v in values))

    return safe
