"""Who spoke on the link while a vehicle was waited for: for the one line that says why it did not come.

Looked at only until the vehicle is there; in flight it costs nothing.

Source: https://mavlink.io/en/guide/serialization.html (both versions of the protocol), #HEARTBEAT, #MAV_AUTOPILOT.
"""

from __future__ import annotations

from collections import deque
from typing import Final, NamedTuple

from fastcrc.crc16 import mcrf4xx
from pymavlink.dialects.v20 import development as mavlink

from companion.mavlink.codec import CRC_BYTES, Frame, FrameParser, Layout, crc_extra

HEARTBEAT: Final = Layout("HEARTBEAT")

_MAGIC_V1: Final = 0xFE
_HEADER_V1: Final = 6  # magic, length, sequence, system, component, message id
_TAIL_BYTES: Final = 512  # of a stream, kept for the frame that it cuts: no frame is longer
_KEPT_SENT: Final = 64
_MOST_NAMED: Final = 3
_TYPE: Final = HEARTBEAT.index("type")
_AUTOPILOT: Final = HEARTBEAT.index("autopilot")
_NAMES: Final = {mavlink.MAV_AUTOPILOT_PX4: "a PX4", mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA: "an ArduPilot"}
_NO_AUTOPILOT: Final = {
    mavlink.MAV_TYPE_GCS: "a ground station",
    mavlink.MAV_TYPE_ONBOARD_CONTROLLER: "a companion",
    mavlink.MAV_TYPE_GIMBAL: "a gimbal",
    mavlink.MAV_TYPE_CAMERA: "a camera",
}

Ids = tuple[int, int]  # system, component


class Speaker(NamedTuple):
    """What a heartbeat says of who sent it."""

    autopilot: int  # MAV_AUTOPILOT
    type: int  # MAV_TYPE
    version: int  # of MAVLink

    @property
    def name(self) -> str:
        """In words."""
        if self.autopilot == mavlink.MAV_AUTOPILOT_INVALID:
            return _NO_AUTOPILOT.get(self.type, "no autopilot")
        known = mavlink.enums["MAV_AUTOPILOT"].get(self.autopilot)
        shown = known.name.removeprefix("MAV_AUTOPILOT_") if known is not None else f"autopilot {self.autopilot}"
        return _NAMES.get(self.autopilot, f"{shown}, no PX4")


def is_px4(heartbeat: Frame) -> bool:
    """Whether a HEARTBEAT is of a PX4."""
    return bool(HEARTBEAT.unpack(heartbeat.payload)[_AUTOPILOT] == mavlink.MAV_AUTOPILOT_PX4)


class Heard:
    """What came over a link before the vehicle with these ids was believed; `own`, the ids that we speak with."""

    def __init__(self, vehicle: Ids, own: Ids, *, stream: bool) -> None:
        self._vehicle, self._own, self._stream = vehicle, own, stream
        self._parser = FrameParser(stream=stream)
        self._tail = b""
        self._sent: deque[bytes] = deque(maxlen=_KEPT_SENT)
        self._speakers: dict[Ids, Speaker] = {}
        self._frames = self._own_frames = self._echoes = self._bytes = 0

    def sent(self, frame: bytes) -> None:
        """A frame of ours: heard again, it is an echo."""
        self._sent.append(frame)

    def take(self, data: bytes) -> None:
        """The next bytes of the link."""
        self._bytes += len(data)
        for frame in self._parser.feed(data):
            ids = (frame.system_id, frame.component_id)
            if ids == self._own:
                self._own_frames += 1
                self._echoes += frame.raw in self._sent
            else:
                self._hear(ids, frame.message_id, frame.payload, 2)
        self._take_v1(data)

    def complaint(self, patience_s: float, unsigned: int = 0) -> str:
        """Why there is no vehicle, as one line. `unsigned`: frames in its name that a key did not prove."""
        system, component = self._vehicle
        if unsigned:
            why = f"{unsigned} frames in its name were not signed by link.signing_key_file, or are old"
        else:
            why = self._why() or "check the link and vehicle.system_id; nothing was heard"
        return f"no heartbeat of vehicle {system}/{component} within {patience_s:g} s: {why}"

    def _why(self) -> str:
        """What was heard instead, the most telling first; empty for nothing."""
        wanted = self._speakers.get(self._vehicle)
        if wanted is not None and wanted.autopilot != mavlink.MAV_AUTOPILOT_PX4:
            return f"it is {wanted.name}, and this companion flies PX4 alone"
        if wanted is not None and wanted.version == 1:
            return "it speaks MAVLink 1 only: set its MAV_PROTO_VER to 2"
        others = {ids: speaker for ids, speaker in self._speakers.items() if ids != self._vehicle}
        px4 = [ids for ids, speaker in others.items() if speaker.autopilot == mavlink.MAV_AUTOPILOT_PX4]
        if px4:
            system, component = px4[0]
            own = f"system_id to {system}"
            if component != self._vehicle[1]:
                own += f" and vehicle.component_id to {component}"
            old = ", in MAVLink 1 alone" if others[px4[0]].version == 1 else ""
            return f"a PX4 is there as {system}/{component}{old}: is that it? Then set vehicle.{own}"
        said = [f"{speaker.name} as {ids[0]}/{ids[1]}" for ids, speaker in list(others.items())[:_MOST_NAMED]]
        if self._echoes:
            said.append("our own frames, which a router sends back")
        elif self._own_frames:
            said.append("another companion that goes by {}/{} as we do".format(*self._own))
        if said:
            return f"heard was {', '.join(said)}: check the link and vehicle.system_id"
        if self._frames:
            return f"{self._frames} frames of others were heard, no heartbeat: check the link and vehicle.system_id"
        if self._bytes:
            baud = ": check the baud rate" if self._stream else ": check the port"
            return f"{self._bytes} bytes were heard that are no MAVLink{baud}"
        return ""

    def _hear(self, ids: Ids, message_id: int, payload: bytes, version: int) -> None:
        self._frames += 1
        if message_id == HEARTBEAT.message_id:
            values = HEARTBEAT.unpack(payload)
            known = self._speakers.get(ids)
            newest = version if known is None else max(version, known.version)
            self._speakers[ids] = Speaker(values[_AUTOPILOT], values[_TYPE], newest)

    def _take_v1(self, data: bytes) -> None:
        """Frames of MAVLink 1 in it, which nobody else here reads."""
        data = self._tail + data
        at, total = 0, len(data)
        while (at := data.find(_MAGIC_V1, at)) >= 0 and at + _HEADER_V1 <= total:
            length, _, system, component, number = data[at + 1 : at + _HEADER_V1]
            end = at + _HEADER_V1 + length + CRC_BYTES
            if end > total and self._stream:
                break
            if self._whole_v1(data[at:end], length, number):
                payload = data[at + _HEADER_V1 : end - CRC_BYTES]
                self._hear((system, component), number, payload, 1)
                at = end
            else:
                at += 1
        self._tail = data[max(at, 0) :][-_TAIL_BYTES:] if self._stream and at >= 0 else b""

    @staticmethod
    def _whole_v1(frame: bytes, length: int, number: int) -> bool:
        if len(frame) != _HEADER_V1 + length + CRC_BYTES:
            return False
        try:
            extra = crc_extra(number)
        except KeyError:
            return False
        return bool(mcrf4xx(frame[1:-CRC_BYTES] + extra) == int.from_bytes(frame[-CRC_BYTES:], "little"))
