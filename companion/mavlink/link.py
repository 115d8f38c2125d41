"""The bytes' way out: UDP or a serial line, owned by this process alone.

udpin://0.0.0.0:14540                 listen; talk to whoever proves to be the autopilot
udpout://127.0.0.1:14580              talk to that address only
serial:///dev/ttyAMA0:921600          a tty
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import re
import select
import socket
import struct
import termios
from typing import Protocol

import serial

from companion.errors import CompanionError

_DATAGRAM_BYTES = 2048
_MOST_QUEUED = 4096  # datagrams that a socket can hold at its largest
_QUEUE_BYTES = 1 << 20
_QUEUED_BYTES = 280  # on a serial line: one frame
_PASSING = (
    errno.ENOBUFS,
    errno.ENETUNREACH,
    errno.EHOSTUNREACH,
    errno.ENETDOWN,
    errno.EPERM,
)  # a network may come back
_URL = re.compile(r"(?P<kind>udpin|udpout|serial)://(?P<place>.+):(?P<number>[0-9]+)")


class LinkError(CompanionError):
    """A link that cannot be opened or has gone; the message is one line for a person."""


class Link(Protocol):
    """A blocking byte link with a receive timeout."""

    stream: bool  # bytes without datagram borders
    name: str

    def receive(self) -> bytes:
        """The next bytes; empty when the timeout passed. Raises `LinkError` when the link has gone."""

    def send(self, data: bytes) -> None:
        """Send one frame; silently lost when nobody is there to take it, as on any radio."""

    def lock(self) -> None:
        """From now on hear and answer only the sender of the last bytes."""

    def close(self) -> None:
        """Release the socket or the tty."""


class UdpLink:
    """A UDP socket that is connected from the start (`udpout`) or once the peer is known (`udpin`)."""

    stream = False

    def __init__(self, name: str, timeout_s: float, *, bind: tuple[str, int] | None, peer: tuple[str, int] | None):
        self.name = name
        self._sender: tuple[str, int] | None = None
        self._queued: list[bytes] = []  # by the peer, when it was locked
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            # No SO_REUSEADDR: with it a second listener would silently steal every datagram.
            if bind is not None:
                self._socket.bind(bind)
            if peer is not None:
                self._socket.connect(peer)
        except OSError as error:
            self._socket.close()
            hint = "the port is in use: stop the other listener" if error.errno == errno.EADDRINUSE else error.strerror
            raise LinkError(f"link {name}: {hint}") from None
        self._locked = peer is not None
        # A kernel timeout costs one system call a receive, where Python's own would poll first.
        timeout_s = max(timeout_s, 1e-3)  # all zero would mean for ever
        seconds = int(timeout_s)
        timeout = struct.pack("ll", seconds, int((timeout_s - seconds) * 1e6))
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, timeout)
        # As much as the system allows: what a flood leaves no room for is lost, the vehicle's frames too.
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _QUEUE_BYTES)

    def receive(self) -> bytes:
        if self._queued:
            return self._queued.pop(0)
        try:
            if self._locked:
                return self._socket.recv(_DATAGRAM_BYTES)
            data, self._sender = self._socket.recvfrom(_DATAGRAM_BYTES)
            return data
        except (BlockingIOError, InterruptedError, ConnectionRefusedError):
            return b""
        except OSError as error:
            if error.errno in _PASSING:
                return b""
            raise LinkError(f"link {self.name}: {error.strerror}") from None

    def waiting(self, most: int) -> list[bytes]:
        """Up to so many datagrams of the peer that are here already. Never waits, never raises."""
        data: list[bytes] = []
        if self._locked:
            receive = self._socket.recv
            with contextlib.suppress(OSError):  # none any more; what else it may be, `receive` says
                for _ in range(most):
                    data.append(receive(_DATAGRAM_BYTES, socket.MSG_DONTWAIT))
        return data

    def send(self, data: bytes) -> None:
        try:
            if self._locked:
                self._socket.send(data)
            elif self._sender is not None:
                self._socket.sendto(data, self._sender)
        except (BlockingIOError, ConnectionRefusedError):
            pass
        except OSError as error:
            if error.errno not in _PASSING:
                raise LinkError(f"link {self.name}: {error.strerror}") from None

    def lock(self) -> None:
        peer = self._sender
        if self._locked or peer is None:
            return
        self._socket.connect(peer)
        self._locked = True
        with contextlib.suppress(OSError):  # the kernel sorts what comes from now on, not what is queued already
            for _ in range(_MOST_QUEUED):
                data, sender = self._socket.recvfrom(_DATAGRAM_BYTES, socket.MSG_DONTWAIT)
                if sender == peer:
                    self._queued.append(data)

    def close(self) -> None:
        self._socket.close()


class SerialLink:
    """A tty, opened raw at its baud rate by pyserial and then read without it."""

    stream = True

    def __init__(self, name: str, timeout_s: float, *, device: str, baud: int) -> None:
        self.name = name
        try:
            self._tty = serial.Serial(device, baud, timeout=0, exclusive=True)
        except (OSError, ValueError, OverflowError) as error:
            reason = os.strerror(error.errno) if isinstance(error, OSError) and error.errno else str(error)
            raise LinkError(f"link {name}: cannot open {device}: {reason}") from None
        self._fd: int = self._tty.fileno()
        self._poll = select.poll()
        self._poll.register(self._fd, select.POLLIN)
        self._timeout_ms = max(1, round(timeout_s * 1e3))
        self._unsent = b""

    def receive(self) -> bytes:
        try:
            if not self._poll.poll(self._timeout_ms):
                return b""
            data = os.read(self._fd, _DATAGRAM_BYTES)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise LinkError(f"link {self.name}: {error.strerror}") from None
        if not data:
            raise LinkError(f"link {self.name}: the device has gone")
        return data

    def send(self, data: bytes) -> None:
        try:
            (queued,) = struct.unpack("i", fcntl.ioctl(self._fd, termios.TIOCOUTQ, b"\0\0\0\0"))
            if queued > _QUEUED_BYTES:
                return  # too slow a line: a set-point that waits there would be flown when it is old
            if self._unsent:  # the rest of a frame that the line took in part comes first, or both are lost
                self._unsent = self._unsent[os.write(self._fd, self._unsent) :]
            if not self._unsent:
                self._unsent = data[os.write(self._fd, data) :]
        except BlockingIOError:
            pass  # the line is full: an old set-point is worth nothing, the next one follows
        except OSError as error:
            raise LinkError(f"link {self.name}: {error.strerror}") from None

    def lock(self) -> None:
        """A line has one other end."""

    def close(self) -> None:
        with contextlib.suppress(OSError):
            self._tty.close()


def open_link(url: str, timeout_s: float = 0.02) -> Link:
    """Open `udpin://host:port`, `udpout://host:port` or `serial://device:baud`.

    `timeout_s` bounds how long `receive` blocks. Raises `LinkError` with one line that says what to do.
    """
    match = _URL.fullmatch(url)
    if match is None:
        raise LinkError(
            f"link {url}: not a link URL (udpin://0.0.0.0:14540, udpout://host:14580 or serial:///dev/ttyAMA0:921600)"
        )
    kind, place, number = match["kind"], match["place"], int(match["number"])
    if kind == "serial":
        if number == 0:
            raise LinkError(f"link {url}: 0 is not a baud rate")
        return SerialLink(url, timeout_s, device=place, baud=number)
    if not 0 < number < 65536:
        raise LinkError(f"link {url}: {number} is not a UDP port")
    try:
        address = (socket.gethostbyname(place), number)
    except (OSError, UnicodeError):
        raise LinkError(f"link {url}: no such host {place}") from None
    if kind == "udpin":
        return UdpLink(url, timeout_s, bind=address, peer=None)
    return UdpLink(url, timeout_s, bind=None, peer=address)
