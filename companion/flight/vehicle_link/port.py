"""The process's side of the link: frames in, messages out, both recorded, and what the vehicle last said of itself."""

from __future__ import annotations

from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from companion.config.schema import Config
from companion.flight.vehicle_link import live_command as steer
from companion.mavlink import px4
from companion.mavlink.codec import Encoder, Frame, FrameParser, Layout
from companion.mavlink.link import Link
from companion.mavlink.signing import Signing, read_key
from companion.record.recorder import RECEIVED, SENT, Recorder

HEARTBEAT = Layout("HEARTBEAT")
CURRENT_MODE = Layout("CURRENT_MODE")
SET_ATTITUDE_TARGET = Layout("SET_ATTITUDE_TARGET")
ODOMETRY = Layout("ODOMETRY")
_sample_time = ODOMETRY.only("time_usec").unpack_from

_BASE_MODE = HEARTBEAT.index("base_mode")
_HEARTBEAT_MODE = HEARTBEAT.index("custom_mode")
_AUTOPILOT = HEARTBEAT.index("autopilot")
_SYSTEM_STATUS = HEARTBEAT.index("system_status")
_CURRENT_MODE = CURRENT_MODE.index("custom_mode")
_INTENDED_MODE = CURRENT_MODE.index("intended_custom_mode")
_TARGET_SYSTEM = SET_ATTITUDE_TARGET.index("target_system")
_TARGET_COMPONENT = SET_ATTITUDE_TARGET.index("target_component")
_RIVALS = frozenset({HEARTBEAT.message_id, SET_ATTITUDE_TARGET.message_id})
_MOST_STEERING = 4  # commands between two looks at them: only the newest is flown


class Port:
    """Frames of the one configured autopilot; everybody else's are counted in `foreign` and dropped.

    With a key, what is not signed by it is dropped too. The link is locked to whoever sent the first heartbeat of the
    configured vehicle that says it is PX4's; until then nothing else is believed.

    Attributes: `mode` (custom_mode) and `armed` as last heard, `intended_mode` what it was told to be in, None while
    nobody has said so; `system_status` (MAV_STATE) of its last heartbeat, `mode_reports` how often the mode was heard,
    `connected` once a heartbeat came; `steering` commands of those who may steer, and `rival`, who else was heard to
    fly the vehicle or to go by our name, both for the reader to take away.
    """

    def __init__(self, config: Config, link: Link, recorder: Recorder, *, lockstep: bool = False) -> None:
        self._link = link
        self._record = recorder.add
        self._lockstep = lockstep
        self._parser = FrameParser(stream=link.stream)
        self._vehicle = (config.vehicle.system_id, config.vehicle.component_id)
        self._own = (config.link.system_id, config.link.component_id)
        self._may_steer = frozenset(config.steering.system_ids if config.steering.enabled else ())
        key_file = config.link.signing_key_file
        self._signing = None if key_file is None else Signing(read_key(key_file))
        self._pymavlink = mavlink.MAVLink(None, srcSystem=self._own[0], srcComponent=self._own[1])
        self._encode_setpoint = Encoder(SET_ATTITUDE_TARGET, *self._own, signed=key_file is not None).encode
        self._sequence = 0
        self.foreign = 0
        self.steering: list[Frame] = []
        self.rival: str | None = None
        self.connected = False
        self.mode = 0
        self.intended_mode: int | None = None
        self.mode_reports = 0
        self.system_status = 0
        self.armed = False

    def receive(self) -> bytes:
        """The next bytes of the link, or none within its timeout."""
        return self._link.receive()

    def frames(self, data: bytes, time_us: int) -> list[Frame]:
        """The autopilot's frames in `data`, recorded."""
        kept = []
        signing = self._signing
        for frame in self._parser.feed(data):
            number, system, component, _, payload, raw = frame
            if (system, component) == self._vehicle:
                believed = signing is None or signing.verify(frame)
                if believed and (self.connected or number == HEARTBEAT.message_id):
                    if self._lockstep and number == ODOMETRY.message_id:
                        (time_us,) = _sample_time(ODOMETRY.full(payload))  # it is what moves our clock
                    self._record(RECEIVED, time_us, raw)
                    kept.append(frame)
            elif system in self._may_steer and self.connected and steer.addressed_to(frame, self._own):
                if signing is None or signing.verify(frame):
                    self._record(RECEIVED, time_us, raw)
                    self.steering = [*self.steering[1 - _MOST_STEERING :], frame]
            else:
                self.foreign += 1
                if self.connected and self.rival is None and number in _RIVALS:
                    self.rival = self._recognise(frame)
        return kept

    def _recognise(self, frame: Frame) -> str | None:
        """Who it is that flies the vehicle beside us, or goes by our name; None for everybody else."""
        who = (frame.system_id, frame.component_id)
        if frame.message_id == SET_ATTITUDE_TARGET.message_id:
            values = SET_ATTITUDE_TARGET.unpack(frame.payload)
            system, component = values[_TARGET_SYSTEM], values[_TARGET_COMPONENT]
            if who != self._own and (system != self._vehicle[0] or component not in (0, self._vehicle[1])):
                return None
            text = "{}/{} streams to the vehicle".format(*who)
        elif who == self._own:
            text = "another companion is {}/{} too".format(*who)
        else:
            return None
        return text if self._signing is None or self._signing.verify(frame) else None

    def tally(self) -> str:
        """What came over the link and was not believed, for the log."""
        parser, signing = self._parser, self._signing
        text = (
            f"{parser.frames} frames, {self.foreign} foreign, {parser.bad_crc} bad_crc, {parser.unknown} unknown, "
            f"{parser.dropped_bytes} bytes of no frame"
        )
        if signing is None:
            return text
        return (
            f"{text}, {signing.unsigned} unsigned, {signing.bad_signature} bad_signature, {signing.replayed} replayed"
        )

    def doubt(self) -> str:
        """For a person who waits for a vehicle: what was heard instead of it; empty for nothing."""
        signing = self._signing
        refused = 0 if signing is None else signing.unsigned + signing.bad_signature + signing.replayed
        if refused:
            return f"{refused} frames in its name were not signed by link.signing_key_file, or are old"
        return f"{self.foreign} frames of others were heard" if self.foreign else ""

    def note(self, frame: Frame) -> bool:
        """Take in a HEARTBEAT or CURRENT_MODE, and nothing else; True for a heartbeat of PX4."""
        if frame.message_id == CURRENT_MODE.message_id:
            values = CURRENT_MODE.unpack(frame.payload)
            self.mode_reports += 1
            self.mode = values[_CURRENT_MODE]
            self.intended_mode = values[_INTENDED_MODE] or None
            return False
        values = HEARTBEAT.unpack(frame.payload)
        if values[_AUTOPILOT] != mavlink.MAV_AUTOPILOT_PX4:
            return False
        self.mode_reports += 1
        if values[_HEARTBEAT_MODE] != self.mode:
            self.mode = values[_HEARTBEAT_MODE]
            self.intended_mode = None  # who changed it, CURRENT_MODE will tell
        self.system_status = values[_SYSTEM_STATUS]
        self.armed = bool(values[_BASE_MODE] & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
        if not self.connected:
            self.connected = True
            self._link.lock()
        return True

    def send(self, message: Any, time_us: int) -> None:
        """Send a pymavlink message, off the hot path."""
        self._pymavlink.seq = self._sequence
        frame = bytes(message.pack(self._pymavlink))
        self._put(frame if self._signing is None else self._signing.sign(frame), time_us)

    def forward(self, frame: bytes, time_us: int) -> None:
        """Send somebody else's frame as it is, but for our signature."""
        frame = frame if self._signing is None else self._signing.sign(frame)
        self._link.send(frame)
        self._record(SENT, time_us, frame)

    def send_setpoint(
        self, sample_ms: int, qw: float, qx: float, qy: float, qz: float, thrust: float, time_us: int
    ) -> None:
        """Send SET_ATTITUDE_TARGET, stamped with the time of the odometry sample that it answers."""
        system, component = self._vehicle
        frame = self._encode_setpoint(
            self._sequence, sample_ms, qw, qx, qy, qz, 0.0, 0.0, 0.0, thrust, system, component, px4.ATTITUDE_TYPE_MASK
        )
        self._put(frame if self._signing is None else self._signing.seal(frame), time_us)

    def _put(self, frame: bytes, time_us: int) -> None:
        self._sequence = self._sequence + 1 & 255
        self._link.send(frame)
        self._record(SENT, time_us, frame)
