"""Logs for the identification: cuts of real ones, mutations of them, and flights of a known vehicle."""

from __future__ import annotations

import lzma
from collections.abc import Callable
from pathlib import Path

import pytest
from harness.identify_logs import Change, mutated_ulog

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[2]
CUTS = ROOT / "tests" / "data"
FULL = ROOT.parent / "shared" / "data"


@pytest.fixture(scope="session")
def cut(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """A cut of a real log by name, unpacked once."""
    folder = tmp_path_factory.mktemp("logs")

    def unpacked(name: str) -> Path:
        path = folder / name
        if not path.exists():
            path.write_bytes(lzma.decompress((CUTS / f"{name}.xz").read_bytes()))
        return path

    return unpacked


@pytest.fixture
def bad_ulog(cut: Callable[[str], Path], tmp_path: Path) -> Callable[[Change], Path]:
    """The p4 log with something done to its data."""

    def made(change: Change) -> Path:
        return mutated_ulog(cut("px4_sih_attitude_p4.ulg"), tmp_path / "bad.ulg", change)

    return made
