"""Which message is due when on one link, as PX4's stream scheduler does it (`mavlink/mavlink_main.cpp`).

Each link has its own intervals and its own sequence numbers. Default rates are those of PX4 v1.17's onboard and normal
modes, for the messages that the plant has.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from enum import Enum
from typing import Final

from pymavlink.dialects.v20 import development as mavlink

from sitl.messages.px4_timing import MODE_LOOK_US, ModeReports, SampledOdometry
from sitl.messages.status_messages import Build
from sitl.messages.telemetry import Telemetry

NEVER_US: Final = 1 << 62
HEARTBEAT_INTERVAL_US: Final = 1_000_000
MAX_INTERVAL_US: Final = 1 << 31

_ODOMETRY: Final = mavlink.MAVLINK_MSG_ID_ODOMETRY
_HEARTBEAT: Final = mavlink.MAVLINK_MSG_ID_HEARTBEAT
_CURRENT_MODE: Final = mavlink.MAVLINK_MSG_ID_CURRENT_MODE

_ONBOARD_HZ: Final[Mapping[int, float]] = {
    mavlink.MAVLINK_MSG_ID_TIMESYNC: 10.0,
    mavlink.MAVLINK_MSG_ID_HIGHRES_IMU: 50.0,
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 30.0,
    mavlink.MAVLINK_MSG_ID_ATTITUDE: 100.0,
    mavlink.MAVLINK_MSG_ID_ALTITUDE: 10.0,
    mavlink.MAVLINK_MSG_ID_ODOMETRY: 30.0,
    mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: 50.0,
    mavlink.MAVLINK_MSG_ID_ATTITUDE_TARGET: 10.0,
    mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: 0.5,
    mavlink.MAVLINK_MSG_ID_CURRENT_MODE: 0.5,
    mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: 1.0,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 5.0,
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 50.0,
    mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: 1.0,
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: 8.0,
    mavlink.MAVLINK_MSG_ID_HOME_POSITION: 0.5,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: 5.0,
    mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: 1.0,
    mavlink.MAVLINK_MSG_ID_VFR_HUD: 10.0,
}
_GROUND_STATION_HZ: Final[Mapping[int, float]] = {
    mavlink.MAVLINK_MSG_ID_ALTITUDE: 1.0,
    mavlink.MAVLINK_MSG_ID_ATTITUDE: 15.0,
    mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: 10.0,
    mavlink.MAVLINK_MSG_ID_ATTITUDE_TARGET: 2.0,
    mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: 0.5,
    mavlink.MAVLINK_MSG_ID_CURRENT_MODE: 0.5,
    mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: 0.5,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 1.0,
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 5.0,
    mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: 1.0,
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: 5.0,
    mavlink.MAVLINK_MSG_ID_HOME_POSITION: 0.5,
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 1.0,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: 1.0,
    mavlink.MAVLINK_MSG_ID_VFR_HUD: 4.0,
}


class Profile(Enum):
    """Default rates of a link: PX4's `-m onboard` and `-m normal`."""

    ONBOARD = "onboard"
    GROUND_STATION = "normal"


def default_intervals_us(profile: Profile) -> dict[int, int]:
    """Microseconds between two messages, by message id."""
    rates = _ONBOARD_HZ if profile is Profile.ONBOARD else _GROUND_STATION_HZ
    return {message_id: round(1e6 / rate) for message_id, rate in rates.items()}


class _Stream:
    """One periodic message. `reports`: whether it is to be sent when it is due, which is when to look."""

    __slots__ = ("build", "due_us", "interval_us", "reports", "sent_us")

    def __init__(self, build: Build, interval_us: int, now_us: int, reports: ModeReports | None = None) -> None:
        self.build = build
        self.reports = reports
        self.interval_us = interval_us
        self.sent_us = now_us
        self.due_us = now_us + interval_us

    def sent(self, now_us: int) -> None:
        self.sent_us = now_us
        due = self.due_us + self.interval_us  # a fixed grid: lateness does not lower the rate
        self.due_us = due if due > now_us else now_us + self.interval_us


class Streams:
    """The periodic messages of one link.

    Attributes:
        sequence: number of the next frame; every frame of the link takes one by `next_sequence`.
        odometry_due_us: of the next ODOMETRY, `NEVER_US` where it is stopped.
        others_due_us: of the next message that is not ODOMETRY.
    """

    def __init__(self, telemetry: Telemetry, profile: Profile, now_us: int = 0) -> None:
        self._telemetry = telemetry
        self._builders = {
            message_id: self._noted(message_id, build) for message_id, build in telemetry.builders.items()
        }
        self._told: dict[int, object] = {}
        self._defaults = default_intervals_us(profile)
        heartbeat = _Stream(self._builders[_HEARTBEAT], HEARTBEAT_INTERVAL_US, now_us)
        self._streams: dict[int, _Stream | SampledOdometry] = {_HEARTBEAT: heartbeat}
        self._others = [heartbeat]
        self._odometry: _Stream | SampledOdometry | None = None
        self.started = False
        self.sequence = 0
        self.odometry_due_us = NEVER_US
        self.others_due_us = now_us + HEARTBEAT_INTERVAL_US

    def start(self, now_us: int) -> None:
        """Somebody listens now: all default streams run from here."""
        if not self.started:
            self.started = True
            for message_id, interval in self._defaults.items():
                self._streams[message_id] = self._stream(message_id, interval, now_us, now_us)
            self._sort()

    def _noted(self, message_id: int, build: Build) -> Build:
        """Remember what was told, where it is told only once."""
        news = self._telemetry.news
        if news(message_id) is None:
            return build

        def noted(sequence: int) -> bytes:
            self._told[message_id] = news(message_id)
            return build(sequence)

        return noted

    def _stream(self, message_id: int, interval_us: int, since_us: int, now_us: int) -> _Stream | SampledOdometry:
        """One stream: of even intervals, or as PX4 has it. `since_us`: when it was sent last."""
        telemetry = self._telemetry
        if telemetry.like_px4 and message_id == _ODOMETRY:
            return SampledOdometry(telemetry.odometry_sample, telemetry.odometry_of, interval_us, now_us)
        build = self._builders[message_id]
        if telemetry.like_px4 and message_id == _CURRENT_MODE:
            return _Stream(build, MODE_LOOK_US, now_us, ModeReports(telemetry.modes, now_us))
        stream = _Stream(build, interval_us, since_us)
        stream.due_us = max(stream.due_us, now_us)
        return stream

    def set_interval(self, message_id: int, interval_us: float, now_us: int) -> bool:
        """SET_MESSAGE_INTERVAL: negative stops, zero is the default rate; whether PX4 would say it is known.

        A message asked for more often is sent as soon as its new interval since the last one has passed.
        """
        build = self._builders.get(message_id)
        if build is None or message_id == _HEARTBEAT or math.isnan(interval_us):
            return False
        self.start(now_us)
        interval = round(min(interval_us, MAX_INTERVAL_US))
        if -1e-5 <= interval_us <= 1e-5:
            interval = self._defaults.get(message_id, 0)
        if interval <= 0:
            self._streams.pop(message_id, None)
        else:
            old = self._streams.get(message_id)
            since_us = old.sent_us if old else now_us
            self._streams[message_id] = self._stream(message_id, interval, since_us, now_us)
        self._sort()
        return True

    def interval_us(self, message_id: int) -> int:
        """MESSAGE_INTERVAL.interval_us: -1 for a message that is not sent by itself."""
        stream = self._streams.get(message_id)
        return stream.interval_us if stream else -1

    def request(self, message_id: int) -> bytes | None:
        """One message out of turn; `None` where the plant does not have it, or where it has nothing new to tell."""
        build = self._builders.get(message_id)
        news = self._telemetry.news(message_id)
        if build is None or (news is not None and self._told.get(message_id) == news):
            return None
        return build(self.next_sequence())

    def upcoming(self, until_us: int) -> list[tuple[Build, range]]:
        """What builds each message but ODOMETRY, and when it is due from now on."""
        return [(stream.build, range(stream.due_us, until_us, stream.interval_us)) for stream in self._others]

    def upcoming_odometry(self, until_us: int) -> Iterator[tuple[int, bool, bool]]:
        """When ODOMETRY is due from now on, whether it is filled then, and whether it is sent. It runs on by that."""
        stream = self._odometry
        if isinstance(stream, SampledOdometry):
            yield from stream.upcoming(until_us)
        elif stream is not None:
            for due_us in range(stream.due_us, until_us, stream.interval_us):
                yield due_us, True, True

    def next_sequence(self) -> int:
        """The sequence number of one more frame."""
        sequence = self.sequence
        self.sequence = (sequence + 1) & 255
        return sequence

    def others(self, now_us: int, frames: list[bytes]) -> None:
        """Append what is due, but for ODOMETRY."""
        if now_us < self.others_due_us:
            return
        earliest = NEVER_US
        for stream in self._others:
            if stream.due_us <= now_us:
                if stream.reports is None or stream.reports.due(now_us):
                    frames.append(stream.build(self.next_sequence()))
                stream.sent(now_us)
            earliest = min(earliest, stream.due_us)
        self.others_due_us = earliest

    def odometry(self, now_us: int, frames: list[bytes]) -> bool:
        """Append ODOMETRY if it is due; whether it was."""
        stream = self._odometry
        if stream is None or stream.due_us > now_us:
            return False
        if isinstance(stream, SampledOdometry):
            frame = stream.step(now_us, self.next_sequence)
        else:
            frame = stream.build(self.next_sequence())
            stream.sent(now_us)
        self.odometry_due_us = stream.due_us
        if frame is None:
            return False
        frames.append(frame)
        return True

    def _sort(self) -> None:
        self._odometry = self._streams.get(_ODOMETRY)
        others = [stream for message_id, stream in self._streams.items() if message_id != _ODOMETRY]
        self._others = [stream for stream in others if isinstance(stream, _Stream)]
        self.odometry_due_us = self._odometry.due_us if self._odometry else NEVER_US
        self.others_due_us = min(stream.due_us for stream in self._others)
