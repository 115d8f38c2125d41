"""`companion run` and a tool on one link: the certificate set beside the vehicle, and questions while it flies."""

from __future__ import annotations

import json
import re
import select
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from running_plant import PATIENT

from companion.record.reader import read_flight
from sitl.messages.log_download import synthetic_log

ROOT = Path(__file__).resolve().parents[2]
QUADROTOR = ROOT / "config" / "paper_quadrotor.yaml"
QUICK = "{COM_SPOOLUP_TIME: 0.2, MPC_TKO_RAMP_T: 0.5, NAV_MC_ALT_RAD: 0.3, COM_RC_OVERRIDE: 3, MC_ROLL_P: 6.5}"
SLOW = ("--set", "tick.rate_hz=250", "--set", "tick.floor_hz=100", "--set", "mission.duration_s=600", *PATIENT)


def started(*arguments: object) -> subprocess.Popen[str]:
    command = [sys.executable, "-u", "-m", "companion", *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT)


def companion(*arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "companion", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=60.0, check=False, cwd=ROOT)


def lines_until(process: subprocess.Popen[str], text: str, timeout_s: float = 40.0) -> list[str]:
    """Lines of its output up to the first that contains `text`."""
    assert process.stdout is not None
    lines: list[str] = []
    until_s = time.monotonic() + timeout_s
    while (left_s := until_s - time.monotonic()) > 0:
        if select.select([process.stdout], [], [], left_s)[0]:
            lines.append(process.stdout.readline())
            if text in lines[-1]:
                return lines
            assert lines[-1], f"ended without {text!r}: {lines} {process.stderr.read() if process.stderr else ''}"
    pytest.fail(f"no {text!r}: {lines}")


@contextmanager
def served(*arguments: object) -> Iterator[str]:
    """`companion sitl --serve`, and where it is."""
    process = started("sitl", QUADROTOR, "--serve", "--port", 0, "--set", f"plant.parameters={QUICK}", *arguments)
    try:
        yield f"udpout://127.0.0.1:{lines_until(process, 'udp port')[-1].rsplit(maxsplit=1)[-1]}"
    finally:
        process.terminate()
        process.communicate(timeout=10.0)


def test_a_changed_gain_is_refused_before_stand_by(tmp_path: Path) -> None:
    with served() as url:
        done = companion(
            "run", QUADROTOR, "--link", url, "--engage", "--out", tmp_path,
            "--set", "vehicle.parameters={MC_ROLL_P: 4, MC_PITCH_P: 4, MC_ROLLRATE_P: 0.15}",
        )  # fmt: skip
    assert done.returncode == 2
    (line,) = done.stderr.strip().splitlines()
    assert "certificate is stale" in line
    assert "MC_ROLL_P is 6.5, was 4" in line
    assert "MC_PITCH_P" not in line
    (folder,) = tmp_path.iterdir()
    flight = read_flight(folder)
    assert flight.events[-1].name == "released_certificate_stale"
    assert len(flight.ticks) == 0, "not one set-point"


def test_what_the_vehicle_does_not_tell_is_refused_too(tmp_path: Path) -> None:
    with served() as url:
        done = companion(
            "run", QUADROTOR, "--link", url, "--out", tmp_path, "--set", "vehicle.parameters={NO_SUCH_GAIN: 4}"
        )
    assert done.returncode == 2
    assert "does not tell NO_SUCH_GAIN" in done.stderr


def test_tools_ask_the_vehicle_while_it_is_flown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Stale and uncertified it flies, loudly; mavsdk reads parameters and a log comes down; no tick is lost."""
    runtime = Path(tempfile.mkdtemp(dir="/tmp"))  # the path of a socket is at most 108 bytes long
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(runtime))
    (tmp_path / "card.ulg").write_bytes(synthetic_log(40_000, 3).data)
    stated = ("--set", "vehicle.parameters={MC_ROLL_P: 4}")
    with served("--log", tmp_path / "card.ulg") as url:
        run = started(
            "run", QUADROTOR, "--link", url, "--engage", "--uncertified", "--out", tmp_path / "flights", *SLOW, *stated
        )
        try:
            said = lines_until(run, "engaged")
            assert any("UNCERTIFIED FLIGHT" in line and "MC_ROLL_P is 6.5, was 4" in line for line in said)
            asked_s = time.time()
            vehicle = companion("vehicle", QUADROTOR, "--link", url, "--json", *stated)
            assert vehicle.stdout, vehicle.stderr
            answer = json.loads(vehicle.stdout)
            assert answer["parameters"]["MC_ROLL_P"] == 6.5
            assert [row["name"] for row in answer["settings"] if row["verdict"] != "fine"] == ["MC_ROLL_P"]
            assert "ODOMETRY" not in {row["name"] for row in answer["settings"]}, "what is hot stays inside"
            logs = companion("logs", QUADROTOR, "--link", url, "--latest", "--out", tmp_path / "logs")
            assert logs.returncode == 0, logs.stdout + logs.stderr
            (log,) = (tmp_path / "logs").iterdir()
            assert log.read_bytes() == (tmp_path / "card.ulg").read_bytes()
            answered_s = time.time()
        finally:
            run.send_signal(signal.SIGINT)
            out, err = run.communicate(timeout=30.0)
    assert run.returncode == 0, out + err
    match = re.search(r"log (\S+)", "".join(said))
    assert match
    flight = read_flight(Path(match[1]))
    assert [e.name for e in flight.events if e.name.startswith("released")] == ["released_operator"]
    engaged = flight.ticks[flight.ticks["state"] == 3]
    assert len(engaged) > 0.5 * 250 * (answered_s - asked_s)
    steps_s = np.diff(engaged["time_s"])
    assert np.allclose(steps_s, 0.004, atol=0.0015), "every sample of the vehicle was answered"
    assert not list(runtime.iterdir()), "the door is taken away"
