"""A disk of a few bytes, where the machine allows to mount one."""

from __future__ import annotations

import contextlib
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest


@contextlib.contextmanager
def small_disk(size: str) -> Iterator[Path]:
    """Mounted on a folder of its own, of a size as tmpfs takes it; skips the test without the right to."""
    with tempfile.TemporaryDirectory() as name:
        mounted = subprocess.run(
            ["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", name], capture_output=True, check=False
        )
        if mounted.returncode != 0:
            pytest.skip("no right to mount a small disk")
        try:
            yield Path(name)
        finally:
            subprocess.run(["umount", name], check=True)
