"""Logs from vehicles as they are, over a socket: no time, slow cards, entries that never come, MAVLink FTP."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from harness.command import companion
from harness.ports import free_port
from harness.processes import ROOT
from harness.running_plant import RunningPlant, autopilot, quadrotor
from pymavlink.dialects.v20 import development as mavlink

from companion.config import load_config
from companion.mavlink.client import Client
from companion.mavlink.codec import FrameParser
from companion.mavlink.link import LinkError
from companion.mavlink.logs.client import fetch, list_logs
from sitl.autopilot.autopilot import Autopilot
from sitl.autopilot.parameters import Parameters, Px4Version
from sitl.messages.log_card import LogFile, synthetic_log
from sitl.wire.ports import UdpEndpoint

pytestmark = pytest.mark.realtime
QUADROTOR = ROOT / "config" / "paper_quadrotor.yaml"
OLD = synthetic_log(4_000, 1, time_utc_s=1_700_000_000)
YOUNG = synthetic_log(5_000, 2, time_utc_s=1_700_000_900)
UNDATED = [  # none of these times says when
    synthetic_log(6_000, 3, time_utc_s=946_684_800 + 900),
    synthetic_log(7_000, 4, time_utc_s=0),
    synthetic_log(8_000, 5, time_utc_s=300),
]
V1_18 = Parameters({"MPC_THR_HOVER": 0.5}, Px4Version.V1_18)


@pytest.fixture
def logs() -> list[LogFile]:
    return [OLD, YOUNG]


@pytest.fixture
def pilot() -> Autopilot:
    return autopilot(quadrotor())


@pytest.fixture
def url(pilot: Autopilot, logs: list[LogFile]) -> Iterator[str]:
    """A plant with these logs, which calls a port as PX4 calls 14540, so that one tool after the other can use it."""
    port = free_port()
    with RunningPlant(pilot, endpoints=[UdpEndpoint(0, port)], logs=logs):
        yield f"udpin://127.0.0.1:{port}"


def asked(url: str, folder: Path, *options: str) -> tuple[int, str, dict[str, bytes]]:
    """Exit code and output of `companion logs`, and what is in its folder."""
    ended = companion("logs", QUADROTOR, "--link", url, "--out", folder, *options)
    assert ended.stderr == ""
    return ended.returncode, ended.stdout, {path.name: path.read_bytes() for path in folder.glob("*")}


@pytest.mark.parametrize("logs", [UNDATED])
def test_of_logs_without_a_time_the_last_of_the_list_is_the_newest(url: str, tmp_path: Path) -> None:
    code, said, files = asked(url, tmp_path, "--latest")
    assert (code, list(files)) == (0, ["log_002_8000.ulg"])
    assert files["log_002_8000.ulg"] == UNDATED[2].data
    assert "some logs have no time" not in said
    code, said, _ = asked(url, tmp_path, "--list")
    assert (code, said.count("unknown")) == (0, 3)
    assert "2000-01-01" not in said
    assert "1970-01-01" not in said


@pytest.mark.parametrize("logs", [[UNDATED[0], YOUNG, UNDATED[1], OLD]])
def test_where_some_have_a_time_and_some_have_not_both_that_may_be_the_newest_are_fetched(
    url: str, tmp_path: Path
) -> None:
    code, said, files = asked(url, tmp_path, "--latest")
    assert (code, set(files.values())) == (0, {YOUNG.data, UNDATED[1].data})
    assert "some logs have no time, as flights without GPS" in said


@pytest.mark.parametrize("logs", [[OLD, YOUNG._replace(told=False), UNDATED[0]]])
def test_entries_that_never_come_are_told_of_and_the_rest_is_fetched(url: str, tmp_path: Path) -> None:
    code, said, files = asked(url, tmp_path)
    assert (code, set(files.values())) == (1, {OLD.data, UNDATED[0].data})
    assert "the vehicle counts 1 logs more than it lists" in said


@pytest.mark.parametrize("logs", [[OLD._replace(seek_s=4.0), YOUNG._replace(seek_s=3.0)]])
def test_a_slow_card_whose_list_begins_anew_at_each_request_is_not_empty(url: str, tmp_path: Path) -> None:
    """7 s of silence, and whoever asks meanwhile begins them again."""
    code, _, files = asked(url, tmp_path)
    assert (code, set(files.values())) == (0, {OLD.data, YOUNG.data})


# --- armed ----------------------------------------------------------------------------------------------------------


@pytest.fixture
def flying(pilot: Autopilot) -> None:
    pilot.start_in_air(2.0)


@pytest.mark.usefixtures("flying")
@pytest.mark.parametrize("pilot", [autopilot(quadrotor()), Autopilot(quadrotor(), V1_18)], ids=["v1.17", "v1.18"])
def test_while_armed_the_latest_is_the_last_that_is_finished(url: str, tmp_path: Path) -> None:
    code, said, files = asked(url, tmp_path, "--latest")
    assert (code, list(files.values())) == (0, [YOUNG.data])
    assert "is being written" in said


@pytest.mark.usefixtures("flying")
@pytest.mark.parametrize("logs", [[]])
def test_while_armed_the_only_log_is_left_until_it_ends(url: str, tmp_path: Path) -> None:
    code, said, files = asked(url, tmp_path, "--latest")
    assert (code, files) == (1, {})
    assert "log 0 is being written" in said
    assert "not fetched before it ends" in said


# --- MAVLink FTP ----------------------------------------------------------------------------------------------------


class Lossy:
    """A link that loses every so many frames of file transfer, and hears no more of it after some."""

    def __init__(self, link: Any, every: int, silent_after: int | None = None) -> None:
        self._link, self._every, self._silent_after = link, every, silent_after
        self.stream = link.stream
        self.count = 0

    def receive(self) -> bytes:
        data: bytes = self._link.receive()
        numbers = {frame.message_id for frame in FrameParser().feed(data)}
        if mavlink.MAVLINK_MSG_ID_FILE_TRANSFER_PROTOCOL not in numbers:
            return data
        self.count += 1
        over = self._silent_after is not None and self.count > self._silent_after
        return b"" if over or self.count % self._every == 0 else data

    def __getattr__(self, name: str) -> Any:
        return getattr(self._link, name)


@pytest.fixture
def client(url: str) -> Iterator[Client]:
    opened = Client(load_config(QUADROTOR), url)
    opened.connect()
    yield opened
    opened.close()


by_ftp = pytest.mark.parametrize("pilot", [Autopilot(quadrotor(), V1_18)], ids=["v1.18"])


@by_ftp
@pytest.mark.parametrize("logs", [[UNDATED[0], YOUNG, *[synthetic_log(1000 + n, n, n) for n in range(12)], OLD]])
def test_v1_18_is_asked_by_file_transfer(
    client: Client, logs: list[LogFile], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    sent: set[int] = set()
    forward = client.forward
    monkeypatch.setattr(client, "forward", lambda frame: (sent.add(frame[7]), forward(frame)))
    client._link = lossy = Lossy(client._link, 4)
    listing = list_logs(client)
    assert [entry.path for entry in listing.entries if entry.dated] == [
        "2023-11-14/22_13_20.ulg", "2023-11-14/22_28_20.ulg",
    ]  # fmt: skip
    assert [entry.path for entry in listing.entries[:13]] == [f"sess{n:03d}/log001.ulg" for n in (1, *range(3, 15))], (
        "in the order of sessions"
    )
    paths = [fetch(client, entry, tmp_path) for entry in listing.entries[-3:]]
    assert [path.name for path in paths] == [
        "sess014_log001_1011.ulg", "2023-11-14_22-13-20_4000.ulg", "2023-11-14_22-28-20_5000.ulg",
    ]  # fmt: skip
    assert [path.read_bytes() for path in paths] == [logs[-2].data, OLD.data, YOUNG.data]
    assert lossy.count > 20
    assert sent == {mavlink.MAVLINK_MSG_ID_FILE_TRANSFER_PROTOCOL}, "no request of the log protocol"


@by_ftp
@pytest.mark.parametrize("logs", [[synthetic_log(60_000, 7, 1_700_000_000)]])
def test_a_download_by_file_transfer_is_continued_where_it_broke_off(
    client: Client, logs: list[LogFile], tmp_path: Path
) -> None:
    (entry,) = list_logs(client).entries
    link = client._link
    client._link = Lossy(link, 1000, silent_after=100)
    with pytest.raises(LinkError, match="stopped sending its log at byte"):
        fetch(client, entry, tmp_path)
    (part,) = tmp_path.iterdir()
    got = part.read_bytes()
    assert 10_000 < len(got) < 40_000
    assert got == logs[0].data[: len(got)], "as far as it goes, it is right"
    client._link = link  # its session is still open: one is all that the vehicle has
    progress: list[int] = []
    assert fetch(client, entry, tmp_path, progress.append).read_bytes() == logs[0].data
    assert progress[0] == len(got)


@by_ftp
@pytest.mark.parametrize("logs", [[]])
def test_a_vehicle_that_offers_file_transfer_says_at_once_that_it_has_none(client: Client) -> None:
    assert list_logs(client).entries == []
