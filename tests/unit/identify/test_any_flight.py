"""Identification from what people fly, in the plant: sticks, Position mode, a mission; and two flights compared."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from harness.any_flight import CONTROL_S, KINDS, Flight, Truth, fly
from harness.identify_logs import mutated_ulog

from companion.cli import main
from companion.identify.comparison.compare import EQUAL, FASTER, SLOWER, compare
from companion.identify.identification import MANOEUVRES, PREDICTION, identify, identify_log
from companion.identify.series import LogError

FULL = Path(__file__).resolve().parents[4] / "shared" / "data" / "px4_sih_attitude_p4.ulg"
SLOW = {axis: Truth(7.0, 0.8, 0.03) for axis in ("roll", "pitch")}
QUICK = {axis: Truth(9.1, 0.8, 0.03) for axis in ("roll", "pitch")}
Cut = Callable[[str], Path]


@pytest.fixture(scope="module")
def flights() -> dict[str, Flight]:
    """One of each kind, long enough."""
    return {kind: fly(kind, 3, {"mission": 150.0}.get(kind, 75.0), SLOW) for kind in KINDS}


@pytest.mark.parametrize("kind", KINDS)
def test_the_truth_is_inside_the_box_of_any_flight(kind: str, flights: dict[str, Flight]) -> None:
    flight = flights[kind]
    found = identify([flight.recording])
    assert found.refused == {}
    half_step = CONTROL_S / 2.0 if flight.recording.lateness_s > 0.015 else 0.0
    for name, axis in found.axes.items():
        assert axis.method == PREDICTION
        assert axis.chosen.model.name == "second_order_delay"
        truth = flight.truth[name]._replace(delay_s=flight.truth[name].delay_s + half_step)
        for value, (low, high) in zip(truth, axis.chosen.interval_95, strict=True):
            assert low <= value <= high
            assert high - low < 0.6 * value + 0.05


def test_a_short_or_a_quiet_flight_is_refused_with_what_to_fly(flights: dict[str, Flight]) -> None:
    recording = flights["position"].recording
    short = recording._replace(in_flight=np.array([[0.0, 30.0]]))
    with pytest.raises(LogError, match=r"not enough information in roll: 2\d s of flight .* 50 s are wanted"):
        identify([short])
    still = recording._replace(track=recording.track._replace(setpoint_rad=0.01 * recording.track.setpoint_rad))
    with pytest.raises(LogError, match=r"too little excitation"):
        identify([still])


def test_what_is_missing_is_told(flights: dict[str, Flight]) -> None:
    """Attitude noise as large as the motion itself: the box is too wide, and how much more is wanted is said."""
    recording = flights["stabilized"].recording
    noise = np.random.default_rng(1).normal(0.0, np.radians(40.0), recording.track.attitude_rad.shape)
    noisy = recording._replace(track=recording.track._replace(attitude_rad=recording.track.attitude_rad + noise))
    with pytest.raises(LogError, match=r"not enough information in roll: \w+ is known to ± .* times as much"):
        identify([noisy])


def test_a_flight_with_a_gap_uses_what_is_whole(flights: dict[str, Flight]) -> None:
    recording = flights["mission"].recording
    track = recording.track
    keep = (track.attitude_time_s < 40.0) | (track.attitude_time_s > 43.0)
    gap = recording._replace(
        track=track._replace(attitude_time_s=track.attitude_time_s[keep], attitude_rad=track.attitude_rad[keep])
    )
    for axis in identify([gap]).axes.values():
        assert all(m.end_s <= 40.1 or m.start_s >= 43.0 for m in axis.manoeuvres)


@pytest.mark.skipif(not FULL.exists(), reason="the full recordings are not beside this clone")
def test_a_ulog_in_position_mode_serves_once_it_is_off_the_ground(tmp_path: Path) -> None:
    """The real recording as if PX4 had flown it in Position mode: what was fitted to its doublets is in the box."""

    def in_position_mode(topics: dict[str, dict[str, Any]]) -> None:
        state = topics["vehicle_status"]["nav_state"]
        state[state == 14] = 2
        topics["vehicle_control_mode"]["flag_control_position_enabled"][:] = 1

    found = identify_log([mutated_ulog(FULL, tmp_path / "position.ulg", in_position_mode)])
    doublets = identify_log([FULL])
    for name, axis in found.axes.items():
        known = doublets.axes[name]
        assert (axis.method, known.method) == (PREDICTION, MANOEUVRES)
        assert axis.chosen.values[0] == pytest.approx(known.chosen.values[0], rel=0.15)


def test_equal_vehicles_are_not_told_apart_and_a_quicker_one_is(flights: dict[str, Flight]) -> None:
    before = identify([flights["position"].recording])
    again = identify([fly("position", 4, 75.0, SLOW).recording])
    quicker = identify([fly("position", 5, 75.0, QUICK).recording])
    assert {axis.verdict for axis in compare(before, again).axes.values()} == {EQUAL}
    assert {axis.verdict for axis in compare(before, quicker).axes.values()} == {FASTER}
    assert {axis.verdict for axis in compare(quicker, before).axes.values()} == {SLOWER}
    for axis in compare(before, quicker).axes.values():
        assert axis.ratio_95[0] < 1.3 < axis.ratio_95[1]


def test_the_command_compares_two_logs_and_draws(cut: Cut, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    p3, p4 = (str(cut(f"px4_sih_attitude_{name}.ulg")) for name in ("p3", "p4"))
    picture = tmp_path / "compared.png"
    with pytest.raises(SystemExit) as ended:
        main(["identify", "--compare", p3, p4, "--json", "--plot", str(picture)])
    out, err = capsys.readouterr()
    assert (ended.value.code, err) == (0, "")
    axes = json.loads(out)["axes"]
    assert {name: axis["verdict"] for name, axis in axes.items()} == {"roll": FASTER, "pitch": FASTER}
    for axis in axes.values():
        low, high = axis["bandwidth_ratio_95"]
        assert 1.0 < low < axis["bandwidth_ratio"] < high
    assert picture.read_bytes().startswith(b"\x89PNG")
    with pytest.raises(SystemExit) as ended:
        main(["identify", "--compare", p4, p4])
    assert ended.value.code == 0
    assert "roll: not distinguishable: bandwidth 6." in capsys.readouterr().out
    with pytest.raises(SystemExit) as ended:
        main(["identify", p3, "--compare", p3, p4])
    assert ended.value.code == 2
    assert "--compare takes two logs" in capsys.readouterr().err
    with pytest.raises(SystemExit) as ended:
        main(["identify"])
    assert ended.value.code == 2
    assert "required: LOG, or --compare BEFORE AFTER" in capsys.readouterr().err
