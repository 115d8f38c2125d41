"""Trajectories flown in the plant: nearer than PX4's own, every kind from file to flight, bad files in one line."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest
import yaml
from harness.command import companion
from harness.planner import PlannerLink, fly_streamed
from harness.processes import ROOT

from companion.commands.missions import overrides
from companion.config import load_config
from companion.record.reader import read_flight
from companion.trajectory.curves import Circle
from sitl.experiment.against import PathScores, fly_against

CONFIG = ROOT / "config" / "trajectories.yaml"
GPS_ADAPTATION = (  # of config/px4_quadrotor.yaml
    "controller.axes.x.lyapunov_q=[1, 0.07]", "controller.axes.y.lyapunov_q=[1, 0.07]",
    "controller.bias.adaptation_rate.hedged=9.9",
)  # fmt: skip


def flown(controller: str, folder: Path, *settings: str) -> PathScores:
    config = load_config(CONFIG, settings)
    scores = fly_against(config, CONFIG, folder / controller, controller).scores
    assert isinstance(scores, PathScores)
    return scores


def eight(speed_m_s: float) -> str:
    """As `--mission lemniscate --speed`."""
    (text,) = overrides("lemniscate", speed_m_s, stretch=False, identify=False)
    return text


@pytest.mark.parametrize(("speed_m_s", "most_m", "share"), [(2.0, 0.05, 0.25), (3.0, 0.12, 0.35)])
def test_a_figure_of_eight_is_nearer_than_px4_s_own(
    speed_m_s: float, most_m: float, share: float, tmp_path: Path
) -> None:
    """20 % too heavy, 5 m/s of wind with gusts, motion capture: as the config is shipped."""
    ours, theirs = (flown(controller, tmp_path, eight(speed_m_s)) for controller in ("hedged", "px4"))
    assert ours.truth_rms_m < most_m
    assert math.hypot(ours.truth_rms_m, ours.truth_height_rms_m) < most_m
    assert ours.truth_rms_m < share * theirs.truth_rms_m


def test_with_gps_too(tmp_path: Path) -> None:
    """With the adaptation that `design` chooses for GPS: the shipped one, for motion capture, chases its noise."""
    by_gps = ("plant.sensors.preset=gps", *GPS_ADAPTATION)
    ours, theirs = (flown(c, tmp_path, eight(2.0), *by_gps) for c in ("hedged", "px4"))
    assert ours.truth_rms_m < 0.7 * theirs.truth_rms_m


def test_a_planner_at_20_hz_with_30_ms_of_jitter_costs_a_tenth_at_most(tmp_path: Path) -> None:
    one_lap = "mission={trajectories: [{hold_s: 4}, {lemniscate: {speed_m_s: 2, laps: 1}}, {hold_s: 1}]}"
    by_file = flown("hedged", tmp_path, one_lap)
    by_stream, reason = fly_streamed(CONFIG, one_lap, PlannerLink(), 1, tmp_path / "stream")
    assert reason == "mission_complete"
    assert by_stream.truth_rms_m < 1.1 * by_file.truth_rms_m
    assert [event.name for event in read_flight(tmp_path / "stream").events].count("command_refused") == 0


def write_files(folder: Path) -> Path:
    """A mission of every kind."""
    circle = Circle(1.0, 1.0, 0.5, 2.0)
    rows = ["time_s,x_m,y_m,z_m"]
    rows += [
        ",".join(repr(float(v)) for v in (0.2 * k, *circle.at(0.2 * k)[:3])) for k in range(int(5 * circle.duration_s))
    ]
    (folder / "circle.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    degree = 1.0 / (math.radians(1.0) * 6371000.0)
    items = [
        {"type": "SimpleItem", "command": 16, "frame": 3, "params": [0, 0, 0, None, 1.0 + way_m * degree, 2.0, 5.0]}
        for way_m in (0.0, 2.0)
    ]
    plan = {"fileType": "Plan", "mission": {"plannedHomePosition": [1.0, 2.0, 0.0], "items": items}}
    (folder / "field.plan").write_text(json.dumps(plan), encoding="utf-8")
    mission = {
        "trajectories": [
            {"hold_s": 2.0},
            {"stairs": {"duration_s": 3.0, "waypoints": [{"at_s": 0.5, "offset_ned_m": [0.5, 0.0, 0.0]}]}},
            {"circle": {"radius_m": 1.0, "speed_m_s": 1.0, "laps": 0.5, "ramp_s": 1.0}},
            {"lemniscate": {"length_m": 2.0, "width_m": 1.0, "speed_m_s": 1.0, "laps": 0.5, "ramp_s": 1.0}},
            {
                "through": {
                    "places": [
                        {"offset_ned_m": [0.0, 0.0, 0.0]},
                        {"offset_ned_m": [1.0, 0.5, -0.5], "yaw_deg": 20},
                        {"offset_ned_m": [0.0, 1.0, 0.0]},
                    ]
                }
            },
            {"samples": {"file": "circle.csv"}},
            {"plan": {"file": "field.plan"}},
            {"circle": {"radius_m": 1.0, "speed_m_s": 1.0, "laps": 0.25}, "absolute": True, "offset_ned_m": [1, 1, -3]},
        ]
    }
    path = folder / "every.yaml"
    path.write_text(yaml.safe_dump(mission), encoding="utf-8")
    return path


def test_every_kind_flies_from_file_to_flight_over_sockets(tmp_path: Path) -> None:
    ended = companion(
        "sitl", CONFIG, "--mission", write_files(tmp_path), "--hedging", "--json", "--out", tmp_path / "out"
    )
    assert ended.returncode == 0, ended.stderr
    report = json.loads(ended.stdout)["controllers"]["hedged"]
    assert report["stable"]
    assert report["tracking_rms_m"] < 0.3


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--mission", "loop"), "--mission loop: none of hold, circle, lemniscate"),
        (("--speed", "2"), "name one"),
        (("--mission", "hold", "--speed", "2"), "a positive speed of --mission circle or lemniscate"),
        (("--mission", "lemniscate", "--speed", "nan"), "--speed nan"),
        (("--mission", "lemniscate", "--speed", "6"), "--stretch makes it"),
        (("--mission", "none.csv"), "none.csv: no such file"),
        (("--mission", "none.yaml"), "none.yaml: no such file"),
        (("--mission", "none.plan"), "none.plan: no such file"),
        (("--mission", "lemniscate", "--identify"), "leave out --mission"),
    ],
)
def test_what_cannot_be_flown_is_one_line(arguments: tuple[str, ...], words: str, tmp_path: Path) -> None:
    ended = companion("sitl", CONFIG, *arguments, "--out", tmp_path / "out")
    assert ended.returncode == 2
    assert words in ended.stderr
    assert len(ended.stderr.strip().splitlines()) == 1
