"""Standard streams that are closed: nothing but frames goes out on the vehicle's link."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from harness.process_flight import AutopilotOnSocket
from harness.processes import PATIENT, RIG, ROOT, eventually
from harness.virtual_flight import SLOW

from companion.mavlink.codec import FrameParser

STREAMS = ("stdin", "stdout", "stderr")


class Listening(AutopilotOnSocket):
    """Keeps the bytes it hears. Attribute: `datagrams`."""

    def __init__(self) -> None:
        super().__init__()
        self.datagrams: list[bytes] = []

    def hear(self, data: bytes) -> None:
        self.datagrams.append(data)
        super().hear(data)


@contextmanager
def run_with(tmp_path: Path, redirections: str, *settings: str) -> Iterator[tuple[Listening, subprocess.Popen[bytes]]]:
    """`companion run` with its standard streams as a shell leaves them, and the vehicle it flies."""
    vehicle = Listening()
    parts = [part for setting in (*SLOW, *settings) for part in ("--set", setting)]
    link = f"udpout://127.0.0.1:{vehicle.port}"
    arguments = ["run", RIG, "--link", link, "--out", tmp_path, "--uncertified", *parts, *PATIENT]
    process = subprocess.Popen(
        ["sh", "-c", f'exec "$@" {redirections}', "sh", sys.executable, "-m", "companion", *map(str, arguments)],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        yield vehicle, process
    finally:
        process.kill()
        process.wait()
        vehicle.close()


@pytest.mark.realtime
@pytest.mark.parametrize("closed", [(1,), (0, 1, 2)])
def test_closed_standard_streams_are_not_the_vehicle_s_link(tmp_path: Path, closed: tuple[int, ...]) -> None:
    with run_with(tmp_path, " ".join(f"{fd}>&-" for fd in closed)) as (vehicle, process):
        vehicle.start()
        assert eventually(vehicle.setpoints)
        children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
        for pid in (process.pid, *map(int, children)):
            for fd in set(closed) - ({0} if pid != process.pid else set()):  # the writer's input is its pipe
                assert os.readlink(f"/proc/{pid}/fd/{fd}") == os.devnull
        process.terminate()
        assert process.wait(60.0) == 0
    for datagram in vehicle.datagrams:
        parser = FrameParser()
        assert len(list(parser.feed(datagram))) == 1
        assert parser.dropped_bytes == 0


@pytest.mark.parametrize("closed", [(0,), (1,), (2,), (0, 1, 2)])
def test_what_is_told_goes_nowhere_else(closed: tuple[int, ...]) -> None:
    """One line of complaint, to standard error alone, and the same code whatever is closed."""
    streams = " ".join(f"{fd}>&-" for fd in closed)
    command = ["sh", "-c", f'exec "$@" {streams}', "sh", sys.executable, "-m", "companion", "check", "none.yaml"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT)
    complaint = "" if 2 in closed else "companion: none.yaml: no such file\n"
    assert (done.returncode, done.stdout, done.stderr) == (2, "", complaint)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")
@pytest.mark.parametrize("options", [(), ("--json",)])
def test_output_that_cannot_be_written_is_one_line(options: tuple[str, ...]) -> None:
    command = [sys.executable, "-m", "companion", "check", str(RIG), *options]
    with open("/dev/full", "w", encoding="utf-8") as full:
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False, cwd=ROOT)
    complaint = "companion: standard output: No space left on device: not all of it was written"
    assert (done.returncode, done.stderr.splitlines()[-1:], "Traceback" in done.stderr) == (1, [complaint], False)
