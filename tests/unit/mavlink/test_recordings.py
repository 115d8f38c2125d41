"""The fast path on what a real PX4 sent: every hot frame decodes to what pymavlink's own parser reads."""

from __future__ import annotations

import socket
import struct
import subprocess
import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from harness.processes import PATIENCE_S
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import development as mavlink

from companion.config import load_config
from companion.control.types import AttitudeSetpoint
from companion.flight.authority.states import State
from companion.flight.host.clock import Clock
from companion.flight.vehicle_link.link import VehicleLink
from companion.mavlink.codec import Encoder, FrameParser, Layout
from companion.mavlink.link import open_link
from companion.mavlink.px4 import Mode
from companion.record.recorder import Recorder

HERE = Path(__file__).resolve().parents[1]
CUTS = HERE.parent / "data"
ROOT = HERE.parents[1]
FULL = ROOT.parent / "shared" / "data"
NAMES = ("px4_sih_flight.tlog", "px4_sih_gps_loss.tlog", "px4_sih_attitude_p3.tlog")
HOT = {
    layout.message_id: layout
    for layout in map(Layout, ("ODOMETRY", "ATTITUDE_QUATERNION", "LOCAL_POSITION_NED", "HEARTBEAT", "CURRENT_MODE"))
}
ODOMETRY = Layout("ODOMETRY")
CURRENT_MODE = Layout("CURRENT_MODE")
AUTOPILOT, COMPANION = (1, 1), (1, 191)

each_recording = pytest.mark.parametrize("name", NAMES)


def records(path: Path) -> Iterator[tuple[int, bytes]]:
    """(time in microseconds, frame) of every record of a tlog."""
    data = path.read_bytes()
    at = 0
    while at < len(data):
        (time_us,) = struct.unpack_from(">Q", data, at)
        end = at + 8 + 12 + data[at + 9]
        assert data[at + 8] == 0xFD
        assert data[at + 10] == 0, "none of the recordings is signed"
        yield time_us, data[at + 8 : end]
        at = end


def message_id(frame: bytes) -> int:
    return frame[7] | frame[8] << 8 | frame[9] << 16


def flattened(values: Iterable[Any]) -> list[float]:
    """Values with their arrays laid out in place."""
    flat: list[float] = []
    for value in values:
        if isinstance(value, list | tuple):
            flat.extend(value)
        else:
            flat.append(value)
    return flat


def alike(ours: Sequence[float], theirs: Sequence[float]) -> bool:
    """The same values in the same order; not a number is like not a number."""
    return len(ours) == len(theirs) and all(a == b or (a != a and b != b) for a, b in zip(ours, theirs, strict=True))


def compare(path: Path) -> Counter[tuple[str, tuple[int, int]]]:
    """Decode every hot frame both ways and demand the same; returns how many there were of which message from whom."""
    fast, slow = FrameParser(), mavlink.MAVLink(None)
    slow.robust_parsing = True
    compared: Counter[tuple[str, tuple[int, int]]] = Counter()
    for _, raw in records(path):
        layout = HOT.get(message_id(raw))
        if layout is None:
            continue
        (frame,) = fast.feed(raw)
        (message,) = slow.parse_buffer(bytearray(raw))
        source = (frame.system_id, frame.component_id)
        assert frame.message_id == message.get_msgId() == layout.message_id
        assert source == (message.get_srcSystem(), message.get_srcComponent())
        assert (frame.sequence, frame.raw) == (message.get_seq(), raw)
        named = layout.named(frame.payload)
        assert set(named) == set(message.get_fieldnames())
        theirs = flattened([getattr(message, field) for field in layout.fields])
        assert alike(flattened(named[field] for field in layout.fields), theirs), f"{layout.name} {frame.sequence}"
        assert alike(layout.unpack(frame.payload), theirs), f"{layout.name} {frame.sequence}"
        compared[layout.name, source] += 1
    assert (fast.bad_crc, fast.unknown, fast.dropped_bytes) == (0, 0, 0)
    return compared


# --- decoding -------------------------------------------------------------------------------------------------------


@each_recording
def test_every_hot_frame_decodes_as_pymavlink_reads_it(name: str) -> None:
    compared = compare(CUTS / name)
    expected = {(layout.name, AUTOPILOT) for layout in HOT.values()} | {("HEARTBEAT", COMPANION)}
    assert set(compared) == expected, "a cut must hold all hot messages, and both ends"
    assert compared["ODOMETRY", AUTOPILOT] > 100


@each_recording
def test_every_hot_frame_of_the_full_recording_decodes_as_pymavlink_reads_it(name: str) -> None:
    path = FULL / name
    if not path.exists():
        pytest.skip("the full recordings are not beside this checkout")
    compared = compare(path)
    assert compared["ODOMETRY", AUTOPILOT] >= 4999
    assert compared["ATTITUDE_QUATERNION", AUTOPILOT] >= 4998
    assert compared["LOCAL_POSITION_NED", AUTOPILOT] >= 2500
    assert compared["CURRENT_MODE", AUTOPILOT] >= 107
    assert min(compared["HEARTBEAT", AUTOPILOT], compared["HEARTBEAT", COMPANION]) >= 49


@each_recording
def test_the_cut_is_what_the_script_cuts(name: str, tmp_path: Path) -> None:
    if not (FULL / name).exists():
        pytest.skip("the full recordings are not beside this checkout")
    subprocess.run([sys.executable, str(CUTS / "cut.py"), str(FULL / name), str(tmp_path / name)], check=True)
    assert (tmp_path / name).read_bytes() == (CUTS / name).read_bytes()


@each_recording
def test_what_the_dialect_does_not_know_is_counted_and_costs_nothing_else(name: str) -> None:
    frames = [raw for _, raw in records(CUTS / name)]
    known = [raw for raw in frames if message_id(raw) in mavlink.mavlink_map]
    unknown = [raw for raw in frames if message_id(raw) not in mavlink.mavlink_map]
    assert unknown, "a real PX4 sends some messages that the dialect lacks"
    parser = FrameParser()
    kept = [frame.raw for raw in frames for frame in parser.feed(raw)]
    assert kept == known
    assert parser.unknown >= len(unknown)
    assert parser.dropped_bytes == sum(map(len, unknown))


@each_recording
def test_the_companions_set_points_are_encoded_as_they_were_recorded(name: str) -> None:
    layout = Layout("SET_ATTITUDE_TARGET")
    encoder = Encoder(layout, *COMPANION)
    count = 0
    for _, raw in records(CUTS / name):
        if message_id(raw) == layout.message_id:
            (frame,) = FrameParser().feed(raw)
            assert encoder.encode(frame.sequence, *layout.unpack(frame.payload)) == raw
            count += 1
    assert count >= 100


# --- what the cuts must show ----------------------------------------------------------------------------------------


def odometry_of(name: str) -> list[dict[str, Any]]:
    return [
        ODOMETRY.named(frame.payload)
        for _, raw in records(CUTS / name)
        if message_id(raw) == ODOMETRY.message_id
        for frame in FrameParser().feed(raw)
    ]


def test_the_estimator_resets_once_when_gps_is_back_and_then_slides_without_a_count() -> None:
    samples = odometry_of("px4_sih_gps_loss.tlog")
    steps = [
        (before, after) for before, after in pairwise(samples) if after["reset_counter"] != before["reset_counter"]
    ]
    ((before, after),) = steps
    assert (before["reset_counter"], after["reset_counter"]) == (12, 13)
    jump = [after[axis] - before[axis] for axis in "xyz"]
    assert sum(d * d for d in jump) ** 0.5 == pytest.approx(1.37, abs=0.05)
    later = [s for s in samples if 0 < s["time_usec"] - after["time_usec"] <= 700_000]
    slide = [later[-1][axis] - after[axis] for axis in "xyz"]
    assert sum(d * d for d in slide) ** 0.5 > 4.0
    assert {s["reset_counter"] for s in later} == {13}


def test_the_flight_loses_offboard_when_the_stream_stops_and_regains_it_when_it_resumes() -> None:
    modes: list[int] = []
    last_setpoint_us = failsafe_us = 0
    for time_us, raw in records(CUTS / "px4_sih_flight.tlog"):
        if message_id(raw) == 82 and not failsafe_us:
            last_setpoint_us = time_us
        if message_id(raw) != CURRENT_MODE.message_id:
            continue
        mode = CURRENT_MODE.named(raw[10:-2])["custom_mode"]
        if not modes or modes[-1] != mode:
            modes.append(mode)
        if mode == Mode.RETURN and not failsafe_us:
            failsafe_us = time_us
    assert modes == [Mode.HOLD, Mode.TAKEOFF, Mode.HOLD, Mode.OFFBOARD, Mode.RETURN, Mode.OFFBOARD, Mode.HOLD]
    assert 1.0 < (failsafe_us - last_setpoint_us) * 1e-6 < 1.3


# --- the process's link to the vehicle ------------------------------------------------------------------------------


@pytest.fixture
def peer() -> Iterator[socket.socket]:
    with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as vehicle:
        vehicle.bind(("127.0.0.1", 0))
        vehicle.settimeout(PATIENCE_S)
        yield vehicle


@pytest.fixture
def vehicle_link(peer: socket.socket, tmp_path: Path) -> Iterator[VehicleLink]:
    recorder = Recorder(tmp_path)
    with closing(open_link(f"udpout://127.0.0.1:{peer.getsockname()[1]}")) as link:
        yield VehicleLink(load_config(ROOT / "config" / "antx_rig.yaml"), link, recorder, Clock())
    assert recorder.close() is None


def hear(link: VehicleLink, data: bytes) -> None:
    """Take every message in, as the process does."""
    for _ in link.messages(data):
        pass


@each_recording
def test_only_the_autopilots_frames_pass_the_rest_is_counted_as_foreign(name: str, vehicle_link: VehicleLink) -> None:
    frames = [raw for _, raw in records(CUTS / name) if message_id(raw) in mavlink.mavlink_map]
    mine = [raw for raw in frames if (raw[5], raw[6]) == AUTOPILOT]
    first = next(i for i, raw in enumerate(mine) if message_id(raw) == mavlink.MAVLINK_MSG_ID_HEARTBEAT)
    mine = mine[first:]  # nothing is believed before its heartbeat
    kept = []
    for raw in frames:
        hear(vehicle_link, raw)
        kept += [frame.raw for frame in vehicle_link.heard]
    assert kept == mine
    assert vehicle_link.foreign > 0


def test_another_system_is_not_believed(vehicle_link: VehicleLink) -> None:
    armed = (Mode.OFFBOARD, 2, 12, 128, 4, 3)
    for ids in ((2, 1), (1, 2), (255, 190)):
        stranger = Encoder(Layout("HEARTBEAT"), *ids).encode(0, *armed)
        hear(vehicle_link, stranger)
        assert vehicle_link.heard == []
    assert vehicle_link.foreign == 3
    assert (vehicle_link.connected, vehicle_link.armed, vehicle_link.mode) == (False, False, 0)
    hear(vehicle_link, Encoder(Layout("HEARTBEAT"), *AUTOPILOT).encode(0, *armed))
    assert len(vehicle_link.heard) == 1
    assert (vehicle_link.connected, vehicle_link.armed, vehicle_link.mode) == (True, True, Mode.OFFBOARD)


def test_the_links_frames_carry_one_sequence_that_wraps(vehicle_link: VehicleLink, peer: socket.socket) -> None:
    parser = FrameParser()
    sequences: list[int] = []
    for n in range(300):
        if n % 50 == 0:
            vehicle_link.send_heartbeat(State.ENGAGED)
        else:
            vehicle_link.send_setpoint(n, AttitudeSetpoint(1.0, 0.0, 0.0, 0.0, 0.5))
        sequences += [frame.sequence for frame in parser.feed(peer.recv(2048))]
    assert sequences == [n % 256 for n in range(300)]


# --- a recorded stream ----------------------------------------------------------------------------------------------

LINE = b"".join(raw for _, raw in records(CUTS / "px4_sih_flight.tlog"))[:20_000]
WHOLE = FrameParser(stream=True).feed(LINE)


@settings(max_examples=50)
@given(st.lists(st.integers(0, len(LINE)), max_size=60))
def test_a_recorded_line_cut_at_random_places_gives_the_same_frames(places: list[int]) -> None:
    parser = FrameParser(stream=True)
    bounds = [0, *sorted(places), len(LINE)]
    assert [frame for a, b in pairwise(bounds) for frame in parser.feed(LINE[a:b])] == WHOLE
    assert len(WHOLE) > 100
