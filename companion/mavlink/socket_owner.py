"""Whose a Unix socket is: the folder it lies in, and the user behind each datagram.

Whoever makes the folder makes what is said through the socket. So both sides look at the folder, up to the root, before
they open anything in it, and the kernel tells both by whom a datagram was sent.

Source: unix(7), SO_PASSCRED and SCM_CREDENTIALS.
"""

from __future__ import annotations

import os
import socket
import stat
import struct
from pathlib import Path
from typing import Any, Final

_CREDENTIALS: Final = struct.Struct("iII")  # struct ucred: process, user, group
_ROOT: Final = 0
_OTHERS_MAY_WRITE: Final = stat.S_IWGRP | stat.S_IWOTH


def refusal(folder: Path, *, mine: bool, user: int | None = None) -> str | None:
    """Why nothing in a folder is to be believed, as one line; None where nobody but its owner can have put it there.

    `mine`: it must be this user's own, or root's; otherwise any owner will do whom root, or this user, has given the
    folder. `user`: this user, by default the process's own.
    """
    me = os.geteuid() if user is None else user
    above = Path(os.path.realpath(folder.parent))
    try:
        status = folder.lstat()
        places = [(place, place.stat()) for place in (above, *above.parents)]
    except OSError as error:
        return f"{folder}: {error.strerror}"
    if not stat.S_ISDIR(status.st_mode):
        return f"{folder} is no folder"
    if status.st_mode & _OTHERS_MAY_WRITE:
        return f"{folder} may be written by others: chmod go-w {folder}"
    anybody_makes = bool(places[0][1].st_mode & _OTHERS_MAY_WRITE)  # as in /tmp
    if (mine or anybody_makes) and status.st_uid not in (me, _ROOT):
        return f"{folder} belongs to somebody else, user {status.st_uid}"
    for place, above_it in places:
        if above_it.st_uid not in (me, _ROOT):
            return f"{place}, above {folder}, belongs to somebody else, user {above_it.st_uid}"
        if above_it.st_mode & _OTHERS_MAY_WRITE and not above_it.st_mode & stat.S_ISVTX:
            return f"{place}, above {folder}, may be written by others"
    return None


def ask_who_sends(unix_socket: socket.socket) -> None:
    """From now on every datagram that comes says by whom it was sent."""
    unix_socket.setsockopt(socket.SOL_SOCKET, socket.SO_PASSCRED, 1)


def receive(unix_socket: socket.socket, size: int, flags: int = 0) -> tuple[bytes, int, Any]:
    """One datagram, the user who sent it (-1 for unknown), and the address to answer to. Raises `OSError`."""
    data, told, _, sender = unix_socket.recvmsg(size, socket.CMSG_SPACE(_CREDENTIALS.size), flags)
    for level, kind, content in told:
        if (level, kind) == (socket.SOL_SOCKET, socket.SCM_CREDENTIALS) and len(content) == _CREDENTIALS.size:
            return data, _CREDENTIALS.unpack(content)[1], sender
    return data, -1, sender
