"""One wire of the plant with everything that is its own, and what its frames meet on the way."""

from __future__ import annotations

import math
import struct
from typing import Final, NamedTuple, Protocol

from pymavlink.dialects.v20 import development as mavlink

from companion.mavlink.codec import CRC_BYTES, HEADER_BYTES, Frame, FrameParser
from sitl.messages.services import Services
from sitl.messages.streams import Streams
from sitl.wire.forwarding import Address, concerns, target
from sitl.wire.impairments import Channel
from sitl.wire.ports import Port, batches

_ODOMETRY: Final = mavlink.MAVLINK_MSG_ID_ODOMETRY.to_bytes(3, "little")
_SETPOINT_ID: Final = mavlink.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET
_POSE: Final = struct.Struct("<Q7f")  # time_usec, x, y, z, q of ODOMETRY
_MS: Final = struct.Struct("<I")
_OVERTAKEN_US: Final = 100_000  # older by less than that: on its way others have passed it
_QUATERNION_TOLERANCE: Final = 0.02


class Channels(NamedTuple):
    """Both directions of an impaired link."""

    down: Channel  # plant to companion
    up: Channel


class Peer(Protocol):
    """The companion, where it runs beside the plant in the same process.

    Attributes: `ended`, it will not answer any more; `gone`, set by the plant when it has seen that, at an instant of
    simulated time that is the same in every run.
    """

    gone: bool

    @property
    def ended(self) -> bool:
        """Whether it will not answer any more."""

    def idle(self, sent: int) -> bool:
        """Whether it has taken in `sent` datagrams and waits for the next, or has ended."""


class Wire:
    """A port with its streams, its services and, where given, a radio in between.

    Attributes:
        sample_ms: time of the newest ODOMETRY sent that a companion will answer: intact, valid, newer than the last.
            Whoever waits for the answer resets it to -1.
        answered_ms: time in the last SET_ATTITUDE_TARGET that has come in, executed already or still on its way.
        sent: datagrams put on an impaired wire since somebody was heard on it.
        standing: time stands still, so that nothing can be delayed.
        neighbours: other wires of the same autopilot, to which it passes on what is not for itself alone.
    """

    def __init__(self, port: Port, streams: Streams, services: Services, channels: Channels | None = None) -> None:
        self.port = port
        self.streams = streams
        self.services = services
        self.channels = channels
        self.parser = FrameParser(stream=port.stream)
        self.sample_ms = self.answered_ms = -1
        self.sent = 0
        self.standing = False
        self.neighbours: list[Wire] = []
        self._heard: set[Address] = set()
        self._late_parser = FrameParser()
        self._newest_us = -1
        self._arrived: list[bytes] = []

    @property
    def due_us(self) -> int:
        """When the next thing happens on this wire."""
        streams, channels = self.streams, self.channels
        due = min(streams.odometry_due_us, streams.others_due_us)
        return due if channels is None else min(due, channels.down.due_us, channels.up.due_us)

    def send(self, frames: list[bytes], now_us: int) -> None:
        """Frames on their way; on an impaired wire they arrive later, each by itself."""
        if self.channels is None:
            self.port.send(frames)
            if frames[-1][7:HEADER_BYTES] == _ODOMETRY:
                self._note(frames[-1])
            return
        if self.standing:
            self._put(frames)
            return
        for frame in frames:
            self.channels.down.put(frame, now_us)

    def send_due(self, frames: list[bytes], now_us: int) -> None:
        """Frames of the streams on their way over an impaired wire, and what arrives on it meanwhile."""
        channels = self.channels
        assert channels is not None
        if frames and channels.down.transparent and not self.standing:
            channels.down.pass_through(now_us)
            for frame in frames:
                self._arrive(frame)
        elif frames:
            self.send(frames, now_us)
        self.arrive(now_us)

    def handle(self, data: bytes, now_us: int) -> None:
        """Take received bytes; execute and answer them, now or when they have come through."""
        if not self.streams.started:
            self.streams.start(now_us)
        services = self.services
        if self.channels is None or self.standing:
            for frame in self.parser.feed(data):
                services.handle(frame)
                if self.neighbours:
                    self._forward(frame, now_us)
            self.answered_ms = services.setpoint_ms
        else:
            up = self.channels.up
            for frame in self.parser.feed(data):
                if frame.message_id == _SETPOINT_ID:
                    (self.answered_ms,) = _MS.unpack_from(frame.payload.ljust(4, b"\0"))
                    if up.transparent and not self.neighbours:
                        up.pass_through(now_us)
                        services.handle(frame)  # there is nothing to answer
                        continue
                up.put(frame.raw, now_us)
        self.flush(now_us)

    def _forward(self, frame: Frame, now_us: int) -> None:
        self._heard.add((frame.system_id, frame.component_id))
        address = target(frame)
        if address != self.services.address:
            for other in self.neighbours:
                if other.port.connected and concerns(address, other._heard):
                    other.send([frame.raw], now_us)

    def flush(self, now_us: int) -> None:
        """Send what the services have answered."""
        replies = self.services.replies
        if replies:
            self.send(replies, now_us)
            replies.clear()

    @property
    def prompt(self) -> bool:
        """Whether whatever is sent arrives at the same instant, if at all."""
        return self.channels is None or (self.channels.down.prompt and self.channels.up.prompt)

    def arrive(self, now_us: int) -> None:
        """What has come through an impaired wire by now, both ways. `push` puts it on the real one."""
        channels = self.channels
        if channels is None or (channels.down.due_us > now_us and channels.up.due_us > now_us):
            return
        for frame, _ in channels.up.arrived(now_us):
            for whole in self._late_parser.feed(frame):
                self.services.handle(whole)
                if self.neighbours:
                    self._forward(whole, now_us)
        self.flush(now_us)
        for frame, intact in channels.down.arrived(now_us):
            if not intact:  # by itself, so that it spoils no other
                self.push()
                self._put([frame])
                continue
            self._arrive(frame)

    def _arrive(self, frame: bytes) -> None:
        self._arrived.append(frame)
        if frame[7:HEADER_BYTES] == _ODOMETRY:
            self._note(frame)

    def push(self) -> None:
        """Send what has arrived on the companion's side of an impaired wire."""
        if self._arrived:
            self._put(self._arrived)
            self._arrived = []

    def _put(self, frames: list[bytes]) -> None:
        """As few datagrams as hold the frames, counted."""
        for batch in batches(frames):
            self.port.send(batch)
            self.sent += self.port.connected

    def _note(self, frame: bytes) -> None:
        """Remember an ODOMETRY that will be answered."""
        payload = frame[HEADER_BYTES:-CRC_BYTES].ljust(_POSE.size, b"\0")
        stamp_us, x, y, z, qw, qx, qy, qz = _POSE.unpack_from(payload)
        unit = abs(qw * qw + qx * qx + qy * qy + qz * qz - 1.0) < _QUATERNION_TOLERANCE
        if stamp_us > self._newest_us and unit and math.isfinite(x + y + z):
            self.sample_ms = round(1e-3 * stamp_us) & 0xFFFFFFFF
        if not 0 < self._newest_us - stamp_us < _OVERTAKEN_US:  # one that was overtaken is dropped, and no new start
            self._newest_us = stamp_us
