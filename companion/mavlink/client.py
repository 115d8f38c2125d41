"""A tool's side of the link: the configured vehicle's frames in, questions out.

Opened as `companion run` opens it; where that has it already, its socket for tools is used instead.
"""

from __future__ import annotations

import os
import time
from collections import Counter
from pathlib import Path
from typing import Any, Final

from pymavlink.dialects.v20 import development as mavlink

from companion.config import Config
from companion.mavlink.codec import Frame, FrameParser
from companion.mavlink.freshness import FreshSigning
from companion.mavlink.heard import HEARTBEAT, Heard, is_px4
from companion.mavlink.link import Link, LinkError, open_link
from companion.mavlink.signing import read_key
from companion.mavlink.tool_client import ToolLink, UntrustedSocketError, tool_sockets

COMPONENT_ID: Final = mavlink.MAV_COMP_ID_ONBOARD_COMPUTER2  # beside the companion's own 191: never two voices in one

_TIMEOUT_S: Final = 0.02
_HELLO_S: Final = 0.5
_NICE: Final = 10
_TOOL_SOCKET: Final = "unix://"


def open_shared(url: str) -> Link:
    """The link; or, where a process has it already, its socket for tools. Raises `LinkError`.

    That socket comes first: a second socket could be opened beside a `udpout` link, and would never hear a word.
    """
    if url.startswith(_TOOL_SOCKET):
        return ToolLink(Path(url.removeprefix(_TOOL_SOCKET)), _TIMEOUT_S)
    refused = ""
    for path, mine in tool_sockets(url):
        try:
            return ToolLink(path, _TIMEOUT_S, mine=mine)
        except UntrustedSocketError as error:
            refused = f"; {error}"
        except LinkError:
            pass  # none there, or left behind by a process that is no more
    try:
        return open_link(url, _TIMEOUT_S)
    except LinkError as error:
        raise LinkError(f"{error}{refused}") from None


class Client:
    """The vehicle of a config, seen by a tool that flies nothing.

    Attributes: `shared` whether `companion run` has the link and lets us through; `heard` frames of the vehicle by
    message id; `heartbeat` the vehicle's last; `armed` as it told.
    """

    def __init__(self, config: Config, url: str | None = None) -> None:
        self._config = config.link
        self._vehicle = (config.vehicle.system_id, config.vehicle.component_id)
        self._link = open_shared(url or config.link.url)
        self.name = self._link.name
        self.shared = isinstance(self._link, ToolLink)
        key_file = config.link.signing_key_file
        # With it the flying process verifies what comes and signs what goes.
        self._signing = (
            None if key_file is None or self.shared else FreshSigning(read_key(key_file), self._vehicle, self.ids)
        )
        self._parser = FrameParser(stream=self._link.stream)
        self._heard = Heard(self._vehicle, self.ids, stream=self._link.stream)
        self._pymavlink = mavlink.MAVLink(None, srcSystem=config.link.system_id, srcComponent=COMPONENT_ID)
        self._hello_s = 0.0
        self.heard: Counter[int] = Counter()
        self.heartbeat: Frame | None = None
        self.armed = False

    @property
    def vehicle(self) -> tuple[int, int]:
        """System and component id of the autopilot."""
        return self._vehicle

    @property
    def ids(self) -> tuple[int, int]:
        """System and component id of this tool."""
        return self._config.system_id, COMPONENT_ID

    def frames(self) -> list[Frame]:
        """The vehicle's frames among the next bytes of the link; none when its timeout passed. Raises `LinkError`."""
        if self.heartbeat is None and time.monotonic() - self._hello_s > _HELLO_S:
            self._hello()
        data = self._link.receive()
        if self.heartbeat is None:
            self._heard.take(data)
        frames = []
        for frame in self._parser.feed(data):
            if (frame.system_id, frame.component_id) != self._vehicle:
                continue
            if self._signing is not None and not self._signing.verify(frame):
                continue
            if frame.message_id == HEARTBEAT.message_id and not self._on_heartbeat(frame):
                continue
            if self.heartbeat is not None:  # until then it may be anybody
                self.heard[frame.message_id] += 1
                frames.append(frame)
        if self._signing is not None and self._signing.wanted:
            nonce = self._signing.challenge(time.monotonic())
            if nonce is not None:
                self.send(mavlink.MAVLink_timesync_message(0, nonce))
        return frames

    def _on_heartbeat(self, frame: Frame) -> bool:
        """A heartbeat in the vehicle's name; whether it is of a PX4."""
        if not is_px4(frame):
            return False
        if self.heartbeat is None:
            self._link.lock()
            self._hello()
        self.heartbeat = frame
        base_mode = HEARTBEAT.unpack(frame.payload)[HEARTBEAT.index("base_mode")]
        self.armed = bool(base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
        return True

    def send(self, message: Any) -> None:
        """Send a pymavlink message."""
        frame = bytes(message.pack(self._pymavlink))
        self._pymavlink.seq = self._pymavlink.seq + 1 & 255
        self.forward(frame)

    def forward(self, frame: bytes) -> None:
        """Send a whole frame as it is, but for its signature."""
        frame = frame if self._signing is None else self._signing.sign(frame)
        if self.heartbeat is None:
            self._heard.sent(frame)
        self._link.send(frame)

    def give_way(self) -> None:
        """Beside a flight the processor is the flight's first."""
        if self.shared:
            os.nice(_NICE)

    def connect(self) -> None:
        """Wait for the vehicle's heartbeat.

        Raises `LinkError`, which says what was heard instead, when none comes in `link.connect_timeout_s`.
        """
        until_s = time.monotonic() + self._config.connect_timeout_s
        while self.heartbeat is None:
            self.frames()
            if time.monotonic() > until_s:
                signing = self._signing
                refused = 0 if signing is None else signing.refused
                raise LinkError(f"{self.name}: {self._heard.complaint(self._config.connect_timeout_s, refused)}")

    def _hello(self) -> None:
        """PX4 streams to whoever has talked to it. By a ping and not a heartbeat, which it would miss afterwards."""
        self._hello_s = time.monotonic()
        self.send(mavlink.MAVLink_ping_message(time.time_ns() // 1000, 0, 0, 0))

    def close(self) -> None:
        """Release the link."""
        self._link.close()
