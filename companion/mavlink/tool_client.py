"""A tool's way to the vehicle while another process has the link: through the socket of its tool server."""

from __future__ import annotations

import hashlib
import os
import socket
import struct
import time
from pathlib import Path
from typing import Final

from companion.mavlink.link import LinkError

_SERVICE_FOLDER: Final = Path("/run/companion")  # RuntimeDirectory= of systemd/companion.service
_DATAGRAM_BYTES: Final = 2048
_HELLO_S: Final = 0.5  # between two empty datagrams that say the tool is still there


def tool_socket(url: str) -> Path:
    """Where the process that has this link opens its socket for tools: a service in its own folder, else its user's."""
    service = os.environ.get("RUNTIME_DIRECTORY")
    return (Path(service) if service else _user_folder()) / _name(url)


def tool_sockets(url: str) -> list[Path]:
    """Where a tool looks for it."""
    return [folder / _name(url) for folder in (_user_folder(), _SERVICE_FOLDER)]


def _user_folder() -> Path:
    runtime = os.environ.get("XDG_RUNTIME_DIR")
    return Path(runtime) if runtime else Path(f"/tmp/companion-{os.getuid()}")


def _name(url: str) -> str:
    return f"companion-{hashlib.sha256(url.encode()).hexdigest()[:12]}.sock"  # a socket's path is short


class ToolLink:
    """A tool's side: a link as any other, to the vehicle of the process that has it."""

    stream = False

    def __init__(self, path: Path, timeout_s: float) -> None:
        self.name = f"unix://{path}"
        self._hello_s = 0.0
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        try:
            self._socket.bind("")  # an address of the kernel's choice, so that there can be an answer
            self._socket.connect(str(path))
        except OSError as error:
            self._socket.close()
            raise LinkError(f"link {self.name}: {error.strerror}") from None
        seconds = int(timeout_s)
        timeout = struct.pack("ll", seconds, int((timeout_s - seconds) * 1e6))
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, timeout)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, timeout)

    def receive(self) -> bytes:
        if time.monotonic() - self._hello_s > _HELLO_S:
            self._hello_s = time.monotonic()
            self.send(b"")
        try:
            return self._socket.recv(_DATAGRAM_BYTES)
        except (BlockingIOError, InterruptedError):
            return b""
        except OSError as error:
            raise LinkError(f"link {self.name}: {error.strerror}") from None

    def send(self, data: bytes) -> None:
        try:
            self._socket.send(data)
        except BlockingIOError:
            pass
        except OSError:
            raise LinkError(f"link {self.name}: the process that has the link has ended") from None

    def lock(self) -> None:
        """A socket has one other side."""

    def close(self) -> None:
        self._socket.close()
