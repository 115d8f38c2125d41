"""What is fuzzed: bytes in, and only the errors that are meant for a person may come out.

Each target takes bytes of anything. An exception it lets out, or an assertion that fails, is a finding.
"""

from __future__ import annotations

import itertools
import json
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from fastcrc.crc16 import mcrf4xx
from pymavlink.dialects.v20 import development as mavlink

from companion.certify import proof
from companion.config import load_config
from companion.config.load import load_text
from companion.errors import CompanionError
from companion.flight.host.clock import Clock
from companion.flight.vehicle_link.link import VehicleLink
from companion.identify import traffic
from companion.identify import ulog as ulog_log
from companion.mavlink.codec import MAX_FRAME_BYTES, Frame, FrameParser, crc_extra
from companion.mavlink.logs.client import newest
from companion.mavlink.logs.protocol import LOG_DATA, LOG_ENTRY, LogEntry, LogFetch, LogList
from companion.mavlink.logs.ulog import extent
from companion.mavlink.stamps import read_stamps
from companion.mavlink.tool_server import ToolServer, question
from companion.record.reader import read_flight

ROOT: Final = Path(__file__).resolve().parents[2]
CONFIG: Final = ROOT / "config" / "paper_quadrotor.yaml"
_FOLDER: Final = Path(tempfile.mkdtemp(prefix="fuzz-", dir="/dev/shm" if Path("/dev/shm").is_dir() else None))
_STEERING: Final = (
    "steering.enabled=true", "steering.system_ids=[250]", "controller.anchor=setpoint",
    "controller.limits.speed_m_s=0.3",
    "guards.fence={enabled: true, radius_m: 5, lower_ned_m: [-5, -5, -5], upper_ned_m: [5, 5, 5]}",
)  # fmt: skip
_IDS: Final = ((1, 1), (1, 1), (1, 1), (1, 191), (250, 190), (1, 192), (7, 7))


class Wire:
    """A link without a wire, and a log without a file."""

    stream = False
    name = "wire"

    def receive(self) -> bytes:
        return b""

    def send(self, data: bytes) -> None:
        assert len(FrameParser().feed(data)) == 1

    def lock(self) -> None: ...

    def close(self) -> None: ...

    def add(self, kind: int, time_us: int, data: bytes) -> None: ...


def one_line(error: Exception) -> None:
    """What a person is told is one line."""
    assert "\n" not in str(error)


def codec(data: bytes) -> None:
    """Both ways of reading: every byte is in a frame, counted as dropped, or waits; and frames are what they say."""
    for stream in (False, True):
        parser, frames = FrameParser(stream=stream), []
        cut = data[0] + 16 if data else 16
        pieces = [data[at : at + cut] for at in range(0, len(data), cut)] if stream else [data]
        for piece in pieces:
            frames += parser.feed(piece)
        assert sum(len(frame.raw) for frame in frames) + parser.dropped_bytes + len(parser._rest) == len(data)
        assert parser.frames == len(frames)
        assert len(parser._rest) < MAX_FRAME_BYTES
        for frame in frames:
            assert FrameParser().feed(frame.raw) == [frame]


def frames_of(data: bytes) -> list[bytes]:
    """Whole frames whose sender, message and payload the bytes choose: what a check sum would keep from being tried."""
    numbers, made, at = sorted(mavlink.mavlink_map), [], 0
    while at + 4 <= len(data):
        who, low, high, length = data[at : at + 4]
        number = numbers[(low | high << 8) % len(numbers)]
        payload = data[at + 4 : at + 4 + length]
        at += 4 + length
        system, component = _IDS[who % len(_IDS)]
        body = bytes([len(payload), 0, 0, who, system, component]) + number.to_bytes(3, "little") + payload
        made.append(b"\xfd" + body + mcrf4xx(body + crc_extra(number)).to_bytes(2, "little"))
    return made


def link(data: bytes) -> None:
    """Whole frames of anybody, at the flight's link once the vehicle is known."""
    wire = Wire()
    vehicle = VehicleLink(_config(), wire, wire, Clock())  # type: ignore[arg-type]
    packer = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    heartbeat = bytes(mavlink.MAVLink_heartbeat_message(2, 12, 0x81, 6 << 16, 4, 3).pack(packer))
    for piece in (heartbeat, *frames_of(data)):
        for message in vehicle.messages(piece):
            hash(type(message))
        for command in vehicle.live_commands():
            assert not isinstance(command.wanted, str) or len(command.wanted) <= 38
        vehicle.rival()
    vehicle.measure_delay()
    vehicle.tally()


def config(data: bytes) -> None:
    """A config file, or what `--set` gives."""
    try:
        load_text(data.decode("utf-8", "replace"), Path("fuzz.yaml"), ROOT / "config")
    except CompanionError as error:
        one_line(error)


def certificate(data: bytes) -> None:
    """A certificate file."""
    path = _FOLDER / "certificate.json"
    path.write_bytes(data)
    content, reason = proof.load(path)
    if not reason:
        assert isinstance(proof.verify(content).ok, bool)


def ulog(data: bytes) -> None:
    """A ULog, as a download is checked and as identification reads it."""
    path = _FOLDER / "log.ulg"
    path.write_bytes(data)
    found = extent(path)
    assert 0 <= found.bytes_read <= found.size_bytes == len(data) or found.problem
    try:
        ulog_log.read(path)
    except CompanionError as error:
        one_line(error)


def tlog(data: bytes) -> None:
    """A recording of traffic."""
    path = _FOLDER / "traffic.tlog"
    path.write_bytes(data)
    try:
        traffic.read(path)
    except CompanionError as error:
        one_line(error)


def traffic_of(data: bytes) -> None:
    """The same, of whole frames."""
    records = (
        n.to_bytes(8, "big") + frame for n, frame in zip(itertools.count(0, 4000), frames_of(data), strict=False)
    )
    tlog(b"".join(records))


def mcap(data: bytes) -> None:
    """A flight's log."""
    (_FOLDER / "flight.mcap").write_bytes(data)
    try:
        read_flight(_FOLDER)
    except ValueError as error:
        one_line(error)


def _frame(number: int, payload: bytes) -> Frame:
    return Frame(number, 1, 1, 0, payload.rstrip(b"\0") or b"\0", b"")


def log_protocol(data: bytes) -> None:
    """A vehicle's answers about its logs."""
    listing, now_s = LogList(1, 1), 0.0
    entry = LogEntry(data[0] if data else 0, int.from_bytes(data[1:3], "little"), 0)
    fetch = LogFetch(1, 1, entry, 0)
    got = b""
    for at in range(3, len(data), 8):
        piece, now_s = data[at : at + 8], now_s + 0.1
        listing.requests(now_s)
        listing.take(_frame(LOG_ENTRY.message_id, piece + data[at + 8 : at + 14]), now_s)
        fetch.requests(now_s)
        got += fetch.take(_frame(LOG_DATA.message_id, piece + data[:90]), now_s)
        assert len(got) == fetch.offset <= max(entry.size_bytes, 0)
    for known in listing.entries.values():
        name = known.file_name
        assert "/" not in name
        assert name.isprintable()
    if listing.entries:
        newest(list(listing.entries.values()))


def door(data: bytes) -> None:
    """What a tool sends: only questions come through."""
    server = _server()
    server._question(_now())  # the last one's place is free
    pieces = [data, *frames_of(data)]
    for piece in pieces[:8]:
        _tool(server, piece[:2000])
        now_s = _now()
        for _ in range(3):
            asked = server.asked(now_s)
            now_s += 0.1
            if asked:
                (frame,) = FrameParser().feed(asked)
                assert question(frame)


def stamps(data: bytes) -> None:
    """The file of time stamps."""
    path = _FOLDER / "stamps.json"
    if not path.exists():
        path.touch(mode=0o600)
    path.write_bytes(data)
    found, complaint = read_stamps(path)
    assert not (found and complaint)
    assert complaint is None or "\n" not in complaint
    json.dumps({str(stream): stamp for stream, stamp in found.items()})


TARGETS: Final[dict[str, Callable[[bytes], None]]] = {
    "codec": codec, "link": link, "config": config, "certificate": certificate, "ulog": ulog, "tlog": tlog,
    "traffic": traffic_of, "mcap": mcap, "log_protocol": log_protocol, "door": door, "stamps": stamps,
}  # fmt: skip

_kept: dict[str, Any] = {"now_s": 10.0}


def _config() -> Any:
    if "config" not in _kept:
        _kept["config"] = load_config(CONFIG, _STEERING)
    return _kept["config"]


def _now() -> float:
    _kept["now_s"] += 10.0
    return float(_kept["now_s"])


def _server() -> ToolServer:
    if "server" not in _kept:
        os.chmod(_FOLDER, 0o700)
        _kept["server"] = ToolServer(_FOLDER / "tools.sock")
    return _kept["server"]  # type: ignore[no-any-return]


def _tool(server: ToolServer, data: bytes) -> None:
    import socket  # noqa: PLC0415

    if "tool" not in _kept:
        tool = _kept["tool"] = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        tool.bind("")
        tool.connect(str(server.path))
    _kept["tool"].send(data)
