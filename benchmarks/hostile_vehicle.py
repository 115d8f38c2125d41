"""The vehicle of a flight under hostile inputs: on a socket or a terminal, signing where there is a key."""

from __future__ import annotations

import contextlib
import os
import tty
from typing import Any

from autopilot import Autopilot
from pymavlink.dialects.v20 import development as mavlink

from companion.mavlink.codec import FrameParser
from companion.mavlink.px4 import Mode
from companion.mavlink.signing import Signing

KEY = bytes(range(1, 33))
_RATE_HZ = 250.0
_OTHER_LINK = 4  # link id of a recording of the vehicle's other radio


class Terminal:
    """One end of a pseudo-terminal, used like a socket: a frame at a time."""

    def __init__(self) -> None:
        self.fd, self._far = os.openpty()
        for fd in (self.fd, self._far):
            tty.setraw(fd)
        os.set_blocking(self.fd, False)
        self.name = os.ttyname(self._far)
        self._parser = FrameParser(stream=True)
        self._frames: list[bytes] = []

    def fileno(self) -> int:
        return self.fd

    def send(self, data: bytes) -> None:
        with contextlib.suppress(BlockingIOError):  # nobody reads: lost, as on a line
            os.write(self.fd, data)

    def recv(self, _size: int, _flags: int = 0) -> bytes:
        if not self._frames:
            self._frames = [frame.raw for frame in self._parser.feed(os.read(self.fd, 65536))]
        return self._frames.pop(0) if self._frames else b""

    def close(self) -> None:
        os.close(self.fd)
        os.close(self._far)


class Vehicle(Autopilot):
    """The scripted autopilot, on a socket or a terminal, signing where there is a key; keeps what it sent last.

    Attributes: `reflects`, whether it sends back what it hears, as a router that loops does; `reflected` so many.
    """

    def __init__(self, port: int, *, terminal: Terminal | None, signing: Signing | None) -> None:
        super().__init__(port)
        self._signing = signing
        self.sent: list[bytes] = []
        self.reflects = False
        self.reflected = 0
        self._to_reflect: list[bytes] = []
        if terminal is not None:
            self._socket.close()
            self._socket = terminal  # type: ignore[assignment]

    def fileno(self) -> int:
        return self._socket.fileno()

    def _sample(self, rate_hz: float) -> bytes:
        return self._signed(super()._sample(rate_hz))

    def _put(self, frame: bytes) -> None:
        super()._put(frame if frame[2] else self._signed(frame))

    def recording(self, samples: int) -> list[bytes]:
        """Signed frames as they were before the flight: of this link, and of another that says Hold."""
        assert self._signing is not None
        other = Signing(KEY, link_id=_OTHER_LINK)
        frames = []
        for _ in range(samples):
            frames += [self._sample(_RATE_HZ), self._signed(self.pack(self.heartbeat()))]
            frames.append(self._signed(self.pack(self.current_mode())))
            mode, self.mode = self.mode, Mode.HOLD
            frames += [other.sign(self.pack(word)) for word in (self.heartbeat(), self.current_mode())]
            self.mode = mode
        return frames

    def react(self, message: Any) -> None:
        super().react(message)
        if message.get_type() == "TIMESYNC" and message.tc1 == 0:
            self.answers.append(mavlink.MAVLink_timesync_message(self._time_us * 1000, message.ts1))

    def _receive(self, flags: int = 0) -> bytes:
        data = super()._receive(flags)
        if data and self.reflects:
            self._to_reflect.append(data)
        return data

    def _beside(self) -> None:
        super()._beside()
        for data in self._to_reflect:
            with contextlib.suppress(ConnectionRefusedError):
                self._socket.send(data)
        self.reflected += len(self._to_reflect)
        self._to_reflect.clear()

    def _signed(self, frame: bytes) -> bytes:
        if self._signing is not None:
            frame = self._signing.sign(frame)
        self.sent = [*self.sent[-400:], frame]
        return frame
