"""A tool's way to the vehicle while another process has the link: through the socket of its tool server."""

from __future__ import annotations

import errno
import hashlib
import os
import socket
import struct
import time
from pathlib import Path
from typing import Final

from companion.mavlink.link import LinkError
from companion.mavlink.socket_owner import ask_who_sends, receive, refusal

_SERVICE_FOLDER: Final = Path("/run/companion")  # RuntimeDirectory= of systemd/companion.service
_DATAGRAM_BYTES: Final = 2048
_HELLO_S: Final = 0.5  # between two empty datagrams that say the tool is still there


def tool_socket(url: str) -> Path:
    """Where the process that has this link opens its socket for tools: a service in its own folder, else its user's."""
    service = os.environ.get("RUNTIME_DIRECTORY")
    return (Path(service) if service else _user_folder()) / _name(url)


def tool_sockets(url: str) -> list[tuple[Path, bool]]:
    """Where a tool looks for it, and whether it must be this user's own there, or root's."""
    return [(_user_folder() / _name(url), True), (_SERVICE_FOLDER / _name(url), False)]


def _user_folder() -> Path:
    runtime = os.environ.get("XDG_RUNTIME_DIR")
    return Path(runtime) if runtime else Path(f"/tmp/companion-{os.getuid()}")


def _name(url: str) -> str:
    return f"companion-{hashlib.sha256(url.encode()).hexdigest()[:12]}.sock"  # a socket's path is short


class UntrustedSocketError(LinkError):
    """A socket that somebody else may have made."""


class ToolLink:
    """A tool's side: a link as any other, to the vehicle of the process that has it.

    With a key that process alone verifies what comes, so it is believed only where nobody but its user, or root, can
    have made the socket. `mine`: that user must be this one, or root. Raises `LinkError`.
    """

    stream = False

    def __init__(self, path: Path, timeout_s: float, *, mine: bool = False) -> None:
        self.name = f"unix://{path}"
        self._hello_s = 0.0
        if not path.exists():
            raise LinkError(f"link {self.name}: {os.strerror(errno.ENOENT)}")
        refused = refusal(path.parent, mine=mine)
        if refused is not None:
            raise UntrustedSocketError(f"link {self.name}: not believed: {refused}")
        self._users = {os.geteuid(), 0, path.parent.stat().st_uid}
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        try:
            ask_who_sends(self._socket)
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
            data, user, _ = receive(self._socket, _DATAGRAM_BYTES)
        except (BlockingIOError, InterruptedError):
            return b""
        except OSError as error:
            raise LinkError(f"link {self.name}: {error.strerror}") from None
        return data if user in self._users else b""

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
