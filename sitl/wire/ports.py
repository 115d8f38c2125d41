"""The wires of the plant: UDP as PX4 speaks it, and a serial line."""

from __future__ import annotations

import contextlib
import errno
import os
import select
import socket
import struct
import time
from typing import Final, NamedTuple, Protocol

import serial

from sitl.messages.streams import Profile

RECEIVE_BYTES: Final = 65_536
DATAGRAM_BYTES: Final = 1_400
BLOCK_S: Final = 0.05
GONE_S: Final = 0.01
SOCKET_BUFFER_BYTES: Final = 1 << 20
NOBODY: Final = 9  # the discard port: a plant that calls it reaches nobody


class UdpEndpoint(NamedTuple):
    """A UDP port as PX4 opens it (`mavlink start -u PORT -o REMOTE_PORT`)."""

    port: int = 14580  # 0 lets the system choose
    remote_port: int = 14540
    profile: Profile = Profile.ONBOARD
    host: str = "127.0.0.1"


class SerialEndpoint(NamedTuple):
    """A serial device or pseudo-terminal."""

    device: str
    baud_rate: int = 921_600
    profile: Profile = Profile.ONBOARD


Endpoint = UdpEndpoint | SerialEndpoint

GROUND_STATION: Final = UdpEndpoint(18570, 14550, Profile.GROUND_STATION)


def parse_serial(url: str) -> SerialEndpoint:
    """`serial:///dev/ttyUSB0:921600` as an endpoint. Raises `ValueError` for anything else."""
    scheme, _, rest = url.partition("://")
    device, _, baud = rest.rpartition(":")
    if scheme != "serial" or not device.startswith("/") or not baud.isdigit():
        raise ValueError(f"not a serial link: {url!r} (expected serial:///dev/NAME:BAUD)")
    return SerialEndpoint(device, int(baud))


class Port(Protocol):
    """One wire."""

    stream: bool  # whether frames may come in pieces

    @property
    def connected(self) -> bool:
        """Whether anybody has been heard."""

    @property
    def number(self) -> int:
        """UDP port, 0 for a serial line."""

    def fileno(self) -> int: ...

    def receive(self) -> bytes:
        """What has come; empty for nothing. Never waits."""

    def receive_waiting(self) -> bytes:
        """The next that comes; empty after `BLOCK_S` of silence."""

    def send(self, frames: list[bytes]) -> None:
        """Send whole frames; what the wire does not take is lost, as on a real one."""

    def close(self) -> None: ...


def batches(frames: list[bytes]) -> list[list[bytes]]:
    """Whole frames, by the datagram that they go into: as few as hold them."""
    if sum(map(len, frames)) <= DATAGRAM_BYTES:
        return [frames]
    full: list[list[bytes]] = []
    batch: list[bytes] = []
    size = 0
    for frame in frames:
        if batch and size + len(frame) > DATAGRAM_BYTES:
            full.append(batch)
            batch, size = [], 0
        batch.append(frame)
        size += len(frame)
    return [*full, batch]


class UdpPort:
    """A UDP socket that talks to localhost's `remote_port` until it hears somebody, and to nobody else after that.

    The port is bound without SO_REUSEADDR, under which a second listener would steal every datagram. Raises `OSError`
    that names the port where it is busy.
    """

    stream = False

    def __init__(self, endpoint: UdpEndpoint) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind((endpoint.host, endpoint.port))
        except OSError as error:
            self._socket.close()
            busy = error.errno == errno.EADDRINUSE
            reason = "is busy: another plant or autopilot has it" if busy else f"cannot be opened: {error.strerror}"
            raise OSError(error.errno, f"UDP port {endpoint.port} {reason}") from error
        timeout = struct.pack("@ll", 0, int(1e6 * BLOCK_S))
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, timeout)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, SOCKET_BUFFER_BYTES)
        self._peer: tuple[str, int] = ("127.0.0.1", endpoint.remote_port)
        self._receive = self._socket.recvfrom
        self._send = self._socket.sendto
        self.connected = False

    @property
    def number(self) -> int:
        port: int = self._socket.getsockname()[1]
        return port

    def fileno(self) -> int:
        return self._socket.fileno()

    def receive(self) -> bytes:
        return self._from(socket.MSG_DONTWAIT)

    def receive_waiting(self) -> bytes:
        return self._from(0)

    def _from(self, flags: int) -> bytes:
        try:
            data, sender = self._receive(RECEIVE_BYTES, flags)
        except (BlockingIOError, ConnectionError):
            return b""
        if not self.connected:
            self.connected = True
            self._peer = sender
        return data

    def send(self, frames: list[bytes]) -> None:
        for batch in batches(frames):
            with contextlib.suppress(OSError):  # nobody there, or no room: a datagram is lost
                self._send(b"".join(batch), self._peer)

    def close(self) -> None:
        self._socket.close()


class SerialPort:
    """A serial line or pseudo-terminal. Raises `OSError` that names the device where it cannot be opened."""

    stream = True
    number = 0

    def __init__(self, endpoint: SerialEndpoint) -> None:
        try:
            self._line = serial.Serial(endpoint.device, endpoint.baud_rate, timeout=BLOCK_S)
        except serial.SerialException as error:
            raise OSError(error.errno, f"serial device {endpoint.device} cannot be opened: {error}") from error
        self._descriptor: int = self._line.fileno()
        os.set_blocking(self._descriptor, False)
        self._unsent = b""
        self.connected = False

    def fileno(self) -> int:
        return self._descriptor

    def receive(self) -> bytes:
        try:
            data = os.read(self._descriptor, RECEIVE_BYTES)
        except BlockingIOError:
            return b""
        except OSError:
            data = b""
        if not data:
            time.sleep(GONE_S)  # the other end of a pseudo-terminal is closed: readable for ever, with nothing in it
        self.connected = self.connected or bool(data)
        return data

    def receive_waiting(self) -> bytes:
        readable, _, _ = select.select([self._descriptor], [], [], BLOCK_S)
        return self.receive() if readable else b""

    def send(self, frames: list[bytes]) -> None:
        if self._unsent:
            self._unsent = self._write(self._unsent)
        if not self._unsent:  # otherwise the line is full: whole frames are lost
            self._unsent = self._write(b"".join(frames))

    def _write(self, data: bytes) -> bytes:
        try:
            return data[os.write(self._descriptor, data) :]
        except OSError:
            return b""

    def close(self) -> None:
        self._line.close()


def open_port(endpoint: Endpoint) -> Port:
    """Open an endpoint. Raises `OSError` with one clear line."""
    return UdpPort(endpoint) if isinstance(endpoint, UdpEndpoint) else SerialPort(endpoint)
