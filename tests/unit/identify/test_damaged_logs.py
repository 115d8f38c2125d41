"""Logs damaged at random end with numbers that agree with the undamaged log's, or with one line; kind by kind.

`benchmarks/damaged_logs.py` does the same with thousands, each in a process whose time and memory are measured.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from random import Random

import pytest
from harness.damaged_logs import OF_TLOG, OF_ULOG, Damage, clock_of_ulog, cut, flips, hole, swaps
from harness.identified import complaints, outcome
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from companion.identify.identification import Identification
from companion.identify.logs import read_log
from companion.identify.series import LogError

Cut = Callable[[str], Path]
ULOG, TLOG = "px4_sih_attitude_p4.ulg", "px4_sih_doublets_p3.tlog"
KINDS = [(ULOG, damage) for damage in OF_ULOG] + [(TLOG, damage) for damage in OF_TLOG]


@pytest.fixture(scope="module")
def clean(request: pytest.FixtureRequest) -> dict[str, Identification]:
    unpacked: Cut = request.getfixturevalue("cut")
    found = {name: outcome(unpacked(name)) for name in (ULOG, TLOG)}
    assert all(isinstance(each, Identification) for each in found.values())
    return found  # type: ignore[return-value]


@pytest.mark.parametrize(("name", "damage"), KINDS, ids=[f"{n[-4:]} {d.__name__}" for n, d in KINDS])
def test_a_damaged_log_gives_the_numbers_or_one_line(
    name: str, damage: Damage, request: pytest.FixtureRequest, clean: dict[str, Identification], tmp_path: Path
) -> None:
    whole = request.getfixturevalue("cut")(name).read_bytes()
    path = tmp_path / f"damaged{name[-5:]}"
    path.write_bytes(damage(whole, Random(1)))
    assert complaints(path, outcome(path), clean[name]) == []


@pytest.mark.parametrize("damage", [cut, hole, flips, swaps, clock_of_ulog])
@settings(max_examples=12, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(seed=st.integers(0, 1 << 32))
def test_reading_ends_with_samples_in_order_or_one_line(
    seed: int, damage: Damage, cut_ulog: bytes, tmp_path: Path
) -> None:
    path = tmp_path / "damaged.ulg"
    path.write_bytes(damage(cut_ulog, Random(seed)))
    recording, line = None, ""
    try:
        recording = read_log(path)
    except LogError as error:
        line = str(error)
    if recording is None:
        assert line.startswith(str(path))
        assert len(line.splitlines()) == 1
        return
    for times in (recording.track.attitude_time_s, recording.track.setpoint_time_s, recording.following.ravel()):
        assert (times[1:] > times[:-1]).all()
    assert (abs(recording.track.attitude_rad) < 3.2).all()


@pytest.fixture(scope="module")
def cut_ulog(request: pytest.FixtureRequest) -> bytes:
    return bytes(request.getfixturevalue("cut")(ULOG).read_bytes())
