"""What breaks around a flight: the process, the disk, the cable, the clocks. kill -9 and -STOP are in test_run.py."""

import os
import re
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from harness.cable import Cable
from harness.fake_autopilot import HOLD, odometry
from harness.ground_station import tlog
from harness.processes import RIG, ROOT, Process, end_of, eventually, folder_of, line_with, served, start, stop
from harness.small_disk import small_disk
from harness.two_processes import ENDLESS, SHORT, check_flight, engaged, flying_over
from harness.virtual_flight import flown

from companion.record.reader import read_flight

OFFBOARD_LOSS_S = (0.9, 2.5)  # COM_OF_LOSS_T is a second
GO_ON_S = 2.0


# --- the process ------------------------------------------------------------------------------------------------------


@pytest.mark.realtime
def test_a_restart_in_flight_comes_up_beside_a_vehicle_that_it_leaves_alone(tmp_path: Path) -> None:
    """Killed in OFFBOARD and started again: no stream, which would bring PX4 back to OFFBOARD, and no request.

    Over a line: PX4 talks to the first UDP port that it hears, so only a companion on a fixed one (udpin) comes back.
    """
    with Cable() as cable, flying_over(cable, tmp_path / "first") as (first, station, _):
        first.kill()
        again = start("run", RIG, "--link", cable.link, "--out", tmp_path / "second", *SHORT, *ENDLESS)
        try:
            folder = folder_of(line_with(again, "log "))
            line_with(again, "standby")
            station.mode_becomes(HOLD)
            time.sleep(GO_ON_S)
            station.mode_becomes(HOLD)  # still: nothing has brought it back to OFFBOARD
            assert again.poll() is None
        finally:
            again.send_signal(signal.SIGINT)
            end_of(again)
    ours = [m for m in tlog(folder) if m.get_srcComponent() == 191]
    assert ours
    assert not [m for m in ours if m.get_type() == "SET_ATTITUDE_TARGET"]
    assert not [m for m in ours if m.get_type() == "COMMAND_LONG" and m.command in (176, 400)]
    ticks = read_flight(folder).ticks
    assert not len(ticks[ticks["state"] == 3])


@pytest.mark.realtime
def test_a_supervisor_s_signals_do_not_cost_the_log(tmp_path: Path) -> None:
    """systemd signals the whole group: SIGTERM at a stop, SIGABRT where the watchdog was not fed."""
    with engaged(tmp_path) as (run, _, folder):
        time.sleep(0.5)
        writer = writer_of(run.pid)
        for number in (signal.SIGTERM, signal.SIGHUP, signal.SIGINT, signal.SIGABRT):
            os.kill(writer, number)
        time.sleep(0.5)
        run.send_signal(signal.SIGABRT)
        end_of(run)
        assert run.returncode == -signal.SIGABRT

        def logged_s() -> float:
            ticks = read_flight(folder).ticks
            return float(ticks["time_s"][-1] - ticks["time_s"][ticks["state"] == 3][0])

        assert eventually(lambda: logged_s() > 0.7)


# --- the disk ---------------------------------------------------------------------------------------------------------


def writer_of(pid: int) -> int:
    """The process that writes a flight's log."""
    (child,) = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    return int(child)


def assert_flown_without_its_log(run: Process) -> None:
    out, err = end_of(run)
    assert run.returncode == 0, err
    assert "released: mission_complete" in out
    assert re.search(r"(traffic\.tlog|flight\.mcap): .*: the log ends here, the flight goes on", err)
    assert "the log is incomplete" in err


@pytest.mark.realtime
def test_a_full_disk_ends_the_log_and_not_the_flight() -> None:
    with served() as port, small_disk("64k") as disk:
        run = start(
            "run",
            RIG,
            "--link",
            f"udpout://127.0.0.1:{port}",
            "--engage",
            "--out",
            disk,
            *SHORT,
            "--set",
            "log.free_gb=0",
        )
        assert_flown_without_its_log(run)


@pytest.mark.realtime
def test_a_log_that_may_not_grow_ends_and_not_the_flight(tmp_path: Path) -> None:
    with served() as port:
        run = start("run", RIG, "--link", f"udpout://127.0.0.1:{port}", "--engage", "--out", tmp_path, *SHORT)
        line_with(run, "^engaged")
        limit = 100_000
        resource.prlimit(writer_of(run.pid), resource.RLIMIT_FSIZE, (limit, limit))
        assert_flown_without_its_log(run)


@pytest.mark.realtime
def test_a_writer_that_dies_ends_the_log_and_not_the_flight(tmp_path: Path) -> None:
    with served() as port:
        run = start("run", RIG, "--link", f"udpout://127.0.0.1:{port}", "--engage", "--out", tmp_path, *SHORT)
        line_with(run, "^engaged")
        os.kill(writer_of(run.pid), signal.SIGKILL)
        out, err = end_of(run)
    assert run.returncode == 0, err
    assert "released: mission_complete" in out
    assert "the log is incomplete" in err


# --- the cable --------------------------------------------------------------------------------------------------------


@pytest.mark.realtime
def test_an_unplugged_cable_ends_control_and_the_vehicle_s_own_failsafe_acts(tmp_path: Path) -> None:
    with Cable() as cable, flying_over(cable, tmp_path) as (run, station, folder):
        time.sleep(0.5)
        cable.unplug()
        unplugged_s = station.vehicle_s()
        waited_s = station.mode_becomes(HOLD) - unplugged_s
        assert OFFBOARD_LOSS_S[0] < waited_s < OFFBOARD_LOSS_S[1]
        out, _ = end_of(run)
        assert run.returncode == 1
        assert "released: link_lost" in out
        assert read_flight(folder).events[-1].name == "released_link_lost"


# --- the clocks -------------------------------------------------------------------------------------------------------


def test_a_vehicle_whose_clock_goes_back_ends_control_with_its_own_reason(tmp_path: Path) -> None:
    """Forward is in test_process.py."""
    with flown(tmp_path) as flight:
        autopilot = flight.autopilot
        autopilot.pose = lambda time_us: odometry(time_us + 3_600_000_000)
        flight.until("^engaged")
        autopilot.pose = odometry
        assert "clock_jump" in flight.until("^released")
        assert flight.exit_code(5.0) == 1
        assert autopilot.mode == HOLD


STEPPED = """
import os, runpy, sys, time
real_ns, day_ns, forward, back = time.time_ns, 86_400_000_000_000, *sys.argv[1:3]
sys.argv[1:3] = []

def stepped_ns():
    return real_ns() + (-day_ns if os.path.exists(back) else day_ns if os.path.exists(forward) else 0)

time.time_ns, time.time = stepped_ns, lambda: 1e-9 * stepped_ns()
runpy.run_module("companion", run_name="__main__")
"""


@pytest.mark.realtime
def test_the_host_s_clock_may_step_in_flight_even_where_frames_are_signed(tmp_path: Path) -> None:
    """As NTP does it, forward and back: only the log asks what day it is."""
    key = tmp_path / "key"
    key.write_bytes(bytes(range(1, 33)))
    key.chmod(0o600)
    steps = (tmp_path / "forward", tmp_path / "back")
    signed = ["--set", f"link.signing_key_file={key}"]
    with served(*signed) as port:
        command = [
            sys.executable,
            "-u",
            "-c",
            STEPPED,
            *map(str, steps),
            "run",
            str(RIG),
            "--engage",
            "--out",
            str(tmp_path / "flights"),
        ]
        command += ["--link", f"udpout://127.0.0.1:{port}", *SHORT, *signed]
        run = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT)
        try:
            folder = folder_of(line_with(run, "log "))
            line_with(run, "^engaged")
            for step in steps:
                time.sleep(0.7)
                step.touch()
            out, err = end_of(run)
        finally:
            stop(run)
    assert run.returncode == 0, err
    assert "released: mission_complete" in out
    check_flight(folder, "mission_complete")
    stamps = [event.time_s for event in read_flight(folder).events]
    assert abs(stamps[-1] - stamps[0] + 86_400.0) < 60.0  # the steps did happen
