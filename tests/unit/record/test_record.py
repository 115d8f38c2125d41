"""The record of a flight: real writer processes, read back with the tools that others use."""

from __future__ import annotations

import contextlib
import math
import os
import re
import signal
import struct
import subprocess
import sys
import sysconfig
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from harness.processes import PATIENCE_S
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from pymavlink import mavutil
from pymavlink.dialects.v20 import development as mavlink

from companion.mavlink import px4
from companion.record import schema
from companion.record.reader import Flight, read_flight, tick_dtype
from companion.record.recorder import EVENT, RECEIVED, SENT, TICK, Recorder

FLOAT_COUNT = sum(field.size for field in schema.FLOATS)
VEHICLE = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
COMPANION = mavlink.MAVLink(None, srcSystem=1, srcComponent=191)


@contextlib.contextmanager
def recorder(folder: Path, *, blocking: bool = False) -> Iterator[Recorder]:
    """A recorder whose writer does not outlive a failed test."""
    recording = Recorder(folder, blocking=blocking)
    try:
        yield recording
    finally:
        writer = recording._process
        if writer.poll() is None:
            writer.send_signal(signal.SIGCONT)
        recording.close()


def tell(recording: Recorder, number: signal.Signals) -> None:
    recording._process.send_signal(number)


def wait_until(condition: Callable[[], bool], timeout_s: float = PATIENCE_S) -> None:
    deadline = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < deadline, "it never came to that"
        time.sleep(0.01)


def stopped(recording: Recorder) -> bool:
    stat = Path(f"/proc/{recording._process.pid}/stat").read_text()
    return stat.rpartition(") ")[2][0] == "T"


def tick(first: float) -> bytes:
    """A tick whose floats count up from `first`."""
    return schema.pack_tick(schema.CDR_HEADER, *(first + n for n in range(FLOAT_COUNT)), 3, 1, 0)


def setpoint(n: int) -> bytes:
    message = mavlink.MAVLink_set_attitude_target_message(n, 1, 1, 7, [1.0, 0.0, 0.0, 0.0], 0.0, 0.0, 0.0, 0.5)
    return bytes(message.pack(COMPANION))


def noise(n: int, size: int = 1000) -> bytes:
    """Bytes that say which they are."""
    return struct.pack("<I", n) * (size // 4)


def tlog_records(folder: Path, size: int) -> list[tuple[int, bytes]]:
    """(time, data) of a tlog whose records all have the same size."""
    data = (folder / "traffic.tlog").read_bytes()
    assert len(data) % (8 + size) == 0, "the last record is torn"
    return [
        (struct.unpack_from(">Q", data, at)[0], data[at + 8 : at + 8 + size]) for at in range(0, len(data), 8 + size)
    ]


# --- the files of a flight ------------------------------------------------------------------------------------------

START_US = 1_700_000_000_000_000


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short flight: 1000 ticks, each between the odometry it answers and the set-point it gave."""
    folder = tmp_path_factory.mktemp("flight")
    with recorder(folder, blocking=True) as recording:
        recording.add(EVENT, START_US, schema.pack_event("connecting", "waiting for vehicle 1/1"))
        recording.add(RECEIVED, START_US, bytes(px4.heartbeat(mavlink.MAV_STATE_ACTIVE).pack(VEHICLE)))
        for n in range(1000):
            time_us = START_US + 4000 * n
            odometry = mavlink.MAVLink_local_position_ned_message(4 * n, n, 0, 0, 0, 0, 0)
            recording.add(RECEIVED, time_us, bytes(odometry.pack(VEHICLE)))
            recording.add(SENT, time_us + 1, setpoint(4 * n))
            recording.add(TICK, time_us + 2, tick(n))
        recording.add(EVENT, START_US + 4_000_000, schema.pack_event("released_operator", "stopped by the operator"))
        assert recording.close() is None
        assert recording.dropped == 0
    return folder


def test_the_traffic_is_a_tlog_that_mavutil_reads(folder: Path) -> None:
    log = mavutil.mavlink_connection(str(folder / "traffic.tlog"), dialect="development")
    try:
        messages = []
        while (message := log.recv_match()) is not None:
            messages.append(message)
    finally:
        log.close()
    assert [m.get_type() for m in messages] == ["HEARTBEAT", *["LOCAL_POSITION_NED", "SET_ATTITUDE_TARGET"] * 1000]
    assert [m.get_srcComponent() for m in messages] == [1, *[1, 191] * 1000], "both directions, in order"
    assert [m.time_boot_ms for m in messages[1:]] == [4 * (n // 2) for n in range(2000)]
    assert messages[1]._timestamp == pytest.approx(START_US * 1e-6, abs=1e-6)
    assert messages[2]._timestamp == pytest.approx((START_US + 1) * 1e-6, abs=1e-6)


def test_the_traffic_is_a_tlog_that_mavlogdump_prints(folder: Path) -> None:
    tool = Path(sysconfig.get_path("scripts")) / "mavlogdump.py"
    command = [sys.executable, str(tool), "--dialect", "development", "--types", "SET_ATTITUDE_TARGET"]
    printed = subprocess.run([*command, str(folder / "traffic.tlog")], capture_output=True, text=True, check=True)
    lines = [line for line in printed.stdout.splitlines() if "SET_ATTITUDE_TARGET" in line]
    assert len(lines) == 1000
    assert "time_boot_ms : 3996" in lines[-1]


def test_the_ticks_come_back_as_an_array_of_named_fields(folder: Path) -> None:
    flight = read_flight(folder)
    assert flight.ticks.shape == (1000,)
    at = 0
    for field in schema.FLOATS:
        column = flight.ticks[field.name]
        expected = np.arange(1000.0)[:, None] + np.arange(at, at + field.size)
        assert np.array_equal(column.reshape(1000, field.size), expected), field.name
        assert column.shape == ((1000,) if field.size == 1 else (1000, field.size))
        at += field.size
    assert set(flight.ticks["state"]) == {3}
    assert set(flight.ticks["limited"]) == {1}


def test_the_events_come_back_with_their_time(folder: Path) -> None:
    events = read_flight(folder).events
    assert [(event.name, event.detail) for event in events] == [
        ("connecting", "waiting for vehicle 1/1"),
        ("released_operator", "stopped by the operator"),
    ]
    assert events[0].time_s == pytest.approx(START_US * 1e-6, abs=1e-6)
    assert events[1].time_s - events[0].time_s == pytest.approx(4.0, abs=1e-6)


def test_the_flight_is_an_mcap_file_that_says_what_is_in_it(folder: Path) -> None:
    with (folder / "flight.mcap").open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        assert reader.get_header().profile == "ros2"
        summary = reader.get_summary()
        messages = list(reader.iter_messages(log_time_order=False))
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == 1002
    channels = {channel.topic: channel for channel in summary.channels.values()}
    assert set(channels) == {schema.TICK_TOPIC, schema.EVENT_TOPIC}
    assert {channel.message_encoding for channel in channels.values()} == {"cdr"}
    described = {topic: summary.schemas[channel.schema_id] for topic, channel in channels.items()}
    assert {each.encoding for each in described.values()} == {"ros2msg"}
    assert described[schema.TICK_TOPIC].name == "companion/msg/Tick"
    assert described[schema.TICK_TOPIC].data.decode() == schema.tick_schema()
    assert described[schema.EVENT_TOPIC].data.decode() == schema.event_schema()
    assert [message.sequence for _, _, message in messages] == list(range(1002))
    times = [message.log_time for _, channel, message in messages if channel.topic == schema.TICK_TOPIC]
    assert times == [(START_US + 4000 * n + 2) * 1000 for n in range(1000)]


# --- the schema -----------------------------------------------------------------------------------------------------


def test_the_schema_text_has_every_field_with_its_type_and_meaning() -> None:
    lines = schema.tick_schema().splitlines()
    fields = [*schema.FLOATS, *schema.FLAGS]
    assert len(lines) == len(fields) == len({field.name for field in fields})
    for line, field in zip(lines, fields, strict=True):
        kind, name, comment = line.split(maxsplit=2)
        base = "uint8" if field in schema.FLAGS else "float64"
        assert kind == (base if field.size == 1 else f"{base}[{field.size}]")
        assert name == field.name
        assert comment == f"# {field.meaning}"
        assert len(field.meaning) > 3


def test_the_tick_is_laid_out_as_cdr_lays_out_its_schema() -> None:
    """CDR aligns each value to its size, counted from behind the header: here nothing may need padding."""
    at = 0
    for line in schema.tick_schema().splitlines():
        kind = line.split()[0]
        size = 8 if kind.startswith("float64") else 1
        count = int(kind.partition("[")[2].rstrip("]") or 1)
        assert at % size == 0, line
        at += size * count
    assert schema.PACKER.size == len(schema.CDR_HEADER) + at
    assert tick_dtype().itemsize == at


@settings(max_examples=30)
@given(
    st.lists(st.floats(), min_size=FLOAT_COUNT, max_size=FLOAT_COUNT),
    st.lists(st.integers(0, 255), min_size=len(schema.FLAGS), max_size=len(schema.FLAGS)),
)
def test_any_tick_comes_back_bit_for_bit(values: list[float], flags: list[int]) -> None:
    data = schema.pack_tick(schema.CDR_HEADER, *values, *flags)
    (row,) = np.frombuffer(data[len(schema.CDR_HEADER) :], dtype=tick_dtype())
    found = np.concatenate([np.atleast_1d(row[field.name]) for field in schema.FLOATS])
    assert found.tobytes() == struct.pack(f"<{FLOAT_COUNT}d", *values)
    assert [row[field.name] for field in schema.FLAGS] == flags


@settings(max_examples=100)
@given(st.text(max_size=20), st.text(max_size=60))
def test_any_event_comes_back(name: str, detail: str) -> None:
    assert schema.unpack_event(schema.pack_event(name, detail)) == (name, detail)


def test_the_event_is_cdr() -> None:
    expected = b"\x00\x01\x00\x00" + b"\x03\0\0\0ab\0" + b"\0" + b"\x01\0\0\0\0"
    assert schema.pack_event("ab", "") == expected


def test_events_keep_their_text_through_the_file(tmp_path: Path) -> None:
    texts = [("", ""), ("a", "Motor läuft – 5 µs"), ("日本語", "γ → 100"), ("emoji", "🚁"), ("x" * 70_000, "y")]
    with recorder(tmp_path) as recording:
        for n, (name, detail) in enumerate(texts):
            recording.add(EVENT, n, schema.pack_event(name, detail))
        assert recording.close() is None
    assert [(event.name, event.detail) for event in read_flight(tmp_path).events] == texts


def test_not_a_number_comes_back_as_such(tmp_path: Path) -> None:
    with recorder(tmp_path) as recording:
        recording.add(TICK, 0, schema.pack_tick(schema.CDR_HEADER, *[math.nan] * FLOAT_COUNT, 0, 0, 0))
        assert recording.close() is None
    ticks = read_flight(tmp_path).ticks
    assert all(np.isnan(ticks[field.name]).all() for field in schema.FLOATS)


def test_a_flight_without_records_reads_as_empty(tmp_path: Path) -> None:
    with recorder(tmp_path) as recording:
        assert recording.close() is None
    flight = read_flight(tmp_path)
    assert isinstance(flight, Flight)
    assert (len(flight.ticks), flight.events) == (0, [])
    assert flight.ticks["position_ned_m"].shape == (0, 3)
    assert (tmp_path / "traffic.tlog").read_bytes() == b""


def test_a_file_that_is_no_flight_is_refused_with_its_name(folder: Path, tmp_path: Path) -> None:
    whole = (folder / "flight.mcap").read_bytes()
    path = tmp_path / "flight.mcap"
    with pytest.raises(FileNotFoundError, match=r"flight\.mcap"):
        read_flight(tmp_path)
    for broken in (b"", os.urandom(1) + whole[1:], whole[:7]):
        path.write_bytes(broken)
        with pytest.raises(ValueError, match=r"flight\.mcap: not a readable flight log") as caught:
            read_flight(tmp_path)
        assert len(str(caught.value).splitlines()) == 1


def test_a_flight_whose_writer_was_killed_is_read_to_the_end_of_what_is_whole(folder: Path, tmp_path: Path) -> None:
    whole = (folder / "flight.mcap").read_bytes()
    ticks = read_flight(folder).ticks
    counts = []
    for size in (*range(8, len(whole), len(whole) // 40), len(whole) - 1):
        for tail in (b"", bytes(4096)):
            (tmp_path / "flight.mcap").write_bytes(whole[:size] + tail)
            flight = read_flight(tmp_path)
            assert flight.ticks.tobytes() == ticks[: len(flight.ticks)].tobytes()
            assert re.match(r"the end is cut at byte \d+ of \d+ ", flight.notes[-1])
            assert len(flight.notes) == 1 or flight.notes[0].startswith("damaged at byte")  # half a chunk and zeros
        counts.append(len(flight.ticks))
    assert counts == sorted(counts)
    assert (counts[0], counts[-1]) == (0, len(ticks))
    assert len(set(counts)) > 2, "not all or nothing"


def test_a_damaged_chunk_is_passed_over_and_told(folder: Path, tmp_path: Path) -> None:
    whole = (folder / "flight.mcap").read_bytes()
    undamaged = read_flight(folder)
    rows = {row.tobytes() for row in undamaged.ticks}
    lost = 0
    for at in range(100, len(whole) - 2000, len(whole) // 50):
        damaged = bytearray(whole)
        damaged[at] ^= 0x10
        (tmp_path / "flight.mcap").write_bytes(damaged)
        flight = read_flight(tmp_path)
        assert all(row.tobytes() in rows for row in flight.ticks), f"byte {at}"
        assert bool(flight.notes) or len(flight.ticks) == len(undamaged.ticks), f"byte {at}"
        lost += len(flight.ticks) < len(undamaged.ticks)
    assert lost > 0


# --- what goes wrong meanwhile --------------------------------------------------------------------------------------


def test_closing_twice_does_no_harm(tmp_path: Path) -> None:
    with recorder(tmp_path) as recording:
        recording.add(TICK, 0, tick(0.0))
        assert recording.close() is None
        assert recording.close() is None
        recording.add(TICK, 1, tick(1.0))  # too late, and no harm either
        recording.flush()
        recording.close()
    assert len(read_flight(tmp_path).ticks) == 1


def test_a_killed_process_leaves_readable_files(tmp_path: Path) -> None:
    script = f"""
import os, signal
from pathlib import Path
from companion.record import schema
from companion.record.recorder import RECEIVED, TICK, Recorder
recorder = Recorder(Path({str(tmp_path)!r}))
for n in range(500):
    recorder.add(TICK, n, schema.pack_tick(schema.CDR_HEADER, *[float(n)] * {FLOAT_COUNT}, 0, 0, 0))
    recorder.add(RECEIVED, n, bytes([n % 256]) * 100)
recorder.flush()
print(recorder._process.pid, flush=True)
os.kill(os.getpid(), signal.SIGKILL)
"""
    killed = subprocess.run([sys.executable, "-c", script], check=False, capture_output=True, text=True)
    assert killed.returncode == -signal.SIGKILL, killed.stderr
    writer = Path("/proc") / killed.stdout.strip()
    wait_until(lambda: not writer.exists() or " Z " in (writer / "stat").read_text())
    assert list(read_flight(tmp_path).ticks["time_s"]) == list(range(500))
    assert [data for _, data in tlog_records(tmp_path, 100)] == [bytes([n % 256]) * 100 for n in range(500)]


def test_a_killed_writer_does_not_stop_the_recorder(tmp_path: Path) -> None:
    with recorder(tmp_path) as recording:
        tell(recording, signal.SIGKILL)
        recording._process.wait(PATIENCE_S)
        for n in range(20_000):
            recording.add(TICK, n, noise(n))
            recording.flush()
        assert recording.dropped > 0
        complaint = recording.close()
    assert complaint is not None
    assert complaint.startswith(f"{tmp_path}: the log is incomplete: ")
    assert len(complaint.splitlines()) == 1


def test_every_record_that_a_dead_writer_did_not_take_is_counted(tmp_path: Path) -> None:
    with recorder(tmp_path) as recording:
        tell(recording, signal.SIGKILL)
        recording._process.wait(PATIENCE_S)
        for n in range(1000):
            recording.add(TICK, n, noise(n))
        assert recording.dropped > 900, "all but the few that were on their way when it was found dead"


def test_a_full_disk_ends_the_log_with_one_line_and_nothing_else(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "flight.mcap").symlink_to("/dev/full")
    frames = [os.urandom(300) for _ in range(8000)]
    with recorder(tmp_path, blocking=True) as recording:
        for n, frame in enumerate(frames):  # blocking: this would hang if the pipe were not drained to its end
            recording.add(TICK, n, tick(n) + os.urandom(100))
            recording.add(SENT, n, frame)
        assert recording.dropped == 0
        complaint = recording.close()
    assert complaint is not None
    assert complaint.startswith(f"{tmp_path}: the log is incomplete")
    assert tlog_records(tmp_path, 300) == list(enumerate(frames)), "the other file is whole"
    captured = capfd.readouterr()
    assert captured.out == ""
    assert captured.err.splitlines() == [
        f"{tmp_path / 'flight.mcap'}: No space left on device: the log ends here, the flight goes on"
    ]


def test_a_disk_too_full_for_the_traffic_spares_the_flight(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "traffic.tlog").symlink_to("/dev/full")
    with recorder(tmp_path, blocking=True) as recording:
        for n in range(1000):
            recording.add(TICK, n, tick(n))
            recording.add(SENT, n, noise(n))
        assert recording.close() is not None
    assert list(read_flight(tmp_path).ticks["time_s"]) == list(range(1000))
    (line,) = capfd.readouterr().err.splitlines()
    assert line.startswith(f"{tmp_path / 'traffic.tlog'}: No space left on device")


def test_a_file_that_cannot_be_opened_costs_that_file_alone(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "flight.mcap").mkdir()
    with recorder(tmp_path) as recording:
        for n in range(100):
            recording.add(TICK, n, tick(n))
            recording.add(SENT, n, noise(n))
        assert recording.close() is not None
    assert len(capfd.readouterr().err.splitlines()) == 1
    assert len(tlog_records(tmp_path, 1000)) == 100


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP], ids=lambda number: number.name)
def test_the_writer_ends_with_the_pipe_and_not_before(number: signal.Signals, tmp_path: Path) -> None:
    with recorder(tmp_path, blocking=True) as recording:
        recording.add(TICK, 0, tick(0.0))
        recording.flush()
        wait_until((tmp_path / "flight.mcap").exists)
        tell(recording, number)
        time.sleep(0.2)
        recording.add(TICK, 1, tick(1.0))
        assert recording.close() is None
    assert len(read_flight(tmp_path).ticks) == 2


def test_a_stopped_writer_never_blocks_the_flight_and_what_is_lost_is_counted(tmp_path: Path) -> None:
    count, size = 20_000, 1000
    with recorder(tmp_path) as recording:
        tell(recording, signal.SIGSTOP)
        wait_until(lambda: stopped(recording))
        # a recorder that waits must not hang the tests
        alarm = threading.Timer(PATIENCE_S, tell, (recording, signal.SIGCONT))
        alarm.start()
        for n in range(count):
            recording.add(RECEIVED, n, noise(n, size))
        alarm.cancel()
        assert stopped(recording), "it has not been waited for"
        dropped = recording.dropped
        assert count // 4 < dropped < count
        tell(recording, signal.SIGCONT)
        assert recording.close() == f"{tmp_path}: the log is incomplete: {dropped} records dropped"
    kept = tlog_records(tmp_path, size)
    assert len(kept) == count - dropped
    assert kept == [(n, noise(n, size)) for n in range(len(kept))], "what was kept is whole and in order"


def test_a_writer_that_catches_up_takes_what_was_kept_in_memory(tmp_path: Path) -> None:
    count = 4000
    with recorder(tmp_path) as recording:
        tell(recording, signal.SIGSTOP)
        wait_until(lambda: stopped(recording))
        for n in range(count):
            recording.add(SENT, n, noise(n))
        tell(recording, signal.SIGCONT)
        assert recording.close() is None
        assert recording.dropped == 0
    assert tlog_records(tmp_path, 1000) == [(n, noise(n)) for n in range(count)]


def test_a_blocking_recorder_waits_for_its_writer_and_drops_nothing(tmp_path: Path) -> None:
    count, done = 15_000, threading.Event()

    def fill(recording: Recorder) -> None:
        for n in range(count):
            recording.add(SENT, n, noise(n))
        done.set()

    with recorder(tmp_path, blocking=True) as recording:
        tell(recording, signal.SIGSTOP)
        wait_until(lambda: stopped(recording))
        thread = threading.Thread(target=fill, args=(recording,))
        thread.start()
        assert not done.wait(0.5), "15 MB cannot have gone into a pipe that nobody reads"
        tell(recording, signal.SIGCONT)
        thread.join(PATIENCE_S)
        assert done.is_set()
        assert recording.close() is None
        assert recording.dropped == 0
    assert tlog_records(tmp_path, 1000) == [(n, noise(n)) for n in range(count)]


def test_a_writer_that_does_not_finish_is_given_up_after_the_timeout(tmp_path: Path) -> None:
    with recorder(tmp_path) as recording:
        recording.add(TICK, 0, tick(0.0))
        tell(recording, signal.SIGSTOP)
        wait_until(lambda: stopped(recording))
        began = time.monotonic()
        assert recording.close(timeout_s=0.2) == f"{tmp_path}: the log writer did not finish"
        assert time.monotonic() - began < PATIENCE_S
        assert recording._process.poll() == -signal.SIGKILL


def test_closing_with_much_pending_keeps_to_the_timeout(tmp_path: Path) -> None:
    with recorder(tmp_path) as recording:
        tell(recording, signal.SIGSTOP)
        wait_until(lambda: stopped(recording))
        for n in range(4000):
            recording.add(SENT, n, noise(n))
        alarm = threading.Timer(PATIENCE_S, tell, (recording, signal.SIGCONT))
        alarm.start()
        began = time.monotonic()
        complaint: Any = recording.close(timeout_s=0.2)
        elapsed_s = time.monotonic() - began
        alarm.cancel()
        alarm.join()
        assert elapsed_s < 0.5 * PATIENCE_S
        assert complaint is not None
