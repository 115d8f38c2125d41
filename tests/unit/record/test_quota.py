"""Room for a flight: the oldest flights go first, never one that is written or kept, nor anything that is none."""

from __future__ import annotations

import re
import time
from pathlib import Path

import pytest
from harness.processes import eventually
from harness.small_disk import small_disk

from companion.config import load_config
from companion.record.folder import open_folder
from companion.record.quota import Quota
from companion.record.reader import read_flight
from companion.record.recorder import EVENT, RECEIVED, Recorder
from companion.record.schema import pack_event

RIG = Path(__file__).resolve().parents[3] / "config" / "antx_rig.yaml"
MB = 1_000_000
BLOCK = bytes(MB // 4)


def flight(parent: Path, name: str, megabytes: float = 1.0) -> Path:
    """A folder as a flight leaves it."""
    folder = parent / name
    folder.mkdir()
    (folder / "traffic.tlog").write_bytes(bytes(round(megabytes * MB / 2)))
    (folder / "flight.mcap").write_bytes(bytes(round(megabytes * MB / 2)))
    (folder / "config.yaml").write_text("# as flown\n")
    return folder


def day(number: int) -> str:
    return f"2026-01-{number:02}T10-00-00-antx_rig"


def names(parent: Path) -> set[str]:
    return {path.name for path in parent.iterdir()}


def test_the_oldest_go_until_the_quota_is_kept(tmp_path: Path) -> None:
    for number in (3, 1, 5, 2, 4):
        flight(tmp_path, day(number))
    current = flight(tmp_path, day(1) + "-2")  # its own clock is off: older than most, and never touched
    assert Quota(current, round(3.5 * MB), 0).make_room() is None
    assert names(tmp_path) == {current.name, day(4), day(5)}
    assert Quota(current, round(3.5 * MB), 0).make_room() is None
    assert names(tmp_path) == {current.name, day(4), day(5)}
    assert Quota(current, MB // 2, 0).make_room() == "the flights take more than log.quota_gb (0.0005 GB)"
    assert names(tmp_path) == {current.name}


def test_what_is_no_flight_or_is_kept_stays(tmp_path: Path) -> None:
    (tmp_path / "notes").mkdir()
    (tmp_path / "notes" / "flight.mcap").write_bytes(BLOCK)
    (tmp_path / day(1)).mkdir()  # somebody else's folder of such a name
    (tmp_path / day(1) / "thesis.tex").write_bytes(BLOCK)
    (flight(tmp_path, day(2)) / "keep").touch()
    (flight(tmp_path, day(3)) / "report.html").write_text("mine")
    elsewhere = flight(tmp_path.parent, f"elsewhere-{tmp_path.name}")
    (tmp_path / day(4)).symlink_to(elsewhere)
    current = flight(tmp_path, day(6))
    assert Quota(current, 1, 0).make_room() is not None
    assert names(tmp_path) == {"notes", day(1), day(2), day(3), day(4), current.name}
    assert names(tmp_path / day(1)) == {"thesis.tex"}
    assert names(tmp_path / day(2)) == {"keep", "traffic.tlog", "flight.mcap", "config.yaml"}
    assert names(tmp_path / day(3)) == {"report.html"}
    assert len(names(elsewhere)) == 3


def test_a_flight_that_another_companion_is_writing_stays(tmp_path: Path) -> None:
    """Though it is the oldest; once it is over it is as any other."""
    written, current = tmp_path / day(1), flight(tmp_path, day(9))
    written.mkdir()
    recorder = Recorder(written)
    assert eventually(lambda: (written / "flight.mcap").exists() and (written / "traffic.tlog").exists())
    time.sleep(0.2)
    assert Quota(current, 1, 0).make_room() is not None
    assert (written / "flight.mcap").exists()
    assert recorder.close() is None
    Quota(current, 1, 0).make_room()
    assert names(tmp_path) == {current.name}


def test_a_flight_makes_room_for_itself_and_ends_its_log_where_it_cannot(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """A real writer: 40 MB of frames at a quota of 20 MB, beside two old flights. The reason of its end is kept."""
    for number in (1, 2):
        flight(tmp_path, day(number), 8.0)
    current = tmp_path / day(3)
    config = load_config(RIG, ("log.quota_gb=0.02", "log.free_gb=0"))
    recorder = open_folder(current, RIG, config, blocking=True)
    for n in range(160):
        recorder.add(RECEIVED, n, BLOCK)
        recorder.flush()
    recorder.add(EVENT, 7, pack_event("released_operator", ""))
    assert recorder.close() == f"{current}: the log is incomplete: the disk did not take it"
    err = capfd.readouterr().err
    deleted = re.findall(r"(\S+): deleted, it was the oldest flight: the flights take more than log\.quota_gb", err)
    assert deleted == [str(tmp_path / day(1)), str(tmp_path / day(2))]
    assert (
        "traffic.tlog: the flights take more than log.quota_gb (0.02 GB): the log ends here, the flight goes on" in err
    )
    assert names(tmp_path) == {current.name}
    assert 15 * MB < (current / "traffic.tlog").stat().st_size < 35 * MB
    assert [event.name for event in read_flight(current).events] == ["released_operator"]


def test_free_space_is_kept_for_others() -> None:
    with small_disk("40m") as parent:
        for number in (1, 2, 3):
            flight(parent, day(number), 8.0)
        current = flight(parent, day(4))
        assert Quota(current, 10**12, 20 * MB).make_room() is None
        assert names(parent) == {current.name, day(2), day(3)}
        said = Quota(current, 10**12, 60 * MB).make_room()
        assert said == "less than log.free_gb (0.06 GB) is free"
        assert names(parent) == {current.name}
