"""What a report says of a flight, and how large its page is."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from companion.cli import main
from companion.config import load_config
from companion.config.guards.rows import Reason
from companion.errors import CompanionError
from companion.flight.authority.states import State
from companion.flight.guards.attitude_response import ResponseBand
from companion.record.reader import read_flight
from companion.report import guards
from companion.report.model import Report
from companion.report.page import decimated, page
from companion.report.reading import read

PANELS = {
    "position-north", "position-east", "position-up", "tracking", "from-setpoint", "velocity", "attitude-x",
    "attitude-y", "position-weight", "velocity-weight", "bias-weight", "hedge", "thrust", "guards", "variance",
    "ratios", "tick",
}  # fmt: skip


def said(report: Report, heading: str) -> str:
    return "\n".join(dict(report.verdict)[heading])


@pytest.mark.parametrize(
    ("name", "reason", "words"),
    [
        ("pilot_hold", "mode_changed", "the pilot chose HOLD"),
        ("gps_lost", "position_variance", "unsure where it is"),
        ("tilt_error", "tilt_error", "off its set-point"),
    ],
)
def test_the_verdict_says_why_it_ended(flights: dict[str, Path], name: str, reason: str, words: str) -> None:
    why = said(read(flights[name]), "Why it ended")
    assert words in why
    assert f"({reason})" in why


def test_every_panel_of_a_flight_has_data(flights: dict[str, Path]) -> None:
    report = read(flights["gps_lost"])
    panels = {panel.id: panel for panel in report.panels}
    assert panels.keys() >= PANELS
    for panel in report.panels:
        assert len(panel.time_s) > 20
        assert all(len(series.values) == len(panel.time_s) for series in panel.series)
        assert np.isfinite(panel.series[0].values).any(), panel.id


@pytest.mark.parametrize(("name", "guard"), [("gps_lost", "position_variance_m2"), ("tilt_error", "tilt_error_deg")])
def test_the_guard_that_ended_it_stands_first_and_beyond_its_limit(
    flights: dict[str, Path], name: str, guard: str
) -> None:
    report = read(flights[name])
    near = next(near for near in report.guards if near.guard == guard)
    assert near.share > 1.0
    assert guard in said(report, "What came near its limit")
    assert "timeout" not in next(line for line in dict(report.verdict)["What came near its limit"] if guard in line)
    told = re.search(r"the limit ([\d.]+)", said(report, "Why it ended"))
    assert told is not None
    assert near.limit == pytest.approx(float(told[1]), rel=0.01)


def test_the_band_is_the_one_of_the_guard(flights: dict[str, Path]) -> None:
    """How far outside it the attitude was, as the guard in flight would have measured it."""
    folder = flights["pilot_hold"]
    config = load_config(folder / "config.yaml")
    ticks = read_flight(folder).ticks
    looked = guards.looks(ticks[ticks["state"] == State.ENGAGED])
    edges = guards.certified_band(config, looked)
    ours = guards.measured(config, looked, edges)[Reason.ATTITUDE_RESPONSE]
    band = ResponseBand(config.attitude.x, config.attitude.y)
    at, wanted = (guards.directions(looked[key]) for key in ("attitude_q_wxyz", "setpoint_q_wxyz"))
    heading = guards.headings(looked["setpoint_q_wxyz"])
    theirs = [
        band.advance(0.02 * i, heading[i], tuple(at[i, :2].tolist()), tuple(wanted[i, :2].tolist()))
        for i in range(len(looked))
    ]
    assert np.abs(ours - theirs).max() < 0.002
    assert np.ptp(edges[0][1]) > 0.01  # type: ignore[index]


def test_a_page_is_self_contained_and_the_same_twice(flights: dict[str, Path]) -> None:
    reports = [read(flights["pilot_hold"]), read(flights["gps_lost"])]
    made = page(reports)
    assert made == page(reports)
    assert len(made.encode()) < 1_500_000
    assert "{{" not in made.split("<script>")[0]
    assert not re.search(r"(?:src|href)=[\"']?(?:https?:)?//", made)


def test_peaks_and_gaps_survive_decimation() -> None:
    values = np.sin(np.linspace(0, 60, 100_000))
    values[50_003], values[70_000:70_500] = 9.0, np.nan
    kept = decimated(values, 1000)
    assert len(kept) < 1100
    assert {0, 50_003, 70_000, 70_499, 99_999} <= set(kept.tolist())


def test_bad_input_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "empty.ulg").write_bytes(b"ULog")
    for wrong, words in (("nowhere", "no such file"), ("empty.ulg", "not a readable ULog"), (".", "flight.mcap")):
        with pytest.raises(CompanionError, match=words):
            read(tmp_path / wrong)
    with pytest.raises(SystemExit) as ended:
        main(["report", str(tmp_path / "nowhere")])
    assert ended.value.code == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_the_command_writes_the_page(flights: dict[str, Path], tmp_path: Path) -> None:
    out = tmp_path / "page.html"
    with pytest.raises(SystemExit) as ended:
        main(["report", str(flights["tilt_error"]), "--out", str(out)])
    assert ended.value.code == 0
    assert "tilt_error" in out.read_text(encoding="utf-8")
