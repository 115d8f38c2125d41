"""How much of a disk flights may take: a quota for all of them, and a floor of free space. The oldest go first.

A flight is a folder beside the current one that has the name and the files of one. One that is being written is locked
by its writer and never touched, nor is one in which there is a file `keep`; other people's files stay where they are.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Final

LOGS: Final = ("traffic.tlog", "flight.mcap")
KEEP: Final = "keep"
_FILES: Final = (*LOGS, "config.yaml")
_NAME: Final = re.compile(r"\d{4}-\d\d-\d\dT\d\d-\d\d-\d\d-.+")  # as `folder.new_folder` calls it
_GB: Final = 1e9


def lock(log: IO[bytes]) -> None:
    """While it is open, nobody makes room by deleting it."""
    with contextlib.suppress(OSError):  # nowhere, or on a file system without locks
        fcntl.flock(log.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)


class Quota:
    """Of the flights beside `current`, in bytes: what they may take with it, and what must be left free."""

    def __init__(self, current: Path, quota: int, free: int) -> None:
        self._current, self._quota, self._free = current.resolve(), quota, free

    def make_room(self) -> str | None:
        """Delete the oldest flights until both are kept. What is not kept even so, for a person, or None."""
        flights = self._flights()
        while (passed := self._passed()) is not None:
            oldest = next(flights, None)
            if oldest is None:
                return passed
            if _delete(oldest):
                print(f"{oldest}: deleted, it was the oldest flight: {passed}", file=sys.stderr)
        return None

    def _passed(self) -> str | None:
        with contextlib.suppress(OSError):
            if shutil.disk_usage(self._current).free < self._free:
                return f"less than log.free_gb ({self._free / _GB:g} GB) is free"
        if sum(map(_size, (*self._flights(), self._current))) > self._quota:
            return f"the flights take more than log.quota_gb ({self._quota / _GB:g} GB)"
        return None

    def _flights(self) -> Iterator[Path]:
        """All others, the oldest first."""
        parent = self._current.parent
        names: list[str] = []
        with contextlib.suppress(OSError):
            names = sorted(name for name in os.listdir(parent) if _NAME.fullmatch(name))
        for folder in (parent / name for name in names):
            if folder != self._current and not folder.is_symlink() and any((folder / log).is_file() for log in LOGS):
                yield folder


def _size(folder: Path) -> int:
    total = 0
    for name in _FILES:
        with contextlib.suppress(OSError):
            total += (folder / name).lstat().st_blocks * 512
    return total


def _delete(folder: Path) -> bool:
    """Delete a flight, unless it is kept or being written; whether it was."""
    if (folder / KEEP).exists() or _being_written(folder):
        return False
    try:
        for name in _FILES:
            (folder / name).unlink(missing_ok=True)
    except OSError:
        return False
    with contextlib.suppress(OSError):  # there is something else in it
        folder.rmdir()
    return True


def _being_written(folder: Path) -> bool:
    for name in LOGS:
        try:
            with (folder / name).open("rb") as log:
                fcntl.flock(log.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)
        except FileNotFoundError:
            continue
        except OSError:
            return True  # or it cannot be known
    return False
