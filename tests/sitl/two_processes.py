"""`companion run` and the plant, each in a process of its own: over UDP, or over a cable that may be unplugged."""

import os
import re
import select
import socket
import subprocess
import sys
import time
import tty
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from pymavlink import mavutil
from running_plant import PATIENT

from companion.record.reader import read_flight

ROOT = Path(__file__).resolve().parents[2]
RIG = ROOT / "config" / "antx_rig.yaml"
SHORT = [
    "--uncertified",  # the certificate of the shipped config is for its own tick rate
    "--set", "tick.rate_hz=125", "--set", "tick.floor_hz=100", "--set", "mission.duration_s=4",
    "--set", "mission.waypoints=[{at_s: 1, offset_ned_m: [0.2, 0, 0]}]",
    *PATIENT,
]  # fmt: skip
OFFBOARD, HOLD = 6 << 16, 4 << 16 | 3 << 24
ENDLESS = ["--set", "mission.duration_s=600"]


def companion(*arguments: object) -> "subprocess.Popen[str]":
    command = [sys.executable, "-u", "-m", "companion", *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT)


def wait_for(process: "subprocess.Popen[str]", text: str, timeout_s: float = 30.0) -> str:
    """The first line of the process's output that contains `text`."""
    assert process.stdout is not None
    until = time.monotonic() + timeout_s
    while (left := until - time.monotonic()) > 0:
        if select.select([process.stdout], [], [], left)[0]:
            line = process.stdout.readline()
            if text in line:
                return line
            assert line, f"ended without {text!r}: {process.stderr.read() if process.stderr else ''}"
    pytest.fail(f"no {text!r} within {timeout_s} s")


@contextmanager
def plant(*arguments: object) -> Iterator["subprocess.Popen[str]"]:
    process = companion("sitl", RIG, "--serve", *arguments)
    try:
        yield process
    finally:
        process.terminate()
        process.communicate(timeout=10)


@contextmanager
def served(*arguments: object) -> Iterator[int]:
    with plant("--port", 0, *arguments) as process:
        yield int(wait_for(process, "udp port").rsplit(maxsplit=1)[-1])


def folder_of(line: str) -> Path:
    match = re.search(r"log (\S+)", line)
    assert match
    return Path(match[1])


def check_flight(folder: Path, reason: str) -> None:
    flight = read_flight(folder)
    assert flight.events[-1].name == f"released_{reason}"
    engaged = flight.ticks[flight.ticks["state"] == 3]
    assert abs(engaged["position_m"][-1, 0] - 0.2) < 0.12
    assert 0.0 < engaged["latency_s"].mean() < 0.02


CABLE = """
import os, select, sys
near, far = int(sys.argv[1]), int(sys.argv[2])
while True:
    for fd in select.select([near, far], [], [])[0]:
        os.write(far if fd == near else near, os.read(fd, 4096))
"""


class Cable:
    """Two pseudo-terminals back to back: the plant has one end, `link` is the other."""

    def __enter__(self) -> "Cable":
        self._near, self._near_device = os.openpty()
        self._far, self._far_device = os.openpty()
        for fd in (self._near, self._far):
            tty.setraw(fd)
        self.plant = f"serial://{os.ttyname(self._near_device)}:921600"
        self.link = f"serial://{os.ttyname(self._far_device)}:921600"
        masters = (self._near, self._far)
        self._carrier = subprocess.Popen([sys.executable, "-c", CABLE, *map(str, masters)], pass_fds=masters)
        return self

    def unplug(self) -> None:
        """At the companion's end."""
        self._carrier.kill()
        self._carrier.wait()
        os.close(self._far)
        self._far = -1

    def __exit__(self, *_: object) -> None:
        self._carrier.kill()
        self._carrier.wait()
        for fd in (self._near, self._near_device, self._far, self._far_device):
            if fd >= 0:
                os.close(fd)


def tlog(folder: Path) -> Iterator[mavutil.mavlink.MAVLink_message]:
    os.environ["MAVLINK20"], os.environ["MAVLINK_DIALECT"] = "1", "development"
    mavutil.set_dialect("development")
    log = mavutil.mavlink_connection(str(folder / "traffic.tlog"))
    try:
        while (message := log.recv_match()) is not None:
            yield message
    finally:
        log.close()


class GroundStation:
    """A pilot's ground station on the plant's second port, with CURRENT_MODE at 50 Hz."""

    def __init__(self, port: int) -> None:
        os.environ["MAVLINK20"] = "1"
        self.link = mavutil.mavlink_connection(f"udpout:127.0.0.1:{port}", source_system=255, dialect="development")
        self.link.mav.heartbeat_send(6, 8, 0, 0, 0)
        self.command(511, 436, 20_000)

    def command(self, number: int, *params: float) -> None:
        self.link.mav.command_long_send(1, 1, number, 0, *params, *[0] * (7 - len(params)))

    def mode_becomes(self, mode: int, timeout_s: float) -> float:
        """Seconds until CURRENT_MODE shows the mode."""
        began = time.monotonic()
        while time.monotonic() - began < timeout_s:
            message = self.link.recv_match(type="CURRENT_MODE", blocking=True, timeout=0.1)
            if message is not None and message.custom_mode == mode:
                return time.monotonic() - began
        pytest.fail(f"the mode did not become {mode:#x} within {timeout_s} s")


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


Flown = tuple["subprocess.Popen[str]", GroundStation, Path]


@contextmanager
def in_control(link: str, out: Path, station_port: int) -> Iterator[Flown]:
    """A flight in control that does not end by itself, and a ground station beside it."""
    run = companion("run", RIG, "--link", link, "--engage", "--out", out, *SHORT, *ENDLESS)
    try:
        folder = folder_of(wait_for(run, "log "))
        wait_for(run, "engaged")
        station = GroundStation(station_port)
        try:
            yield run, station, folder
        finally:
            station.link.close()
    finally:
        run.kill()
        run.communicate()


@contextmanager
def engaged(tmp_path: Path) -> Iterator[Flown]:
    """A flight in control over UDP."""
    station_port = free_port()
    with (
        served("--gcs-port", station_port) as port,
        in_control(f"udpout://127.0.0.1:{port}", tmp_path, station_port) as flight,
    ):
        flight[1].mode_becomes(OFFBOARD, 5.0)
        yield flight


@contextmanager
def flying_over(cable: Cable, out: Path) -> Iterator[Flown]:
    """A flight in control over a cable."""
    station_port = free_port()
    with plant("--link", cable.plant, "--gcs-port", station_port) as process:
        wait_for(process, "plant ready")
        with in_control(cable.link, out, station_port) as flight:
            yield flight
