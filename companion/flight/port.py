"""The process's side of the link: frames in, messages out, both recorded, and what the vehicle last said of itself."""

from __future__ import annotations

from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from companion.config.schema import Config
from companion.mavlink import px4
from companion.mavlink.codec import Encoder, Frame, FrameParser, Layout
from companion.mavlink.link import Link
from companion.record.recorder import RECEIVED, SENT, Recorder

HEARTBEAT = Layout("HEARTBEAT")
CURRENT_MODE = Layout("CURRENT_MODE")
SET_ATTITUDE_TARGET = Layout("SET_ATTITUDE_TARGET")

_BASE_MODE = HEARTBEAT.index("base_mode")
_HEARTBEAT_MODE = HEARTBEAT.index("custom_mode")
_CURRENT_MODE = CURRENT_MODE.index("custom_mode")


class Port:
    """Frames of the one configured autopilot; everybody else's are counted in `foreign` and dropped.

    Attributes: `mode` (custom_mode) and `armed` as last heard, `mode_reports` how often the mode was,
    `connected` once a heartbeat came.
    """

    def __init__(self, config: Config, link: Link, recorder: Recorder) -> None:
        self._link = link
        self._recorder = recorder
        self._parser = FrameParser(stream=link.stream)
        self._vehicle = (config.vehicle.system_id, config.vehicle.component_id)
        self._pymavlink = mavlink.MAVLink(None, srcSystem=config.link.system_id, srcComponent=config.link.component_id)
        encoder = Encoder(SET_ATTITUDE_TARGET, config.link.system_id, config.link.component_id)
        self._encode_setpoint = encoder.encode
        self._sequence = 0
        self.foreign = 0
        self.connected = False
        self.mode = 0
        self.mode_reports = 0
        self.armed = False

    def receive(self) -> bytes:
        """The next bytes of the link, or none within its timeout."""
        return self._link.receive()

    def frames(self, data: bytes, time_us: int) -> list[Frame]:
        """The autopilot's frames in `data`, recorded."""
        kept = []
        for frame in self._parser.feed(data):
            if (frame.system_id, frame.component_id) == self._vehicle:
                self._recorder.add(RECEIVED, time_us, frame.raw)
                kept.append(frame)
            else:
                self.foreign += 1
        return kept

    def note(self, frame: Frame) -> bool:
        """Take in a HEARTBEAT or CURRENT_MODE, and nothing else; True for a heartbeat."""
        self.mode_reports += 1
        if frame.message_id == CURRENT_MODE.message_id:
            self.mode = CURRENT_MODE.unpack(frame.payload)[_CURRENT_MODE]
            return False
        values = HEARTBEAT.unpack(frame.payload)
        self.mode = values[_HEARTBEAT_MODE]
        self.armed = bool(values[_BASE_MODE] & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
        if not self.connected:
            self.connected = True
            self._link.lock()
        return True

    def send(self, message: Any, time_us: int) -> None:
        """Send a pymavlink message, off the hot path."""
        self._pymavlink.seq = self._sequence
        self._put(bytes(message.pack(self._pymavlink)), time_us)

    def send_setpoint(
        self, sample_ms: int, qw: float, qx: float, qy: float, qz: float, thrust: float, time_us: int
    ) -> None:
        """Send SET_ATTITUDE_TARGET, stamped with the time of the odometry sample that it answers."""
        system, component = self._vehicle
        self._put(
            self._encode_setpoint(
                self._sequence, sample_ms, qw, qx, qy, qz, 0.0, 0.0, 0.0, thrust, system, component,
                px4.ATTITUDE_TYPE_MASK,
            ),
            time_us,
        )  # fmt: skip

    def _put(self, frame: bytes, time_us: int) -> None:
        self._sequence = self._sequence + 1 & 255
        self._link.send(frame)
        self._recorder.add(SENT, time_us, frame)
