"""Which reader reads what is given."""

from __future__ import annotations

from pathlib import Path

from companion.errors import CompanionError
from companion.report import flight, ulog
from companion.report.model import Report


class NothingToReportError(CompanionError):
    """Neither a flight folder nor a ULog."""


def read(path: Path) -> Report:
    """A flight folder of ours, or a PX4 ULog. Raises `CompanionError` with one line."""
    if path.is_dir():
        return flight.read(path)
    if not path.exists():
        raise NothingToReportError(f"{path}: no such file or folder: give a flight folder or a PX4 ULog")
    return ulog.read(path)
