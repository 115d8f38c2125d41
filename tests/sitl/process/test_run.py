"""`companion run` in one process, the plant in another: UDP, a serial line, the pilot, and sudden silence."""

import signal
import time
from pathlib import Path

import pytest
from harness.cable import Cable
from harness.fake_autopilot import HOLD
from harness.ground_station import tlog
from harness.processes import RIG, end_of, eventually, folder_of, line_with, plant, served, start
from harness.two_processes import ENDLESS, SHORT, check_flight, engaged

from companion.record.reader import read_flight

pytestmark = pytest.mark.realtime


def test_run_flies_the_served_plant_over_udp_in_real_time(tmp_path: Path) -> None:
    with served() as port:
        run = start("run", RIG, "--link", f"udpout://127.0.0.1:{port}", "--engage", "--out", tmp_path, *SHORT)
        folder = folder_of(line_with(run, "log "))
        out, err = end_of(run)
    assert run.returncode == 0, err
    assert "released: mission_complete" in out
    check_flight(folder, "mission_complete")


def test_run_flies_the_served_plant_over_a_serial_line(tmp_path: Path) -> None:
    """Two pseudo-terminals back to back are a null-modem cable."""
    with Cable() as cable, plant("--link", cable.plant) as process:
        line_with(process, "plant ready")
        run = start("run", RIG, "--link", cable.link, "--engage", "--out", tmp_path, *SHORT)
        folder = folder_of(line_with(run, "log "))
        out, err = end_of(run)
    assert run.returncode == 0, err + out
    check_flight(folder, "mission_complete")


def test_ctrl_c_hands_over_to_hold_and_closes_the_log(tmp_path: Path) -> None:
    with served() as port:
        run = start("run", RIG, "--link", f"udpout://127.0.0.1:{port}", "--engage", "--out", tmp_path, *SHORT, *ENDLESS)
        folder = folder_of(line_with(run, "log "))
        line_with(run, "^engaged")
        time.sleep(1.0)
        run.send_signal(signal.SIGINT)
        out, err = end_of(run)
    assert run.returncode == 0, err
    assert "released: operator" in out
    flight = read_flight(folder)
    assert flight.events[-1].name == "released_operator"
    modes = [m.custom_mode for m in tlog(folder) if m.get_type() == "CURRENT_MODE"]
    assert modes[-1] == HOLD


def test_pilot_takes_over_and_the_companion_asks_for_nothing_more(tmp_path: Path) -> None:
    with engaged(tmp_path) as (run, station, folder):
        station.command(176, 1, 4, 3)  # DO_SET_MODE: Hold
        out, _ = end_of(run)
        assert "released: mode_changed" in out
        assert run.returncode == 0
    asked = [m.param2 for m in tlog(folder) if m.get_type() == "COMMAND_LONG" and m.command == 176]
    assert asked
    assert set(asked) == {6.0}  # OFFBOARD at the start, and nothing after the pilot


def test_stopped_process_trips_the_offboard_failsafe_by_silence_alone(tmp_path: Path) -> None:
    """kill -STOP: nothing more is sent, and COM_OF_LOSS_T (1 s) later the plant acts by itself."""
    with engaged(tmp_path) as (run, station, _):
        run.send_signal(signal.SIGSTOP)
        stopped_s = station.vehicle_s()
        assert 0.9 < station.mode_becomes(HOLD) - stopped_s < 2.5
        run.send_signal(signal.SIGCONT)
        out, _ = end_of(run)
        assert "released: pose_stale" in out  # awake again it does not believe what queued up meanwhile


def test_killed_process_leaves_a_readable_log_and_trips_the_failsafe(tmp_path: Path) -> None:
    with engaged(tmp_path) as (run, station, folder):
        time.sleep(1.0)
        run.kill()
        killed_s = station.vehicle_s()
        assert 0.9 < station.mode_becomes(HOLD) - killed_s < 2.5
        assert eventually(lambda: len(read_flight(folder).ticks) > 100)
