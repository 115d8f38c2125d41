"""The newest time stamps of signed streams, kept from one run to the next: a recording stays old over a restart.

A file for each key, of this user alone, in its folder for state. It is replaced as a whole: what is written is on the
disk before it takes the old one's name. A file that cannot be read or is not ours is said to be so in one line, and
nothing of it is believed: then a stream is as old as this process, and the vehicle must prove itself as ever.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import re
import stat
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from companion.mavlink.signing import Stream

_MOST_BYTES: Final = 1 << 20
_NAME: Final = re.compile(r"(\d{1,3})/(\d{1,3})/(\d{1,3})", re.ASCII)  # system, component, link id
_LAST_STAMP: Final = 2**48 - 1


def stamps_file(key: bytes) -> Path:
    """Where the stamps of a key are kept: the service manager's folder for state, or else the user's."""
    state = os.environ.get("STATE_DIRECTORY", "").split(":")[0] or os.environ.get("XDG_STATE_HOME")
    folder = Path(state) if state else Path.home() / ".local" / "state"
    return folder / "companion" / f"signing-{hashlib.sha256(b'stamps' + key).hexdigest()[:16]}.json"


def read_stamps(path: Path) -> tuple[dict[Stream, int], str | None]:
    """What was kept, and a complaint as one line or None. Nothing kept is no complaint."""
    try:
        fd = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
        with open(fd, "rb") as stream:
            status = os.fstat(fd)
            if not stat.S_ISREG(status.st_mode) or status.st_uid != os.geteuid() or status.st_mode & 0o077:
                return {}, f"{path}: not a file of this user alone, so not believed: remove it"
            text = stream.read(_MOST_BYTES)
        return _parsed(text), None
    except FileNotFoundError:
        return {}, None
    except OSError as error:
        return {}, f"{path}: {error.strerror}: the time stamps of the last run are not known"
    except (ValueError, RecursionError):
        return {}, f"{path}: damaged: the time stamps of the last run are not known, it is written anew"


def write_stamps(path: Path, stamps: Mapping[Stream, int]) -> str | None:
    """Keep them; a complaint as one line, or None. The file is whole at every moment, the old one or the new."""
    text = json.dumps({"{}/{}/{}".format(*stream): stamp for stream, stamp in sorted(stamps.items())})
    made = ""
    try:
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        fd, made = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")  # 0600, and nobody else's
        with open(fd, "w", encoding="utf-8") as stream:
            stream.write(text)
            stream.flush()
            os.fsync(fd)
        os.replace(made, path)
        folder = os.open(path.parent, os.O_RDONLY | os.O_DIRECTORY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)
    except OSError as error:
        with contextlib.suppress(OSError):
            os.unlink(made)
        return f"{path}: the time stamps of this run cannot be kept: {error.strerror}"
    return None


def _parsed(text: bytes) -> dict[Stream, int]:
    """The file's content. Raises `ValueError`."""
    read = json.loads(text)
    if not isinstance(read, dict):
        raise ValueError("not an object")
    stamps: dict[Stream, int] = {}
    for name, stamp in read.items():
        match = _NAME.fullmatch(name)
        if match is None or type(stamp) is not int or not 0 <= stamp <= _LAST_STAMP:
            raise ValueError("not a stream")
        system, component, link_id = (int(part) for part in match.groups())
        if max(system, component, link_id) > 255:
            raise ValueError("not a stream")
        stamps[system, component, link_id] = stamp
    return stamps
