"""What a person asks of a vehicle on the ground, over real sockets: settings by mavsdk, logs by our own protocol."""

from __future__ import annotations

import json
import random
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from harness import processes
from harness.ports import free_port
from harness.processes import finish
from harness.running_plant import RunningPlant, autopilot, quadrotor
from mavsdk.plugins.log_files import LogFiles, LogFilesResult
from pymavlink.dialects.v20 import development as mavlink

from companion.config import load_config
from companion.mavlink.client import Client
from companion.mavlink.codec import FrameParser
from companion.mavlink.link import LinkError
from companion.mavlink.logs import ulog
from companion.mavlink.logs.client import fetch, list_logs, newest
from companion.mavlink.logs.protocol import LOG_DATA
from companion.mavlink.services import Attachment, Firmware, Services
from companion.mavlink.vehicle_report import read_parameters
from sitl.autopilot.autopilot import Autopilot
from sitl.autopilot.parameters import Parameters, Px4Version
from sitl.messages.log_card import LogFile, synthetic_log
from sitl.wire.ports import UdpEndpoint

QUADROTOR = processes.ROOT / "config" / "paper_quadrotor.yaml"
LOGS = [
    synthetic_log(5_000, 1, time_utc_s=1_700_000_000),
    synthetic_log(60_000, 2, time_utc_s=1_700_000_900),  # the newest is not the last of the directory
    synthetic_log(3_000, 3, time_utc_s=1_600_000_000),
]
NEWEST = LOGS[1]


pytestmark = pytest.mark.realtime


@pytest.fixture
def port() -> int:
    return free_port()


@pytest.fixture
def logs() -> list[LogFile]:
    return LOGS


@pytest.fixture
def plant(port: int, logs: list[LogFile]) -> Iterator[RunningPlant]:
    """A plant that calls one port, as PX4 calls 14540, so that one tool after the other can use it."""
    pilot = autopilot(quadrotor(), COM_RCL_EXCEPT=-1, MC_ROLL_P=3.25)
    with RunningPlant(pilot, endpoints=[UdpEndpoint(0, port)], logs=logs) as running:
        yield running


@pytest.fixture
def url(port: int) -> str:
    return f"udpin://127.0.0.1:{port}"


@pytest.fixture
def client(plant: RunningPlant, url: str) -> Iterator[Client]:
    opened = Client(load_config(QUADROTOR), url)
    opened.connect()
    yield opened
    opened.close()


# --- mavsdk on our link ---------------------------------------------------------------------------------------------


def test_version_health_and_parameters(client: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    sent: list[bytes] = []
    forward = client.forward
    monkeypatch.setattr(client, "forward", lambda frame: (sent.append(frame), forward(frame)))
    with Services(client) as services:
        assert services.firmware() == Firmware((1, 17, 0), "release", services.firmware().git_hash)
        health = services.health()
        assert all(health[name] for name in ("local position", "armable")), health
    found = read_parameters(client, ("MC_ROLL_P", "COM_RCL_EXCEPT", "MC_PITCH_P", "COM_OF_LOSS_T"))
    assert found == {"MC_ROLL_P": 3.25, "COM_RCL_EXCEPT": -1, "MC_PITCH_P": 4.0, "COM_OF_LOSS_T": 1.0}
    frames = FrameParser().feed(b"".join(sent))
    assert {(frame.system_id, frame.component_id) for frame in frames} == {(1, 192)}
    numbers = {frame.message_id for frame in frames}
    assert mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_READ in numbers
    assert mavlink.MAVLINK_MSG_ID_HEARTBEAT not in numbers, "the vehicle must not miss a tool that has ended"
    assert mavlink.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET not in numbers


@pytest.mark.parametrize(("version", "at_most_s"), [("1.17", 2.5), ("1.18", 1.0)])
def test_what_the_vehicle_lacks_costs_one_silence_and_from_v1_18_on_none(version: str, at_most_s: float) -> None:
    """mavsdk waits for 3 s, for each."""
    lacking = [f"NO_SUCH_PARAM{number}" for number in range(12)]
    pilot = Autopilot(quadrotor(), Parameters({"MC_ROLL_P": 3.25}, Px4Version(version)))
    port = free_port()
    with RunningPlant(pilot, endpoints=[UdpEndpoint(0, port)]):
        client = Client(load_config(QUADROTOR), f"udpin://127.0.0.1:{port}")
        client.connect()
        began_s = time.monotonic()
        assert read_parameters(client, [*lacking, "MC_ROLL_P"]) == {"MC_ROLL_P": 3.25}
        assert time.monotonic() - began_s < at_most_s
        client.close()


def test_what_is_hot_is_not_fed(client: Client) -> None:
    fed: list[bytes] = []

    class Library:
        def pass_received_raw_bytes(self, data: bytes) -> None:
            fed.append(data)

        def destroy(self) -> None: ...

    attachment = Attachment(1, 192)
    real, attachment._mavsdk = attachment._mavsdk, Library()
    real.destroy()
    heard: set[int] = set()
    while mavlink.MAVLINK_MSG_ID_SYS_STATUS not in heard:
        frames = client.frames()
        heard |= {frame.message_id for frame in frames}
        attachment.feed(frames)
    passed = {frame.message_id for frame in FrameParser(stream=True).feed(b"".join(fed))}
    assert mavlink.MAVLINK_MSG_ID_SYS_STATUS in passed
    assert mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION in heard
    assert not passed & {
        mavlink.MAVLINK_MSG_ID_ODOMETRY,
        mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION,
        mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
        mavlink.MAVLINK_MSG_ID_HIGHRES_IMU,
    }


def test_mavsdk_itself_can_fetch_a_log(client: Client, tmp_path: Path) -> None:
    with Services(client) as services:
        log_files = LogFiles(services.system)
        entries = log_files.get_entries()
        assert [entry.size_bytes for entry in entries] == [len(log.data) for log in LOGS]
        path = tmp_path / "by_mavsdk.ulg"
        ended = threading.Event()
        results: list[LogFilesResult] = []

        def on_progress(result: LogFilesResult, *_: object) -> None:
            results.append(result)
            if result is not LogFilesResult.NEXT:
                ended.set()

        log_files.download_log_file_async(entries[1], str(path), on_progress)
        assert ended.wait(processes.PATIENCE_S)
    assert results[-1] is LogFilesResult.SUCCESS
    assert path.read_bytes() == NEWEST.data


def test_a_vehicle_that_is_not_there(url: str) -> None:
    silent = Client(load_config(QUADROTOR, ("link.connect_timeout_s=0.3",)), url)
    try:
        with pytest.raises(LinkError, match=r"no heartbeat of vehicle 1/1 within 0\.3 s"):
            silent.connect()
    finally:
        silent.close()


# --- companion vehicle ----------------------------------------------------------------------------------------------


def asked(plant_settings: tuple[str, ...], *settings: str) -> tuple[int, dict[str, Any]]:
    """Exit code and answer of `companion vehicle --json`."""
    options = [part for setting in settings for part in ("--set", setting)]
    given = [part for setting in plant_settings for part in ("--set", setting)]
    with processes.served(*given, config=QUADROTOR) as port:
        done = finish("vehicle", QUADROTOR, "--link", f"udpout://127.0.0.1:{port}", "--json", *options)
    return done.returncode, json.loads(done.stdout)


def test_a_vehicle_as_certified_is_fine() -> None:
    code, answer = asked(
        ("plant.parameters={COM_RC_OVERRIDE: 3}",), "vehicle.parameters={MC_ROLL_P: 4, MC_ROLLRATE_P: 0.15}"
    )
    assert (code, answer["verdict"], answer["firmware"]) == (0, "fine", [1, 17, 0])
    assert answer["parameters"]["COM_OBL_RC_ACT"] == 0
    assert answer["health"]["armable"]
    assert {row["verdict"] for row in answer["settings"]} == {"fine"}


def test_v1_18_is_asked_for_its_own_settings_and_judged_by_them() -> None:
    code, answer = asked(('plant.px4_version="1.18"', "plant.parameters={NAV_RCL_ACT: 7}"))
    assert (code, answer["verdict"], answer["firmware"]) == (1, "dangerous", [1, 18, 0])
    rows = {row["name"]: row for row in answer["settings"]}
    assert [name for name, row in rows.items() if row["verdict"] != "fine"] == ["NAV_RCL_ACT"]
    assert rows["NAV_RCL_ACT"]["value"] == "7 Hold, no failsafe"
    assert {"MAN_OVERRIDE_SPD", "MC_REF_W_N", "MC_REF_FF", "MC_REF_FF_MAX", "MAV_1_RATE"} <= set(rows)
    assert "COM_RC_OVERRIDE" not in rows


def test_a_changed_gain_and_a_deadly_setting_are_named() -> None:
    code, answer = asked(
        ("plant.parameters={COM_RC_OVERRIDE: 3, MC_PITCH_P: 6.5, COM_OBL_RC_ACT: 7}",),
        "vehicle.parameters={MC_ROLL_P: 4, MC_PITCH_P: 4}",
    )
    assert (code, answer["verdict"]) == (1, "dangerous")
    wrong = {row["name"]: row["verdict"] for row in answer["settings"] if row["verdict"] != "fine"}
    assert wrong == {"MC_PITCH_P": "differs", "COM_OBL_RC_ACT": "dangerous"}


# --- companion logs -------------------------------------------------------------------------------------------------


def test_list_newest_fetch_and_not_twice(plant: RunningPlant, url: str, tmp_path: Path) -> None:
    out = ("--link", url, "--out", str(tmp_path))
    listed = finish("logs", str(QUADROTOR), *out, "--list")
    assert listed.returncode == 0
    assert all(text in listed.stdout for text in ("60000", "2023-11-14 22:28:20", "no"))
    latest = finish("logs", str(QUADROTOR), *out, "--latest")
    path = tmp_path / "2023-11-14_22-28-20_60000.ulg"
    assert (latest.returncode, path.read_bytes()) == (0, NEWEST.data)
    assert "whole, 60000 bytes" in latest.stdout
    stamp = path.stat().st_mtime_ns
    every = finish("logs", str(QUADROTOR), *out)
    assert every.returncode == 0
    assert sorted(p.stat().st_size for p in tmp_path.iterdir()) == [3_000, 5_000, 60_000]
    assert path.stat().st_mtime_ns == stamp, "what is here is not fetched again"


@pytest.mark.parametrize("logs", [[]])
def test_no_logs(plant: RunningPlant, url: str) -> None:
    done = finish("logs", str(QUADROTOR), "--link", url)
    assert done.returncode == 1
    assert "no logs" in done.stdout


@pytest.mark.parametrize("logs", [[LogFile(b"ULog\x01\x12\x35" + bytes(3000), 1_700_000_000)]])
def test_a_broken_log_is_fetched_and_told_of(plant: RunningPlant, url: str, tmp_path: Path) -> None:
    done = finish("logs", str(QUADROTOR), "--link", url, "--out", str(tmp_path))
    assert done.returncode == 1
    assert "broken at byte" in done.stdout
    assert [path.stat().st_size for path in tmp_path.iterdir()] == [3007]


def test_a_folder_that_cannot_be_written(plant: RunningPlant, url: str, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    done = finish("logs", str(QUADROTOR), "--link", url, "--out", str(tmp_path / "file"))
    assert done.returncode == 2
    assert len(done.stderr.strip().splitlines()) == 1
    assert "Traceback" not in done.stderr


class LossyLink:
    """A link that loses a share of the datagrams with log data, and falls silent after some bytes of it."""

    def __init__(self, link: Any, lost: float, silent_after: int | None = None) -> None:
        self._link = link
        self._lost = lost
        self._left = silent_after
        self._random = random.Random(4)
        self.stream = link.stream
        self.dropped = 0

    def receive(self) -> bytes:
        data: bytes = self._link.receive()
        size = sum(len(f.payload) for f in FrameParser().feed(data) if f.message_id == LOG_DATA.message_id)
        if size and self._left is not None:
            self._left -= size
        if size and (self._random.random() < self._lost or (self._left is not None and self._left < 0)):
            self.dropped += 1
            return b""
        return data

    def __getattr__(self, name: str) -> Any:
        return getattr(self._link, name)


def test_loss_is_made_good(client: Client, tmp_path: Path) -> None:
    client._link = lossy = LossyLink(client._link, 0.2)
    progress: list[int] = []
    path = fetch(client, newest(list_logs(client).entries)[-1], tmp_path, progress.append)
    assert lossy.dropped > 3
    assert path.read_bytes() == NEWEST.data
    assert ulog.extent(path).problem is None
    assert progress == sorted(progress)
    assert progress[-1] == len(NEWEST.data)


def test_a_broken_download_is_continued(plant: RunningPlant, url: str, tmp_path: Path) -> None:
    first = Client(load_config(QUADROTOR), url)
    try:
        first.connect()
        entry = newest(list_logs(first).entries)[-1]
        first._link = LossyLink(first._link, 0.0, silent_after=30_000)
        with pytest.raises(LinkError, match="stopped sending its log at byte"):
            fetch(first, entry, tmp_path)
    finally:
        first.close()
    part = tmp_path / f"{entry.file_name}.part"
    got = part.stat().st_size
    assert 10_000 < got < 31_000
    assert part.read_bytes() == NEWEST.data[:got], "as far as it goes, it is right"
    assert (
        f"{got / 60_000:.0%}" in finish("logs", str(QUADROTOR), "--link", url, "--out", str(tmp_path), "--list").stdout
    )

    second = Client(load_config(QUADROTOR), url)
    try:
        second.connect()
        progress: list[int] = []
        path = fetch(second, newest(list_logs(second).entries)[-1], tmp_path, progress.append)
    finally:
        second.close()
    assert progress[0] == got, "nothing is fetched twice"
    assert path.read_bytes() == NEWEST.data
    assert not part.exists()
