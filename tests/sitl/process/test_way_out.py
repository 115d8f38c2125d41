"""On the way out of control nothing comes between the vehicle and its Hold, or the log and its reason."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from harness.fake_autopilot import HOLD
from harness.process_flight import AutopilotOnSocket
from harness.processes import PATIENT, RIG, ROOT, end_of, folder_of, line_with, stop
from harness.two_processes import engaged
from harness.virtual_flight import SLOW, VirtualFlight, flown

from companion.record.reader import read_flight

ERRORS = (OverflowError("int too large to convert to float"), MemoryError(), RecursionError(), KeyError(7))


def fail(flight: VirtualFlight, error: Exception, after: int = 0) -> None:
    """What is heard raises, from then on, or once it has worked so often."""
    flight._link.error, flight._link.works = error, after


def hold_asked_for(flight: VirtualFlight) -> bool:
    return [m.param2 for m in flight.autopilot.commands(176)][-1:] == [4.0]


@pytest.mark.parametrize("error", ERRORS, ids=lambda error: type(error).__name__)
@pytest.mark.parametrize("heard", [0, 3], ids=["at once", "later"])
def test_an_error_while_the_vehicle_is_handed_back_keeps_nothing_from_it(
    tmp_path: Path, error: Exception, heard: int
) -> None:
    """Stopped by its operator; from then on, or a little later, whatever is heard raises."""
    with flown(tmp_path) as flight:
        flight.until("^engaged")
        flight.process.stop()
        fail(flight, error, 1 + heard)
        assert flight.exit_code(20.0) == 0
        assert hold_asked_for(flight)
        assert flight.autopilot.mode == HOLD
    events = read_flight(flight.folder).events
    assert events[-1].name == "released_operator"
    assert type(error).__name__ in next(e.detail for e in events if e.name == "traceback")


def test_what_ends_control_and_what_then_goes_wrong_are_both_told(tmp_path: Path) -> None:
    """One defect for all: it ends control as `internal_error`, and meets every further step too."""
    with flown(tmp_path) as flight:
        flight.until("^engaged")
        fail(flight, OverflowError("too large"))
        assert flight.exit_code(20.0) == 1
        assert hold_asked_for(flight)
    assert read_flight(flight.folder).events[-1].name == "released_internal_error"


def test_a_heartbeat_that_cannot_be_sent_is_only_that(tmp_path: Path) -> None:
    with flown(tmp_path) as flight:
        flight.until("^engaged")
        send, errors = flight._link.send, [MemoryError()]

        def failing(data: bytes) -> None:
            if errors:
                raise errors.pop()
            send(data)

        flight.process.stop()
        flight._link.send = failing  # type: ignore[method-assign]
        assert flight.exit_code(20.0) == 0
        assert hold_asked_for(flight)
    assert read_flight(flight.folder).events[-1].name == "released_operator"


FULL = """
import os, runpy, sys
from companion.mavlink.link import UdpLink
full, receive = sys.argv.pop(1), UdpLink.receive

def failing(link):
    if os.path.exists(full):
        raise MemoryError
    return receive(link)

UdpLink.receive = failing
runpy.run_module("companion", run_name="__main__")
"""


@pytest.mark.realtime
def test_a_process_out_of_memory_hands_the_vehicle_back_and_says_why(tmp_path: Path) -> None:
    vehicle, full = AutopilotOnSocket(), tmp_path / "full"
    settings = [part for setting in SLOW for part in ("--set", setting)]
    command = [sys.executable, "-u", "-c", FULL, str(full), "run", str(RIG), "--out", str(tmp_path), "--uncertified"]
    command += ["--link", f"udpout://127.0.0.1:{vehicle.port}", *settings, *PATIENT]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    run = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT, env=environment
    )
    try:
        vehicle.start()
        folder = folder_of(line_with(run, "log "))
        line_with(run, "^engaged")
        full.touch()
        assert "internal_error" in line_with(run, "^released")
        _, err = end_of(run)
        assert (run.returncode, "Traceback" in err) == (1, False)
        assert vehicle.mode == HOLD
    finally:
        vehicle.close()
        stop(run)
    assert read_flight(folder).events[-1].name == "released_internal_error"


@pytest.mark.realtime
def test_further_signals_do_not_end_it_before_the_log_says_why(tmp_path: Path) -> None:
    """The log's writer is stopped meanwhile, as by a disk that takes its time."""
    with engaged(tmp_path) as (run, station, folder):
        (writer,) = map(int, Path(f"/proc/{run.pid}/task/{run.pid}/children").read_text().split())
        os.kill(writer, signal.SIGSTOP)
        try:
            run.send_signal(signal.SIGINT)
            line_with(run, "^released: operator")
            station.mode_becomes(HOLD)
            for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
                time.sleep(0.2)
                run.send_signal(number)
            time.sleep(0.2)
            assert run.poll() is None
        finally:
            os.kill(writer, signal.SIGCONT)
        _, err = end_of(run)
    assert (run.returncode, "Traceback" in err) == (0, False)
    assert read_flight(folder).events[-1].name == "released_operator"
