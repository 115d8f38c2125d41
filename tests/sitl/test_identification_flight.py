"""From a flight to a flight with no hand in between: doublets in a noisy plant, identify, check, run in real time."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from harness.command import companion
from harness.processes import PATIENT, ROOT, finish, served

from companion.config import load_config
from companion.config.estimator import PRESETS
from companion.identify.identification import identify_log
from companion.record.reader import read_flight
from sitl.experiment.against import fly_against

PX4 = ROOT / "config" / "px4_quadrotor.yaml"
# Wind with a drift of its own, an estimate that is noisy and late, and a link that delays and loses.
NOT_IDEAL = """\
  setpoint_delay_s: 0.03
  seed: 3
  wind: {mean_ned_m_s: [2, 1, 0], gust: {peak_ned_m_s: [0.5, 0.5, 0], start_s: 2, hold_s: 1, every_s: 9}}
  sensors: {position_m: 0.01, velocity_m_s: 0.01, attitude_deg: 0.2, delay_s: 0.004}
  link:
    down: {delay_s: 0.004, jitter_s: 0.002, loss: 0.005}
    up: {delay_s: 0.004, jitter_s: 0.002}
"""
BUSY = ("--set", "guards.link_delay_s.timeout_s=30")  # the machine's other work is no news here
LINK_S = 0.004 + 0.001 + 0.004 + 0.001  # both ways, with the mean of the jitter
IDENTIFY = "mission={identification: {}}"
TRUE = {"roll": (9.7, 0.94), "pitch": (9.5, 0.92)}


def fly_for_real(config: Path, out: Path) -> tuple[int, str, str]:
    """`companion run` by the wall clock against a plant in a process of its own."""
    short = (
        "--set", "mission.duration_s=4", "--set", "mission.waypoints=[{at_s: 1, offset_ned_m: [0.3, 0, 0]}]",
    )  # fmt: skip
    with served(config=config) as port:
        link = ("--link", f"udpout://127.0.0.1:{port}")
        ended = finish("run", config, *link, "--engage", "--out", out, *short, *PATIENT, *BUSY)
    return ended.returncode, ended.stdout, ended.stderr


@pytest.mark.slow
@pytest.mark.realtime
def test_doublets_identify_check_run(tmp_path: Path) -> None:
    """Acceptance 4."""
    mine, folder = tmp_path / "my.yaml", tmp_path / "identification"
    even = PX4.read_text().replace("telemetry: px4", "telemetry: even")  # what PX4 adds is part of what is found
    plain = re.sub(r"  sensors: \{preset: gps\}.*\n", "", even)
    mine.write_text(plain.replace("  setpoint_delay_s: 0.03\n", NOT_IDEAL))

    # the flight
    flight = companion("sitl", mine, "--identify", "--out", folder, "--json")
    assert flight.returncode == 0, flight.stderr
    assert json.loads(flight.stdout) == {
        "config": str(mine),
        "complete": True,
        "reason": "mission_complete",
        "flights": [str(folder / "hedged")],
    }
    assert read_flight(folder / "hedged").events[-1].name == "released_mission_complete"

    # the response: what it is, its delay with the link's
    before = load_config(mine)
    identified = companion("identify", folder / "hedged", "--config", mine, "--write", "--json")
    assert identified.returncode == 0, identified.stderr
    axes = json.loads(identified.stdout)["axes"]
    for angle, (frequency, damping) in TRUE.items():
        axis = axes[angle]
        assert axis["chosen"] == "second_order_delay"
        assert axis["manoeuvres"] >= 3
        found = axis["models"]["second_order_delay"]
        assert found["fit"] > 0.995
        assert found["natural_frequency_rad_s"] == pytest.approx(frequency, rel=0.1)
        assert found["damping_ratio"] == pytest.approx(damping, rel=0.1)
        assert found["delay_s"] == pytest.approx(0.03 + LINK_S, abs=0.012)
        assert axis["delay"]["link_s"] == pytest.approx(LINK_S, abs=0.004)
    written = load_config(mine)
    assert written.attitude != before.attitude
    assert written.model_copy(update={"attitude": before.attitude}) == before, "nothing else changed"

    # the certificate
    certificate = tmp_path / "my.certificate.json"
    checked = companion("check", mine, "--quick", "--out", certificate, "--json")
    assert checked.returncode == 0, checked.stderr + checked.stdout
    assert certificate.exists()

    # and the flight that it covers, where `run` looks for it
    code, out, err = fly_for_real(mine, tmp_path / "flights")
    assert code == 0, out + err
    assert "UNCERTIFIED" not in out + err
    assert "released: mission_complete" in out


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("preset", sorted(PRESETS))
def test_doublets_are_flown_with_any_estimator(preset: str, seed: int, tmp_path: Path) -> None:
    """Issue 11: it completes, the response is the plant's, and the log tells how wrong the velocity was."""
    config = load_config(PX4, (IDENTIFY, f"plant.seed={seed}", f"plant.sensors={{preset: {preset}}}"))
    flown = fly_against(config, PX4, tmp_path, "hedged")
    assert flown.reason == "mission_complete"
    found = identify_log([tmp_path])
    for angle, (frequency, damping) in TRUE.items():
        model = found.axes[angle].models["second_order_delay"].named()
        assert model["natural_frequency_rad_s"] == pytest.approx(frequency, rel=0.1)
        assert model["damping_ratio"] == pytest.approx(damping, rel=0.1)
    if preset == "optical_flow":
        assert found.velocity_error is None, "nothing aids its position: the log cannot tell"
    else:
        assert found.velocity_error is not None
        assert found.velocity_error.deviation_m_s == pytest.approx(PRESETS[preset].deviation_m_s, rel=0.4)


def test_a_response_that_is_not_the_configs_is_flown_and_found(tmp_path: Path) -> None:
    """That of PX4 v1.18 with default parameters, 77 ms late: the shipped certificate ends at 45 ms."""
    response = "{natural_frequency_rad_s: 9.1, damping_ratio: 0.92}"
    late = ("plant.setpoint_delay_s=0.077", *(f"plant.quadrotor.{angle}={response}" for angle in TRUE))
    config = load_config(PX4, (IDENTIFY, "plant.sensors={preset: gps}", *late))
    assert fly_against(config, PX4, tmp_path, "hedged").reason == "mission_complete"
    axes = identify_log([tmp_path]).axes
    for angle in TRUE:
        found = axes[angle].models["second_order_delay"].named()
        assert found["natural_frequency_rad_s"] == pytest.approx(9.1, rel=0.1)
        assert found["delay_s"] == pytest.approx(0.077, abs=0.012)


def test_run_identifies_without_a_certificate_and_says_why(tmp_path: Path) -> None:
    """The README's own first step on a config of one's own. Nobody is at the other end of the link."""
    mine = tmp_path / "my.yaml"
    mine.write_text(PX4.read_text())
    link = ("--link", "udpout://127.0.0.1:9", "--set", "link.connect_timeout_s=0.5", "--out", tmp_path / "flights")
    ended = finish("run", mine, "--identify", *link)
    assert ended.returncode == 2
    assert "no certificate is needed to identify: it flies with fixed weights, 1.5 rad/s" in ended.stdout
    assert "UNCERTIFIED" not in ended.stdout + ended.stderr
    refused = finish("run", mine, *link)
    assert "no certificate" in refused.stderr.lower() or "no such file" in refused.stderr.lower()
    assert "no certificate is needed" not in refused.stdout
