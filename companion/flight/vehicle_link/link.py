"""The vehicle as the flight process sees it: plain records in, requests and set-points out, all of it recorded.

Only this room knows MAVLink. What is heard of the vehicle besides the records stands in the link's attributes.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from companion.config.schema import Config
from companion.control.types import AttitudeSetpoint
from companion.flight.authority.states import Reason, State
from companion.flight.host.clock import Clock
from companion.flight.vehicle_link import live_command, modes, requests
from companion.flight.vehicle_link.arrivals import Arrivals, without_overtaken
from companion.flight.vehicle_link.ground_station import GroundStation, system_status
from companion.flight.vehicle_link.link_delay import TIMESYNC, LinkDelay
from companion.flight.vehicle_link.live_command import LiveCommand
from companion.flight.vehicle_link.messages import COMMAND_ACK, ROWS, Answer, Heartbeat, ModeReport, answer
from companion.flight.vehicle_link.odometry import ATTITUDE_QUATERNION, LOCAL_POSITION_NED, ODOMETRY, PoseSource
from companion.flight.vehicle_link.requests import CURRENT_MODE, HEARTBEAT, Request
from companion.flight.vehicle_link.rivals import KEPT, SET_ATTITUDE_TARGET, is_echo, recognise
from companion.flight.vehicle_link.trust import Trust
from companion.mavlink import px4
from companion.mavlink.codec import Encoder, Frame, FrameParser
from companion.mavlink.freshness import FreshSigning
from companion.mavlink.heard import Heard, is_px4
from companion.mavlink.link import Link, LinkError
from companion.record.recorder import RECEIVED, SENT, Recorder

__all__ = ["Link", "LinkError", "VehicleLink"]

_sample_time = ODOMETRY.only("time_usec").unpack_from

_BASE_MODE = HEARTBEAT.index("base_mode")
_HEARTBEAT_MODE = HEARTBEAT.index("custom_mode")
_SYSTEM_STATUS = HEARTBEAT.index("system_status")
_CURRENT_MODE = CURRENT_MODE.index("custom_mode")
_INTENDED_MODE = CURRENT_MODE.index("intended_custom_mode")
_MOST_STEERING = 4  # commands between two looks at them: only the newest is flown


class VehicleLink:
    """Frames of the one configured autopilot; everybody else's are counted in `foreign` and dropped.

    With a key, what is not signed by it is dropped too, and the vehicle has first to answer a question of ours
    (`companion.mavlink.freshness`). The link is locked to whoever sent the first heartbeat of the configured vehicle
    that says it is PX4's; until then nothing else is believed.

    Attributes: `mode` (custom_mode) and `armed` as last heard, `intended_mode` what it was told to be in, None while
    nobody has said so; `mode_reports` how often the mode was heard, `connected` once a heartbeat came; `pose` and
    `delay`, where odometry comes from and how late; `heard`, the frames of the last bytes, for tools; `foreign` frames
    of others, `echoed` our own that came back: a router loops; `remarks` on the key, for a person.
    """

    def __init__(self, config: Config, link: Link, recorder: Recorder, clock: Clock) -> None:
        self._link = link
        self._record = recorder.add
        self._clock = clock
        self._parser = FrameParser(stream=link.stream)
        self._vehicle = (config.vehicle.system_id, config.vehicle.component_id)
        self._own = (config.link.system_id, config.link.component_id)
        self._may_steer = frozenset(config.steering.system_ids if config.steering.enabled else ())
        self._trust = Trust(config)
        self._signing, self.remarks = self._trust.signing, self._trust.remarks
        self._pymavlink = mavlink.MAVLink(None, srcSystem=self._own[0], srcComponent=self._own[1])
        self._encode_setpoint = Encoder(SET_ATTITUDE_TARGET, *self._own, signed=self._signing is not None).encode
        self._ground_station = GroundStation(one_axis=config.vehicle_kind.one_axis)
        self._count = 0  # of frames sent: the sequence is the rest of it by 256
        self._sent = [b""] * KEPT
        self._arrivals = Arrivals(link, None if clock.lockstep else clock.wall_s)
        self.receive = self._arrivals.receive
        self.steering: deque[tuple[float, Frame]] = deque(maxlen=_MOST_STEERING)
        self.pose = pose = PoseSource()
        self.delay = LinkDelay()
        self._decoders: dict[int, Callable[[Frame], Any]] = {
            ODOMETRY.message_id: pose.on_frame,
            ATTITUDE_QUATERNION.message_id: pose.on_frame,
            LOCAL_POSITION_NED.message_id: pose.on_frame,
            HEARTBEAT.message_id: self._on_heartbeat,
            CURRENT_MODE.message_id: self._on_current_mode,
            TIMESYNC.message_id: self._on_timesync,
            **{row.message_id: _of_payload(row.decode) for row in ROWS},
            COMMAND_ACK.message_id: self._on_answer,
        }
        self.heard: list[Frame] = []
        self._strangers = Heard(self._vehicle, self._own, stream=link.stream)
        self.foreign = self.echoed = 0
        self._rival: str | None = None
        self.connected = False
        self.mode = 0
        self.intended_mode: int | None = None
        self.mode_reports = 0
        self.armed = False
        self._system_status = 0

    # -- what comes in ------------------------------------------------------------------------------------------------

    def messages(self, data: bytes) -> Iterator[Any]:
        """What the autopilot tells in `data`: Odometry and the records of `messages`, in order.

        One is decoded when it is asked for, so that the link's attributes are as of that record.
        """
        decoders = self._decoders
        heard = self._frames(data)
        arrivals = self._arrivals
        if arrivals.waiting:
            waiting, arrivals.waiting = arrivals.waiting, []
            heard = without_overtaken([*heard, *(frame for more in waiting for frame in self._frames(more))])
        self.heard = heard
        for frame in heard:
            decode = decoders.get(frame[0])
            if decode is not None:
                message = decode(frame)
                if message is not None:
                    yield message

    @property
    def killed(self) -> bool:
        """Whether the vehicle was killed or its flight terminated."""
        return modes.killed(self.mode, self._system_status)

    def live_commands(self) -> list[LiveCommand]:
        """Where those who may steer want the vehicle since this was last asked, or why it is refused."""
        heard = list(self.steering)
        self.steering.clear()
        for _, frame in heard:
            self._record(RECEIVED, self._clock.stamp_us, frame.raw)
        return [LiveCommand(heard_s, frame[1:3], live_command.parse(frame, self._own)) for heard_s, frame in heard]

    def _frames(self, data: bytes) -> list[Frame]:
        """The autopilot's frames in `data`, recorded."""
        kept = []
        if not self.connected:
            self._strangers.take(data)
        signing, time_us = self._signing, self._clock.stamp_us
        for frame in self._parser.feed(data):
            number, system, component, _, payload, raw = frame
            if (system, component) == self._vehicle:
                believed = signing is None or signing.verify(frame)
                if believed and (self.connected or number == HEARTBEAT.message_id):
                    if self._clock.lockstep and number == ODOMETRY.message_id:
                        (time_us,) = _sample_time(ODOMETRY.full(payload))  # it is what moves our clock
                    self._record(RECEIVED, time_us, raw)
                    kept.append(frame)
                elif believed and number == TIMESYNC.message_id:  # its answer: now it may say what it is
                    self.request(requests.TellHeartbeat())
            elif system in self._may_steer and self.connected and live_command.addressed_to(frame, self._own):
                if signing is None or signing.verify(frame):
                    self.steering.append((self._clock.now_s, frame))
            elif (system, component) == self._own and is_echo(frame, self._sent):
                self.echoed += 1
            else:
                self.foreign += 1
                if self.connected and self._rival is None:
                    self._rival = self._recognise(frame)
        if signing is not None and signing.wanted:
            self._challenge(signing)
        return kept

    def _challenge(self, signing: FreshSigning) -> None:
        """Ask whoever was heard last whether it is the vehicle, and now."""
        nonce = signing.challenge(self._clock.wall_s())
        if nonce is not None:
            self._send(mavlink.MAVLink_timesync_message(0, nonce))

    def _recognise(self, frame: Frame) -> str | None:
        """Who it is that flies the vehicle beside us, as far as that can be believed; None for everybody else."""
        text = recognise(frame, self._own, self._vehicle)
        return text if text is None or self._signing is None or self._signing.verify(frame) else None

    def rival(self) -> str | None:
        """Who else was heard to fly the vehicle or to go by our name since this was last asked."""
        rival, self._rival = self._rival, None
        return rival

    def tally(self) -> str:
        """What came over the link and was not believed, for the log."""
        parser, signing = self._parser, self._signing
        text = (
            f"{parser.frames} frames, {self.foreign} foreign, {parser.bad_crc} bad_crc, {parser.unknown} unknown, "
            f"{parser.dropped_bytes} bytes of no frame"
        )
        if self.echoed:
            text += f", {self.echoed} echoed (a router loops)"
        if signing is None:
            return text
        return (
            f"{text}, {signing.unsigned} unsigned, {signing.bad_signature} bad_signature, {signing.replayed} replayed, "
            f"{signing.unproven} unproven"
        )

    def no_vehicle(self, patience_s: float) -> str:
        """Why there is none after so long, as one line: what was heard instead of it."""
        return self._strangers.complaint(patience_s, 0 if self._signing is None else self._signing.refused)

    def _on_heartbeat(self, frame: Frame) -> Heartbeat | None:
        if not is_px4(frame):
            return None
        values = HEARTBEAT.unpack(frame.payload)
        self.mode_reports += 1
        if values[_HEARTBEAT_MODE] != self.mode:
            self.mode = values[_HEARTBEAT_MODE]
            self.intended_mode = None  # who changed it, CURRENT_MODE will tell
        self._system_status = values[_SYSTEM_STATUS]
        self.armed = bool(values[_BASE_MODE] & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
        if not self.connected:
            self.connected = True
            self._link.lock()
        return Heartbeat()

    def _on_current_mode(self, frame: Frame) -> ModeReport:
        values = CURRENT_MODE.unpack(frame.payload)
        before, self.mode = self.mode, values[_CURRENT_MODE]
        self.mode_reports += 1
        self.intended_mode = values[_INTENDED_MODE] or None
        return ModeReport(self.mode != before, self.intended_mode is not None)

    def _on_answer(self, frame: Frame) -> Answer | None:
        answered = answer(frame.payload)
        return answered if answered.is_for(self._own) else None

    def _on_timesync(self, frame: Frame) -> None:
        self.delay.answered(frame, self._clock.elapsed_s())

    # -- what goes out ------------------------------------------------------------------------------------------------

    def request(self, request: Request) -> None:
        """Ask something of the vehicle."""
        for message in requests.encode(request, self._vehicle, self.pose):
            self._send(message)

    def send_heartbeat(self, state: State, reason: Reason | None = None, *, alarmed: bool = False) -> None:
        """The companion's own heartbeat. `alarmed`: a guard is above its limit."""
        self._send(px4.heartbeat(mavlink.MAV_STATE_CRITICAL if alarmed else system_status(state, reason)))
        self._trust.keep(self._clock.wall_s())

    def send_values(self, tick: bytes) -> None:
        """A few numbers of a recorded tick, for the ground station."""
        for message in self._ground_station.messages(tick):
            self._send(message)

    def warn(self, text: str) -> None:
        """A warning to the ground station, cut to what a STATUSTEXT holds."""
        self._send(mavlink.MAVLink_statustext_message(mavlink.MAV_SEVERITY_WARNING, text.encode()[:50]))

    def measure_delay(self) -> None:
        """Ask the vehicle for its time; the answer goes into `delay`."""
        self._send(self.delay.request(self._clock.elapsed_s()))

    def forward(self, frame: bytes) -> None:
        """Send somebody else's frame as it is, but for our signature."""
        frame = frame if self._signing is None else self._signing.sign(frame)
        self._link.send(frame)
        self._record(SENT, self._clock.time_us(), frame)

    def send_setpoint(self, sample_ms: int, setpoint: AttitudeSetpoint) -> None:
        """Send SET_ATTITUDE_TARGET, stamped with the time of the odometry sample that it answers."""
        qw, qx, qy, qz, thrust = setpoint
        system, component = self._vehicle
        frame = self._encode_setpoint(
            self._count,
            sample_ms,
            qw,
            qx,
            qy,
            qz,
            0.0,
            0.0,
            0.0,
            thrust,
            system,
            component,
            px4.ATTITUDE_TYPE_MASK,
        )
        self._put(frame if self._signing is None else self._signing.seal(frame), self._clock.stamp_us)

    def _send(self, message: Any) -> None:
        """Send a pymavlink message, off the hot path."""
        self._pymavlink.seq = self._count & 255
        frame = bytes(message.pack(self._pymavlink))
        self._put(frame if self._signing is None else self._signing.sign(frame), self._clock.time_us())

    def _put(self, frame: bytes, time_us: int) -> None:
        count = self._count
        self._sent[count % KEPT] = frame
        self._count = count + 1
        if not self.connected:
            self._strangers.sent(frame)
        self._link.send(frame)
        self._record(SENT, time_us, frame)

    def close(self) -> str | None:
        """Keep what the next run has to know of the key; a complaint as one line, or None. The link stays open."""
        return self._trust.close()


def _of_payload(decode: Callable[[bytes], Any]) -> Callable[[Frame], Any]:
    return lambda frame: decode(frame.payload)
