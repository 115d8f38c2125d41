"""`companion sitl --against px4`: three controllers in one plant, scored by the truth; and what is refused."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from harness.command import companion
from harness.processes import PATIENCE_S, ROOT

from companion.config import load_config
from sitl.experiment.against import CONTROLLERS, fly_against
from sitl.scenarios.scenario import PLAIN_ADAPTATION

QUADROTOR = ROOT / "config" / "px4_quadrotor.yaml"
GPS = (
    "plant.sensors={preset: gps}",
    "mission={duration_s: 20, waypoints: [{at_s: 4, offset_ned_m: [0.5, 0, 0]}, {at_s: 12, offset_ned_m: [0, 0, 0]}]}",
)
FIELDS = {"truth_rms_along_m", "truth_rms_across_m", "estimate_rms_along_m", "estimate_rms_across_m"}


def settings(*overrides: str) -> list[str]:
    return [part for override in overrides for part in ("--set", override)]


def distance(controller: str, folder: Path, *overrides: str) -> float:
    """Mean over three seeds of the RMS along and across, m, by the truth."""
    found = []
    for seed in (1, 2, 3):
        config = load_config(QUADROTOR, (*GPS, f"plant.seed={seed}", *overrides))
        scores = fly_against(config, QUADROTOR, folder / f"{controller}-{seed}", controller).scores
        assert scores is not None
        found += [scores.truth_rms_along_m, scores.truth_rms_across_m]
    return sum(found) / len(found)


@pytest.mark.slow
def test_with_gps_the_corrected_estimate_is_nearer_to_the_truth_than_px4_and_than_the_plain_one(tmp_path: Path) -> None:
    px4 = distance("px4", tmp_path / "a")
    plain = distance("hedged", tmp_path / "b", *PLAIN_ADAPTATION)
    corrected = distance("hedged", tmp_path / "c")
    assert corrected < 0.6 * px4
    assert corrected < 0.6 * plain


def test_the_same_flight_twice_has_the_same_scores(tmp_path: Path) -> None:
    config = load_config(QUADROTOR, GPS)
    for controller in ("hedged", "px4"):
        first = fly_against(config, QUADROTOR, tmp_path / "first", controller)
        assert first.scores is not None
        assert first == fly_against(config, QUADROTOR, tmp_path / "second", controller)


def test_where_the_estimate_is_the_truth_both_scores_agree(tmp_path: Path) -> None:
    scores = fly_against(load_config(QUADROTOR, ("plant.sensors=null", *GPS[1:])), QUADROTOR, tmp_path, "px4").scores
    assert scores is not None
    assert scores.truth_rms_across_m == pytest.approx(scores.estimate_rms_across_m, abs=1e-3)
    assert scores.truth_rms_along_m == pytest.approx(scores.estimate_rms_along_m, abs=0.02)  # less its mean


def test_json_is_one_object_with_every_controller(tmp_path: Path) -> None:
    ended = companion("sitl", QUADROTOR, "--against", "px4", "--json", "--out", tmp_path / "out", *settings(*GPS))
    assert ended.returncode == 0, ended.stderr
    report = json.loads(ended.stdout)
    assert tuple(report["controllers"]) == CONTROLLERS
    for flown in report["controllers"].values():
        assert flown["reason"] == "mission_complete"
        assert {key for key in flown if key.endswith("_m")} == FIELDS
        assert all(0.0 < flown[key] < 2.0 for key in FIELDS)
    assert json.loads((tmp_path / "out" / "summary.json").read_text()) == report


def test_a_flight_that_a_guard_ends_has_no_score_and_code_1(tmp_path: Path) -> None:
    tight = ("guards.tracking_error_m.limit=0.001", "guards.tracking_error_m.timeout_s=0", *GPS)
    ended = companion("sitl", QUADROTOR, "--against", "px4", "--json", "--out", tmp_path / "out", *settings(*tight))
    assert ended.returncode == 1
    hedged = json.loads(ended.stdout)["controllers"]["hedged"]
    assert hedged == {"reason": "tracking_error"}


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("config/antx_rig.yaml",), "needs a quadrotor"),
        ((QUADROTOR, "--set", "mission.duration_s=null"), "needs a mission with a duration_s"),
        ((QUADROTOR, "--no-hedging"), "leave out --hedging"),
        ((QUADROTOR, "--realtime"), "leave out --realtime"),
        ((QUADROTOR, "--serve"), "leave out --serve"),
        ((QUADROTOR, "--scenarios", "fence"), "leave out --against"),
    ],
)
def test_what_cannot_be_compared_is_one_line(arguments: tuple[object, ...], words: str, tmp_path: Path) -> None:
    ended = companion("sitl", *arguments, "--against", "px4", "--out", tmp_path / "out")
    assert ended.returncode == 2
    assert words in ended.stderr
    assert len(ended.stderr.strip().splitlines()) == 1


def test_ctrl_c_ends_it_without_a_traceback(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "companion", "sitl", str(QUADROTOR), "--against", "px4", "--out", str(tmp_path)]
    with subprocess.Popen(
        command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    ) as process:
        until_s = time.monotonic() + PATIENCE_S
        while not any(tmp_path.iterdir()) and time.monotonic() < until_s:
            time.sleep(0.05)  # a flight has begun once it has a folder
        os.killpg(process.pid, signal.SIGINT)
        _, err = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 130
    assert "Traceback" not in err
