"""`companion sitl --scenarios`: a handful of them flown as a user flies them, and what is said when one fails."""

import json
from pathlib import Path

import pytest
from harness.command import companion

from companion.record.reader import read_flight

ROOT = Path(__file__).resolve().parents[2]
HANDFUL = ["link_bad", "reset_small", "pilot_position", "px4_refuses_hold", "turbulence"]


@pytest.fixture(scope="module")
def twice(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """The handful, flown two times, each with its own folder."""
    folders = [tmp_path_factory.mktemp(name) for name in ("first", "second")]
    for folder in folders:
        done = companion("sitl", "--scenarios", *HANDFUL, "--json", "--out", folder, cwd=folder)
        assert done.returncode == 0, done.stdout + done.stderr
        (folder / "report.json").write_text(done.stdout)
    return folders


def test_json_is_the_contract(twice: list[Path]) -> None:
    report = json.loads((twice[0] / "report.json").read_text())
    assert set(report) == {"passed", "failed", "scenarios"}
    assert (report["passed"], report["failed"]) == (len(HANDFUL), 0)
    assert {one["name"] for one in report["scenarios"]} == set(HANDFUL)
    assert all(set(one) == {"name", "passed", "reason", "worst_error_m"} for one in report["scenarios"])
    reasons = {one["name"]: one["reason"] for one in report["scenarios"]}
    assert reasons["px4_refuses_hold"] == "estimator_jump"
    assert reasons["pilot_position"] == "mode_changed"


def test_the_same_seed_is_the_same_flight(twice: list[Path]) -> None:
    assert (twice[0] / "report.json").read_text() == (twice[1] / "report.json").read_text()
    for name in HANDFUL:
        first, second = (read_flight(folder / name) for folder in twice)
        assert len(first.ticks) > 300
        assert first.ticks.tobytes() == second.ticks.tobytes()
        assert first.events == second.events


def test_a_failed_scenario_is_exit_1_and_leaves_its_flight(tmp_path: Path) -> None:
    done = companion(
        "sitl", "--scenarios", "fence", "free_flight", "--set", "guards.fence={enabled: false}", cwd=tmp_path
    )
    assert done.returncode == 1, done.stderr
    assert "ended for mission_complete" in " ".join(done.stdout.split())
    assert "1 of 2 scenarios passed" in done.stdout
    (kept,) = (tmp_path / "flights").iterdir()
    assert [folder.name for folder in kept.iterdir()] == ["fence"]
    assert (kept / "fence" / "flight.mcap").exists()


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["--scenarios", "nosuch*"], "nosuch*"),
        (["--scenarios", "wind", "--serve"], "--serve"),
    ],
)
def test_what_cannot_be_flown_is_one_line(arguments: list[str], complaint: str, tmp_path: Path) -> None:
    done = companion("sitl", *arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert done.stdout == ""
    assert complaint in done.stderr
    assert done.stderr.strip().count("\n") == 0


def test_a_configured_bad_link_is_flown_in_lockstep_too(tmp_path: Path) -> None:
    """Plant and companion in processes of their own, frames late, lost and garbled both ways."""
    bad = "{delay_s: 0.006, jitter_s: 0.004, loss: 0.02, reordering: 0.02, corruption: 0.02}"
    arguments = [
        ROOT / "config" / "px4_quadrotor.yaml", "--hedging", "--json", "--set", "tick.rate_hz=125",
        "--set", "mission.duration_s=6", "--set", "mission.waypoints=[{at_s: 1, offset_ned_m: [0.5, 0, 0]}]",
        "--set", f"plant.link={{down: {bad}, up: {bad}}}", "--set", "plant.wind={mean_ned_m_s: [3, 0, 0]}",
    ]  # fmt: skip
    reports = []
    for name in ("a", "b"):
        done = companion("sitl", *arguments, "--out", tmp_path / name, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        reports.append(json.loads(done.stdout)["controllers"])
    assert reports[0] == reports[1]
    assert reports[0]["hedged"]["peak_error_m"] < 0.3
