"""`companion run` and a tool on one link: the certificate set beside the vehicle, and questions while it flies."""

from __future__ import annotations

import json
import signal
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from harness import processes
from harness.processes import PATIENT, end_of, finish, folder_of, lines_until, start, stop

from companion.record.reader import read_flight
from sitl.messages.log_card import synthetic_log

QUADROTOR = processes.ROOT / "config" / "paper_quadrotor.yaml"
QUICK = "{COM_SPOOLUP_TIME: 0.2, MPC_TKO_RAMP_T: 0.5, NAV_MC_ALT_RAD: 0.3, COM_RC_OVERRIDE: 3, MC_ROLL_P: 6.5}"
SLOW = ("--set", "tick.rate_hz=250", "--set", "tick.floor_hz=100", "--set", "mission.duration_s=600", *PATIENT)


@contextmanager
def served(*arguments: object) -> Iterator[str]:
    """`companion sitl --serve`, and where it is."""
    with processes.served("--set", f"plant.parameters={QUICK}", *arguments, config=QUADROTOR) as port:
        yield f"udpout://127.0.0.1:{port}"


@pytest.mark.realtime
def test_a_changed_gain_is_refused_before_stand_by(tmp_path: Path) -> None:
    with served() as url:
        done = finish(
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


@pytest.mark.realtime
def test_what_the_vehicle_does_not_tell_is_refused_too(tmp_path: Path) -> None:
    with served() as url:
        done = finish(
            "run", QUADROTOR, "--link", url, "--out", tmp_path, "--set", "vehicle.parameters={NO_SUCH_GAIN: 4}"
        )
    assert done.returncode == 2
    assert "does not tell NO_SUCH_GAIN" in done.stderr


@pytest.mark.realtime
def test_tools_ask_the_vehicle_while_it_is_flown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Stale and uncertified it flies, loudly; its parameters are read and a log comes down; no tick is lost."""
    runtime = Path(tempfile.mkdtemp(dir="/tmp"))  # the path of a socket is at most 108 bytes long
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(runtime))
    (tmp_path / "card.ulg").write_bytes(synthetic_log(40_000, 3).data)
    stated = ("--set", "vehicle.parameters={MC_ROLL_P: 4}")
    with served("--log", tmp_path / "card.ulg") as url:
        run = start(
            "run", QUADROTOR, "--link", url, "--engage", "--uncertified", "--out", tmp_path / "flights", *SLOW, *stated
        )
        try:
            said = lines_until(run, "engaged")
            assert any("UNCERTIFIED FLIGHT" in line and "MC_ROLL_P is 6.5, was 4" in line for line in said)
            asked_s = time.time()
            vehicle = finish("vehicle", QUADROTOR, "--link", url, "--json", *stated)
            assert vehicle.stdout, vehicle.stderr
            answer = json.loads(vehicle.stdout)
            assert answer["parameters"]["MC_ROLL_P"] == 6.5
            assert [row["name"] for row in answer["settings"] if row["verdict"] != "fine"] == ["MC_ROLL_P"]
            assert "ODOMETRY" not in {row["name"] for row in answer["settings"]}, "what is hot stays inside"
            logs = finish("logs", QUADROTOR, "--link", url, "--out", tmp_path / "logs")
            assert logs.returncode == 0, logs.stdout
            assert "is being written" in logs.stdout
            fetched = [log.read_bytes() for log in (tmp_path / "logs").iterdir()]
            assert fetched == [(tmp_path / "card.ulg").read_bytes()], "the log of this flight is left until it ends"
            answered_s = time.time()
            run.send_signal(signal.SIGINT)
            out, err = end_of(run)
        finally:
            stop(run)
    assert run.returncode == 0, out + err
    flight = read_flight(folder_of("".join(said)))
    assert [e.name for e in flight.events if e.name.startswith("released")] == ["released_operator"]
    engaged = flight.ticks[flight.ticks["state"] == 3]
    assert len(engaged) > 0.5 * 250 * (answered_s - asked_s)
    steps_s = np.diff(engaged["time_s"])
    assert np.allclose(steps_s, 0.004, atol=0.0015), "every sample of the vehicle was answered"
    assert not list(runtime.iterdir()), "the socket is taken away"
