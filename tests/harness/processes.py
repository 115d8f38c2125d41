"""The one runner of processes: `companion` as a person starts it, and the plant it serves.

A time limit here is for what hangs, never for what is slow: a busy machine must not fail a test.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import pytest

ROOT: Final = Path(__file__).resolve().parents[2]
RIG: Final = ROOT / "config" / "antx_rig.yaml"
PATIENCE_S: Final = 120.0

Process = subprocess.Popen[str]

# For flights by the wall clock on a machine that does other things as well.
PATIENT: Final = (
    "--set", "guards.link_jitter_s.enabled=false", "--set", "guards.tick_overrun_s.enabled=false",
    "--set", "guards.pose_age_s.limit=1.0", "--set", "guards.pose_rate_hz.enabled=false",
    "--set", "guards.clock_jump_s.limit=1.0", "--set", "guards.link_delay_s.enabled=false",
)  # fmt: skip


def start(*arguments: object, stdout: Any = subprocess.PIPE, cwd: Path = ROOT) -> Process:
    """`companion` with these arguments, running."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-u", "-m", "companion", *map(str, arguments)]
    return subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=stdout,
        stderr=subprocess.PIPE,
        text=True,
        cwd=cwd,
        env=environment,
    )


def finish(*arguments: object, timeout_s: float = PATIENCE_S, cwd: Path = ROOT) -> subprocess.CompletedProcess[str]:
    """`companion` with these arguments, ended."""
    process = start(*arguments, cwd=cwd)
    out, err = end_of(process, timeout_s)
    return subprocess.CompletedProcess(process.args, process.returncode, out, err)


def end_of(process: Process, timeout_s: float = PATIENCE_S) -> tuple[str, str]:
    """The rest of its output and its complaints, when it has ended; it must end by itself."""
    try:
        return process.communicate(timeout=timeout_s)
    except subprocess.TimeoutExpired:
        process.kill()
        out, err = process.communicate()
        pytest.fail(f"{process.args} did not end within {timeout_s:g} s: {out} {err}")


def lines_until(process: Process, pattern: str, timeout_s: float = PATIENCE_S) -> list[str]:
    """Lines of its output up to the first that matches."""
    assert process.stdout is not None
    lines: list[str] = []
    hangs = threading.Timer(timeout_s, process.kill)  # `select` would not see lines that are in the buffer already
    hangs.start()
    try:
        for line in process.stdout:
            lines.append(line)
            if re.search(pattern, line):
                return lines
    finally:
        hangs.cancel()
    complaints = process.stderr.read() if process.stderr else ""
    pytest.fail(f"ended without {pattern!r}: {lines} {complaints}")


def line_with(process: Process, pattern: str, timeout_s: float = PATIENCE_S) -> str:
    """The first line of its output that matches."""
    return lines_until(process, pattern, timeout_s)[-1]


def eventually(happened: Any, timeout_s: float = PATIENCE_S) -> bool:
    """Whether something that another process or thread does came to be so."""
    until_s = time.monotonic() + timeout_s
    while not happened():
        if time.monotonic() > until_s:
            return False
        time.sleep(0.02)
    return True


def stop(process: Process) -> None:
    """End it, however it stands, and let go of its pipes."""
    if process.poll() is None:
        process.kill()
    process.communicate()


@contextmanager
def plant(*arguments: object, config: Path = RIG) -> Iterator[Process]:
    """`companion sitl --serve`."""
    process = start("sitl", config, "--serve", *arguments)
    try:
        yield process
    finally:
        process.terminate()
        end_of(process)


@contextmanager
def served(*arguments: object, config: Path = RIG) -> Iterator[int]:
    """The same on any free UDP port: which."""
    with plant("--port", 0, *arguments, config=config) as process:
        yield int(line_with(process, "udp port").rsplit(maxsplit=1)[-1])


def folder_of(line: str) -> Path:
    """The flight folder, from the line in which `companion run` tells it."""
    match = re.search(r"log (\S+)", line)
    assert match
    return Path(match[1])
