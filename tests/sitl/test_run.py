"""`companion run` in one process, the plant in another: UDP, a serial line, the pilot, and sudden silence."""

import os
import re
import select
import signal
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


def test_run_flies_the_served_plant_over_udp_in_real_time(tmp_path: Path) -> None:
    with served() as port:
        run = companion("run", RIG, "--link", f"udpout://127.0.0.1:{port}", "--engage", "--out", tmp_path, *SHORT)
        folder = folder_of(wait_for(run, "log "))
        out, err = run.communicate(timeout=60)
    assert run.returncode == 0, err
    assert "released: mission_complete" in out
    check_flight(folder, "mission_complete")


def test_run_flies_the_served_plant_over_a_serial_line(tmp_path: Path) -> None:
    """Two pseudo-terminals back to back are a null-modem cable."""
    near, near_name = os.openpty()
    far, far_name = os.openpty()
    for fd in (near, far):
        tty.setraw(fd)
    names = [os.ttyname(near_name), os.ttyname(far_name)]
    cable = subprocess.Popen([sys.executable, "-c", CABLE, str(near), str(far)], pass_fds=(near, far))
    try:
        with plant("--link", f"serial://{names[0]}:921600") as process:
            wait_for(process, "plant ready")
            link = f"serial://{names[1]}:921600"
            run = companion("run", RIG, "--link", link, "--engage", "--out", tmp_path, *SHORT)
            folder = folder_of(wait_for(run, "log "))
            out, err = run.communicate(timeout=60)
        assert run.returncode == 0, err + out
        check_flight(folder, "mission_complete")
    finally:
        cable.kill()
        cable.wait()
        for fd in (near, far, near_name, far_name):
            os.close(fd)


CABLE = """
import os, select, sys
near, far = int(sys.argv[1]), int(sys.argv[2])
while True:
    for fd in select.select([near, far], [], [])[0]:
        os.write(far if fd == near else near, os.read(fd, 4096))
"""


def test_ctrl_c_hands_over_to_hold_and_closes_the_log(tmp_path: Path) -> None:
    with served() as port:
        run = companion(
            "run", RIG, "--link", f"udpout://127.0.0.1:{port}", "--engage", "--out", tmp_path, *SHORT, *ENDLESS
        )
        folder = folder_of(wait_for(run, "log "))
        wait_for(run, "engaged")
        time.sleep(1.0)
        run.send_signal(signal.SIGINT)
        out, err = run.communicate(timeout=10)
    assert run.returncode == 0, err
    assert "released: operator" in out
    flight = read_flight(folder)
    assert flight.events[-1].name == "released_operator"
    modes = [m.custom_mode for m in tlog(folder) if m.get_type() == "CURRENT_MODE"]
    assert modes[-1] == HOLD


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


@contextmanager
def engaged(tmp_path: Path) -> Iterator[tuple["subprocess.Popen[str]", GroundStation, Path]]:
    """A flight in control that does not end by itself, and a ground station beside it."""
    station_port = free_port()
    with served("--gcs-port", station_port) as port:
        link = f"udpout://127.0.0.1:{port}"
        run = companion("run", RIG, "--link", link, "--engage", "--out", tmp_path, *SHORT, *ENDLESS)
        try:
            folder = folder_of(wait_for(run, "log "))
            wait_for(run, "engaged")
            station = GroundStation(station_port)
            try:
                station.mode_becomes(OFFBOARD, 5.0)
                yield run, station, folder
            finally:
                station.link.close()
        finally:
            run.kill()
            run.communicate()


def test_pilot_takes_over_and_the_companion_asks_for_nothing_more(tmp_path: Path) -> None:
    with engaged(tmp_path) as (run, station, folder):
        station.command(176, 1, 4, 3)  # DO_SET_MODE: Hold
        out, _ = run.communicate(timeout=10)
        assert "released: mode_changed" in out
        assert run.returncode == 0
    asked = [m.param2 for m in tlog(folder) if m.get_type() == "COMMAND_LONG" and m.command == 176]
    assert asked
    assert set(asked) == {6.0}  # OFFBOARD at the start, and nothing after the pilot


def test_stopped_process_trips_the_offboard_failsafe_by_silence_alone(tmp_path: Path) -> None:
    """kill -STOP: nothing more is sent, and COM_OF_LOSS_T (1 s) later the plant acts by itself."""
    with engaged(tmp_path) as (run, station, _):
        run.send_signal(signal.SIGSTOP)
        waited = station.mode_becomes(HOLD, 4.0)
        assert 0.9 < waited < 2.5
        run.send_signal(signal.SIGCONT)
        out, _ = run.communicate(timeout=10)
        assert "released: pose_stale" in out  # awake again it does not believe what queued up meanwhile


def test_killed_process_leaves_a_readable_log_and_trips_the_failsafe(tmp_path: Path) -> None:
    with engaged(tmp_path) as (run, station, folder):
        time.sleep(1.0)
        run.kill()
        assert 0.9 < station.mode_becomes(HOLD, 4.0) < 2.5
        time.sleep(0.5)
        assert len(read_flight(folder).ticks) > 100
