"""One link for two processes: a Unix socket through which a tool talks to the vehicle while `companion run` flies it.

PX4 locks on to the first sender's port and a tty has one owner, so the flying process keeps the link. It hands what is
not hot to the tool that attaches to the socket, and sends on what it asks. So mavsdk, with threads and native code
of its own, stays out of the process that flies: it cannot delay a tick, and when it dies nothing falls.

What passes outward are questions only. A tool cannot arm, change a mode or a parameter, send a set-point or a
heartbeat, nor ask for the list of all parameters, which is a burst of a thousand frames. What it asks of the logs is
asked in small bursts, one after the other, that the loop does not feel.
"""

from __future__ import annotations

import os
import socket
from collections.abc import Iterable
from pathlib import Path
from typing import Final, NamedTuple

from pymavlink.dialects.v20 import development as mavlink

from companion.mavlink.codec import Encoder, Frame, FrameParser, Layout, decode_cold
from companion.mavlink.link import LinkError
from companion.mavlink.logs.protocol import DATA_BYTES, ON_A_LINE, Pace
from companion.mavlink.socket_owner import ask_who_sends, receive, refusal

# What is not hot: what a tool may want to know, and nothing that comes at the loop's rate.
COLD: Final = frozenset(
    {
        mavlink.MAVLINK_MSG_ID_HEARTBEAT,
        mavlink.MAVLINK_MSG_ID_SYS_STATUS,
        mavlink.MAVLINK_MSG_ID_SYSTEM_TIME,
        mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE,
        mavlink.MAVLINK_MSG_ID_BATTERY_STATUS,
        mavlink.MAVLINK_MSG_ID_GPS_RAW_INT,
        mavlink.MAVLINK_MSG_ID_HOME_POSITION,
        mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION,
        mavlink.MAVLINK_MSG_ID_MESSAGE_INTERVAL,
        mavlink.MAVLINK_MSG_ID_COMMAND_ACK,
        mavlink.MAVLINK_MSG_ID_PARAM_VALUE,
        mavlink.MAVLINK_MSG_ID_PARAM_ERROR,
        mavlink.MAVLINK_MSG_ID_LOG_ENTRY,
        mavlink.MAVLINK_MSG_ID_LOG_DATA,
        mavlink.MAVLINK_MSG_ID_PING,
        mavlink.MAVLINK_MSG_ID_STATUSTEXT,
    }
)
_QUESTIONS: Final = frozenset(
    {
        mavlink.MAVLINK_MSG_ID_PING,
        mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_READ,
        mavlink.MAVLINK_MSG_ID_LOG_REQUEST_LIST,
        mavlink.MAVLINK_MSG_ID_LOG_REQUEST_DATA,
        mavlink.MAVLINK_MSG_ID_LOG_REQUEST_END,
        mavlink.MAVLINK_MSG_ID_COMMAND_LONG,
        mavlink.MAVLINK_MSG_ID_COMMAND_INT,
    }
)
_ASKING_COMMANDS: Final = frozenset(
    {
        mavlink.MAV_CMD_REQUEST_MESSAGE,
        mavlink.MAV_CMD_GET_MESSAGE_INTERVAL,
        mavlink.MAV_CMD_REQUEST_PROTOCOL_VERSION,  # up to PX4 v1.17, as the next; mavsdk asks it and REQUEST_MESSAGE
        mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES,  # in turns, whatever the version
    }
)
_REQUEST_DATA: Final = Layout("LOG_REQUEST_DATA")
_OFFSET: Final = _REQUEST_DATA.index("ofs")
_COUNT: Final = _REQUEST_DATA.index("count")
_LAST_OFFSET: Final = 0xFFFFFFFF - 0xFFFF  # of a log that a request can reach
_DATAGRAM_BYTES: Final = 2048
_GONE_S: Final = 2.0
_SPACING_S: Final = 0.01  # between two datagrams of a tool that are looked at: what it sends faster waits in the socket


def question(frame: Frame) -> bool:
    """Whether a frame only asks, so that a tool may send it."""
    if frame.message_id not in _QUESTIONS:
        return False
    if frame.message_id in (mavlink.MAVLINK_MSG_ID_COMMAND_LONG, mavlink.MAVLINK_MSG_ID_COMMAND_INT):
        return decode_cold(frame).command in _ASKING_COMMANDS
    return True


class _LogRequest(NamedTuple):
    """What is still to be asked of a log for a tool."""

    system_id: int
    component_id: int
    sequence: int
    values: tuple[int, ...]  # of LOG_REQUEST_DATA, in wire order

    @classmethod
    def of(cls, frame: Frame) -> _LogRequest:
        return cls(frame.system_id, frame.component_id, frame.sequence, _REQUEST_DATA.unpack(frame.payload))

    def split(self, frames: int) -> tuple[bytes, _LogRequest | None]:
        """The frame that asks for the first burst of so many frames, and what is left."""
        offset, count = self.values[_OFFSET], self.values[_COUNT]
        piece = min(count, frames * DATA_BYTES)

        def values(begin: int, length: int) -> tuple[int, ...]:
            changed = {_OFFSET: begin, _COUNT: length}
            return tuple(changed.get(index, value) for index, value in enumerate(self.values))

        encoder = Encoder(_REQUEST_DATA, self.system_id, self.component_id)
        frame = encoder.encode(self.sequence, *values(offset, piece))
        left = values(offset + piece, count - piece)
        end = count == piece or offset + piece > _LAST_OFFSET
        return frame, None if end else self._replace(sequence=self.sequence + 1 & 255, values=left)


class ToolServer:
    """The flying process's side. `pace`: of the bursts in which a log is asked for.

    Only this user and root get in. Attributes: `attached` whether a tool is there; `refused` frames of its.
    Raises `LinkError` with one line where it cannot be opened, or lies where somebody else may have put it.
    """

    def __init__(self, path: Path, pace: Pace = ON_A_LINE) -> None:
        self.path = path
        self._pace = pace
        self.attached = False
        self.refused = 0
        self._tool: str | bytes = ""
        self._heard_s = self._log_s = self._look_s = 0.0
        self._log: _LogRequest | None = None
        self._parser = FrameParser()
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
        try:
            path.parent.mkdir(mode=0o700, exist_ok=True)
            refused = refusal(path.parent, mine=True)
            if refused is not None:
                raise PermissionError(0, refused)
            path.unlink(missing_ok=True)  # who owns the link owns the socket: what lies there was left behind
            os.fchmod(self._socket.fileno(), 0o600)  # before it has a name, so that nobody is quicker
            self._socket.bind(str(path))
            ask_who_sends(self._socket)
        except OSError as error:
            self._socket.close()
            raise LinkError(f"{path}: cannot open the socket for tools: {error.strerror or error}") from None

    def offer(self, frames: Iterable[Frame]) -> None:
        """Hand the tool what is not hot of the vehicle's frames; what it does not take is lost."""
        for frame in frames:
            if frame.message_id in COLD:
                try:
                    self._socket.sendto(frame.raw, self._tool)
                except BlockingIOError:
                    pass
                except OSError:
                    self.attached = False

    def asked(self, now_s: float) -> bytes:
        """The next frame to be sent for the tool, empty for none. Never waits; call it after the set-point is out."""
        return self._question(now_s) or self._burst(now_s)  # a question may be the end of a log

    def _burst(self, now_s: float) -> bytes:
        if self._log is None or now_s - self._log_s < self._pace.interval_s:
            return b""
        self._log_s = now_s
        frame, self._log = self._log.split(self._pace.burst_frames)
        return frame

    def _question(self, now_s: float) -> bytes:
        if self._look_s <= now_s < self._look_s + _SPACING_S:
            return b""
        try:
            data, user, sender = receive(self._socket, _DATAGRAM_BYTES)
        except OSError:
            self.attached = self.attached and now_s - self._heard_s < _GONE_S
            return b""
        self._look_s = now_s
        if user not in (os.geteuid(), 0):
            self.refused += 1
            return b""
        if sender != self._tool and self.attached and now_s - self._heard_s < _GONE_S:
            self.refused += 1
            return b""  # one tool at a time
        self._tool, self.attached, self._heard_s = sender, bool(sender), now_s
        frames = self._parser.feed(data)
        if not frames:
            return b""
        if len(frames) > 1 or not question(frames[0]):
            self.refused += 1
            return b""
        number = frames[0].message_id
        if number == _REQUEST_DATA.message_id:
            self._log = _LogRequest.of(frames[0])
            return self._burst(now_s)
        if number == mavlink.MAVLINK_MSG_ID_LOG_REQUEST_END:
            self._log = None
        return frames[0].raw

    def close(self) -> None:
        """Close it and take it away."""
        self._socket.close()
        self.path.unlink(missing_ok=True)
