"""Log download, both sides without a link: the plant's answers reach the client through a wire that loses them."""

from __future__ import annotations

import random
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import development as mavlink

from companion.mavlink.codec import Encoder, Frame, FrameParser
from companion.mavlink.logs import ulog
from companion.mavlink.logs.client import newest
from companion.mavlink.logs.protocol import LOG_DATA, LOG_ENTRY, LogEntry, LogFetch, LogList, Pace
from sitl.messages.log_card import LogFile, synthetic_log
from sitl.messages.log_download import LogDownload

STEP_S = 0.01


class Wire:
    """The vehicle's log service behind a wire that loses a share of its frames, and may turn their order round."""

    def __init__(self, logs: list[LogFile], lost: float = 0.0, seed: int = 1, *, shuffled: bool = False) -> None:
        self.vehicle = LogDownload(logs)
        self.now_s = 0.0
        self.largest_burst = 0
        self._lost, self._shuffled = lost, shuffled
        self._random = random.Random(seed)
        self._pymavlink = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
        self._encoder = Encoder(LOG_DATA, 1, 1)
        self._parser = FrameParser()

    def ask(self, messages: list[Any]) -> None:
        for message in messages:
            if self._random.random() >= self._lost:
                {
                    "LOG_REQUEST_LIST": self.vehicle.request_list,
                    "LOG_REQUEST_DATA": self.vehicle.request_data,
                    "LOG_REQUEST_END": self.vehicle.request_end,
                }[message.get_type()](message)

    def frames(self) -> list[Frame]:
        """What comes through in the next 10 ms."""
        self.now_s += STEP_S
        sent = self.vehicle.send(
            round(1e6 * self.now_s), lambda m: bytes(m.pack(self._pymavlink)), lambda *v: self._encoder.encode(0, *v)
        )
        self.largest_burst = max(self.largest_burst, len(sent))
        kept = [frame for frame in sent if self._random.random() >= self._lost]
        if self._shuffled:
            self._random.shuffle(kept)
        return self._parser.feed(b"".join(kept))


def listed(wire: Wire) -> LogList:
    listing = LogList(1, 1)
    while not listing.over(wire.now_s):
        wire.ask(listing.requests(wire.now_s))
        for frame in wire.frames():
            if frame.message_id == LOG_ENTRY.message_id:
                listing.take(frame, wire.now_s)
    return listing


def fetched(wire: Wire, fetch: LogFetch, until: int | None = None, timeout_s: float = 300.0) -> bytes:
    """What `fetch` gets, up to its end or to an offset."""
    data = b""
    while not fetch.done and (until is None or fetch.offset < until):
        assert wire.now_s < timeout_s
        assert not fetch.stalled(wire.now_s)
        wire.ask(fetch.requests(wire.now_s))
        for frame in wire.frames():
            if frame.message_id == LOG_DATA.message_id:
                data += fetch.take(frame, wire.now_s)
    return data


@settings(max_examples=40)
@given(
    size=st.integers(19, 30_000),
    lost=st.sampled_from([0.0, 0.05, 0.3]),
    shuffled=st.booleans(),
    seed=st.integers(0, 1000),
    frames=st.integers(1, 200),
)
def test_every_byte_comes_whatever_is_lost(size: int, lost: float, shuffled: bool, seed: int, frames: int) -> None:
    log = synthetic_log(size, seed)
    logs = [synthetic_log(100), log]
    entry = listed(Wire(logs)).entries[1]
    wire = Wire(logs, lost, seed, shuffled=shuffled)
    wire.vehicle.request_list(mavlink.MAVLink_log_request_list_message(1, 1, 0, 0xFFFF))
    fetch = LogFetch(1, 1, entry, pace=Pace(max(frames, size // 9000), 0.0))
    assert fetched(wire, fetch) == log.data
    assert lost or shuffled or fetch.repeated == 0


@given(st.integers(0, 20_000))
def test_a_partial_file_is_continued_where_it_ends(start: int) -> None:
    log = synthetic_log(20_000, 7)
    wire = Wire([log], 0.1)
    entry = listed(wire).entries[0]
    assert fetched(wire, LogFetch(1, 1, entry, start)) == log.data[start:]


def test_a_log_that_has_grown_since_it_was_listed_ends_where_it_did() -> None:
    log = synthetic_log(20_000, 7)
    wire = Wire([log])
    entry = listed(wire).entries[0]._replace(size_bytes=12_345)
    assert fetched(wire, LogFetch(1, 1, entry)) == log.data[:12_345]


def test_what_is_handed_out_never_has_a_hole() -> None:
    log = synthetic_log(50_000, 3)
    wire = Wire([log], 0.3, shuffled=True)
    fetch = LogFetch(1, 1, listed(wire).entries[0])
    data = fetched(wire, fetch, until=20_000)
    assert 20_000 <= len(data) < 50_000
    assert data == log.data[: len(data)]
    assert fetch.offset == len(data)


def test_a_request_is_one_burst_of_the_size_asked_for() -> None:
    wire = Wire([synthetic_log(20_000)])
    fetched(wire, LogFetch(1, 1, listed(wire).entries[0], pace=Pace(10, 0.0)))
    assert wire.largest_burst == 10


def test_beside_a_flight_it_asks_no_faster_than_its_pace() -> None:
    wire = Wire([synthetic_log(18_000)])
    entry = listed(wire).entries[0]
    began_s = wire.now_s
    fetched(wire, LogFetch(1, 1, entry, pace=Pace(10, 0.1)))
    assert wire.now_s - began_s == pytest.approx(2.0, abs=0.15), "20 requests, a tenth of a second apart"


def test_data_of_another_log_or_another_grid_is_left_alone() -> None:
    fetch = LogFetch(1, 1, LogEntry(1, 1000, 0), start=10)
    fetch.requests(0.0)
    encoder = Encoder(LOG_DATA, 1, 1)
    for offset, number, count in (
        (10, 0, 90),
        (0, 1, 90),
        (55, 1, 90),
        (10, 1, 91),
        (10, 1, 0),
        (10, 1, 50),
        (910, 1, 90),
    ):
        (frame,) = FrameParser().feed(encoder.encode(0, offset, number, count, *bytes(90)))
        assert fetch.take(frame, 0.0) == b"", (offset, number, count)
    (frame,) = FrameParser().feed(encoder.encode(0, 910, 1, 90, *bytes(range(90))))
    assert fetch.take(frame, 0.0) == b""
    assert fetch.offset == 10


def test_what_is_served_beyond_the_size_listed_is_left_out() -> None:
    """PX4 serves a log that is being written beyond what it listed; found by fuzzing."""
    fetch = LogFetch(1, 1, LogEntry(1, 26, 0))
    assert fetch.requests(0.0)
    frame = FrameParser().feed(Encoder(LOG_DATA, 1, 1).encode(0, 0, 1, 90, *range(90)))[0]
    assert fetch.take(frame, 0.0) == bytes(range(26))
    assert (fetch.done, fetch.offset) == (True, 26)


def test_a_vehicle_that_falls_silent_is_told_of() -> None:
    log = synthetic_log(50_000)
    wire = Wire([log])
    fetch = LogFetch(1, 1, listed(wire).entries[0])
    fetched(wire, fetch, until=10_000)
    silent_s = wire.now_s
    while not fetch.stalled(wire.now_s):
        fetch.requests(wire.now_s)
        wire.now_s += STEP_S
    assert 9.0 < wire.now_s - silent_s < 11.0
    assert not fetch.done


def test_no_logs_is_silence_and_silence_ends() -> None:
    wire = Wire([])
    listing = listed(wire)
    assert listing.total is None
    assert listing.entries == {}
    assert not listing.done
    assert 19.0 < wire.now_s < 21.0


@pytest.mark.parametrize("told", [1_700_000_000, 0, 946_684_800 + 700, 300], ids=["dated", "0", "2000", "1970"])
def test_only_a_time_that_is_one_names_a_log(told: int) -> None:
    entry = LogEntry(3, 1234, told)
    assert entry.dated is (told == 1_700_000_000)
    assert entry.file_name == ("2023-11-14_22-13-20_1234.ulg" if entry.dated else "log_003_1234.ulg")
    by_ftp = entry._replace(path="sess007/log001.ulg")
    assert by_ftp.file_name == ("2023-11-14_22-13-20_1234.ulg" if entry.dated else "sess007_log001_1234.ulg")


def test_sessions_are_in_the_order_of_their_number_and_a_clock_that_was_not_set_says_nothing() -> None:
    entries = [
        LogEntry(number, 1000, 946_684_800 + 100 - number, f"sess{session}/log001.ulg")
        for number, session in enumerate(["1000", "999", "002"])
    ]
    assert [entry.path[4:8].strip("/") for entry in sorted(entries, key=lambda e: e.order)] == ["002", "999", "1000"]
    listed_only = [entry._replace(path="") for entry in entries]
    assert newest(listed_only) == [listed_only[-1]], "the last of the list, whatever its clock said"
    dated = LogEntry(0, 1000, 1_700_000_000)
    assert newest([dated, *listed_only]) == [dated, listed_only[-1]]


def test_entries_that_never_come_are_not_waited_for_for_ever() -> None:
    for lost in ({2}, {4}, {0, 4}):
        logs = [synthetic_log(100 + number)._replace(told=number not in lost) for number in range(5)]
        wire = Wire(logs)
        listing = listed(wire)  # a request from the third on brings those again that are known
        assert listing.entries.keys() == set(range(5)) - lost
        assert not listing.done
        assert wire.now_s < 15.0


@pytest.mark.parametrize("seek_s", [0.1, 0.4, 1.2])
def test_a_list_that_restarts_at_each_request_comes_to_its_end(seek_s: float) -> None:
    wire = Wire([synthetic_log(100 + number)._replace(seek_s=seek_s) for number in range(5)])
    assert listed(wire).done
    assert wire.now_s < 5 * seek_s + 8.0


def test_a_list_that_changes_on_the_way_is_begun_anew() -> None:
    listing = LogList(1, 1)
    listing.requests(0.0)
    pymavlink = mavlink.MAVLink(None, 1, 1)
    for total, number in ((3, 0), (3, 1), (4, 2), (4, 3)):
        message = mavlink.MAVLink_log_entry_message(number, total, total, 1_700_000_000, 1000)
        (frame,) = FrameParser().feed(bytes(message.pack(pymavlink)))
        listing.take(frame, 0.1)
    assert listing.entries.keys() == {2, 3}
    (asked,) = listing.requests(1.5)
    assert asked.start == 0


def test_another_autopilot_says_that_it_has_none() -> None:
    message = mavlink.MAVLink_log_entry_message(id=0, num_logs=0, last_log_num=0, time_utc=0, size=0)
    (frame,) = FrameParser().feed(bytes(message.pack(mavlink.MAVLink(None, 1, 1))))
    listing = LogList(1, 1)
    listing.requests(0.0)
    listing.take(frame, 0.1)
    assert listing.done
    assert listing.entries == {}


def test_a_long_list_survives_loss() -> None:
    logs = [synthetic_log(19 + number, number, 1000 + number) for number in range(60)]
    listing = listed(Wire(logs, 0.3, seed=5))
    assert [listing.entries[number].size_bytes for number in range(60)] == [len(log.data) for log in logs]


def test_px4_serves_no_data_before_the_list() -> None:
    wire = Wire([synthetic_log(1000)])
    wire.ask(LogFetch(1, 1, LogEntry(0, 1000, 0)).requests(0.0))
    assert wire.frames() == []


def test_erased_unless_armed() -> None:
    vehicle = LogDownload([synthetic_log(100)])
    vehicle.erase(armed=True)
    assert len(vehicle.logs) == 1
    vehicle.erase(armed=False)
    assert vehicle.logs == []


def test_a_log_is_named_by_when_it_was_written_and_its_size() -> None:
    assert LogEntry(3, 1234, 1_700_000_000).file_name == "2023-11-14_22-13-20_1234.ulg"
    assert LogEntry(3, 1234, 0).file_name == "log_003_1234.ulg"
    assert LogEntry(3, 1234, 1_700_000_000).file_name != LogEntry(3, 1235, 1_700_000_000).file_name


# --- the check of what has come -------------------------------------------------------------------------------------


def test_a_whole_log_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "a.ulg"
    path.write_bytes(synthetic_log(10_000).data)
    extent = ulog.extent(path)
    assert extent.problem is None
    assert extent.bytes_read == 10_000
    assert extent.messages == 39


def test_a_hole_breaks_the_chain(tmp_path: Path) -> None:
    data = bytearray(synthetic_log(10_000).data)
    path = tmp_path / "a.ulg"
    data[4200:4800] = bytes(600)
    path.write_bytes(data)
    problem = ulog.extent(path).problem
    assert problem is not None
    assert "broken at byte" in problem


def test_a_cut_log_and_no_log(tmp_path: Path) -> None:
    path = tmp_path / "a.ulg"
    path.write_bytes(synthetic_log(10_000).data[:-7])
    assert "cut short" in (ulog.extent(path).problem or "")
    path.write_bytes(b"not a log")
    assert "not a ULog" in (ulog.extent(path).problem or "")
    path.write_bytes(b"")
    assert "not a ULog" in (ulog.extent(path).problem or "")


def test_a_synthetic_log_has_its_size_and_none_is_smaller_than_a_message() -> None:
    assert [len(synthetic_log(size).data) for size in range(19, 600)] == list(range(19, 600))
    with pytest.raises(ValueError, match="19"):
        synthetic_log(18)
