"""`companion design` on the log of a real PX4: a certified config, which flies in the plant with its response."""

from __future__ import annotations

import json
import lzma
from pathlib import Path
from typing import NamedTuple

import pytest
from harness.command import companion

from companion.certify import proof
from companion.certify.from_config import certificate_path, problem
from companion.certify.statement import statement
from companion.config import Config, load_config

ROOT = Path(__file__).resolve().parents[2]
PX4 = ROOT / "config" / "px4_quadrotor.yaml"
LOG = "px4_sih_attitude_p4.ulg"
FULL = ROOT.parent / "shared" / "data" / LOG


class Designed(NamedTuple):
    """What the command left: its config, and the object on its stdout."""

    log: Path
    path: Path
    report: dict
    config: Config


@pytest.fixture(scope="module")
def designed(tmp_path_factory: pytest.TempPathFactory) -> Designed:
    """The whole log where it is beside this clone, else the cut of it."""
    folder = tmp_path_factory.mktemp("design")
    log = folder / LOG
    log.write_bytes(
        FULL.read_bytes() if FULL.exists() else lzma.decompress((ROOT / "tests/data" / f"{LOG}.xz").read_bytes())
    )
    out = folder / "my_vehicle.yaml"
    ended = companion("design", log, "--template", PX4, "--out", out, "--json")
    assert ended.returncode == 0, ended.stderr
    assert "Traceback" not in ended.stderr
    (line,) = ended.stdout.splitlines()  # one JSON object on stdout, nothing else
    return Designed(log, out, json.loads(line), load_config(out))


def test_the_reference_model_is_fast_enough_and_everything_is_written(designed: Designed) -> None:
    """Acceptance 3: at least 2.4 rad/s at damping 0.7."""
    report, config = designed.report, designed.config
    assert report["certified"] is True
    assert (report["config"], report["certificate"]) == (str(designed.path), str(certificate_path(designed.path)))
    assert report["natural_frequency_rad_s"] >= 2.4
    assert report["damping_ratio"] == 0.7
    assert report["limited_by"] in {"attitude bandwidth", "delay"}
    for axis in (config.controller.axes.x, config.controller.axes.y):
        assert axis is not None
        assert (axis.natural_frequency_rad_s, axis.damping_ratio) == (report["natural_frequency_rad_s"], 0.7)
        assert axis.position_weight_bound == tuple(report["position_weight_bound"])
        assert axis.velocity_weight_bound == tuple(report["velocity_weight_bound"])
        assert axis.adaptation_rate.hedged == report["adaptation_rate"]
    assert report["natural_frequency_rad_s"] <= min(report["fastest_natural_frequency_rad_s"].values())


def test_the_adaptation_is_for_the_estimator_that_the_log_shows(designed: Designed) -> None:
    """Issue 11, acceptance 4: EKF2 with GPS, by slope of the position less velocity. A cut log is too short for it."""
    report, controller = designed.report, designed.config.controller
    if not FULL.exists():
        assert report["velocity_error"] is None
        return
    assert report["velocity_error"]["deviation_m_s"] == pytest.approx(0.19, abs=0.05)
    assert 2.0 < report["velocity_error"]["time_s"] < 5.0
    assert report["lyapunov_q"] == list(controller.axes.x.lyapunov_q)
    assert 0.03 <= report["lyapunov_q"][1] <= 0.1
    assert controller.bias is not None
    assert controller.bias.adaptation_rate.hedged == report["bias_adaptation_rate"] > 6.0
    assert controller.estimate_correction is not None


def test_the_plant_carries_the_very_response_that_is_certified(designed: Designed) -> None:
    attitude, plant = designed.config.attitude, designed.config.plant
    assert plant is not None
    assert plant.quadrotor is not None
    assert plant.setpoint_delay_s == 0.0
    for section, flown, angle in (
        (attitude.x, plant.quadrotor.pitch, "pitch"),
        (attitude.y, plant.quadrotor.roll, "roll"),
    ):
        assert section is not None
        assert flown is not None
        identified = designed.report["responses"][angle]
        for key in ("natural_frequency_rad_s", "damping_ratio"):
            assert getattr(section, key) == getattr(flown, key) == pytest.approx(identified[key], rel=1e-3)
        assert section.delay_s == flown.delay_s
        # this log keeps a set-point every 48 ms: half of that is in the delay
        assert flown.delay_s - identified["delay_s"] == pytest.approx(0.024, abs=0.003)
    assert designed.config.vehicle.parameters["MC_ROLL_P"] == 4.0
    assert designed.config.vehicle.px4_version == "1.17"


def test_comments_stay_but_for_those_of_the_old_values_and_the_log_is_named(designed: Designed) -> None:
    """Issue 13: no comment beside a new value speaks of the old one."""
    text = designed.path.read_text()
    kept = [line.strip() for line in PX4.read_text().splitlines() if line.lstrip().startswith("#")]
    gone = [line for line in kept if line not in text]
    assert 0 < len(gone) <= 8, gone
    assert "with nothing to spare" not in text
    assert "roll 9.7 rad/s" not in text
    assert "# one more weight an axis, against what pushes steadily" in text, "a comment without figures"
    assert "# 30 % of the weight" in text, "a value that has not changed"
    assert text.count(f"# identified from {LOG}: second order + delay, 3 manoeuvres") == 2


def test_the_certificate_verifies(designed: Designed) -> None:
    certificate, reason = proof.load(certificate_path(designed.path))
    assert reason == ""
    assert proof.verify(certificate, statement(problem(designed.config))).ok
    ended = companion("check", designed.path, "--verify", certificate_path(designed.path))
    assert ended.returncode == 0, ended.stderr


def test_it_flies_in_the_plant_that_carries_the_response(designed: Designed, tmp_path: Path) -> None:
    """Acceptance 3: stable, and tracking within the bounds of the scenarios."""
    ended = companion(
        "sitl", designed.path, "--hedging", "--json", "--out", tmp_path / "flight", "--set", "plant.sensors=null"
    )
    assert ended.returncode == 0, ended.stderr
    hedged = json.loads(ended.stdout)["controllers"]["hedged"]
    assert hedged["stable"] is True
    assert hedged["rms_error_m"] < 0.15
    assert hedged["peak_error_m"] < 0.5


def test_it_does_not_overwrite_without_force(designed: Designed) -> None:
    before = designed.path.read_bytes()
    ended = companion("design", designed.log, "--template", PX4, "--out", designed.path)
    assert ended.returncode == 2
    assert ended.stderr == f"companion: {designed.path}: exists: choose another name, or --force\n"
    assert designed.path.read_bytes() == before
