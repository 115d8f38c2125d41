"""Framing, layouts and encoding, held against pymavlink: what is no frame is counted, what is one comes out whole."""

from __future__ import annotations

import math
import struct
from itertools import pairwise
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import development as mavlink

from companion.mavlink import px4
from companion.mavlink.codec import (
    CRC_BYTES,
    HEADER_BYTES,
    MAX_FRAME_BYTES,
    MOST_REJECTED,
    Encoder,
    Frame,
    FrameParser,
    Layout,
    decode_cold,
)

SENDER = (1, 191)
FEW = settings(max_examples=40)
MANY = settings(max_examples=120)


def sender(sequence: int = 0) -> Any:
    """pymavlink's packer, as the companion would use it."""
    packer = mavlink.MAVLink(None, srcSystem=SENDER[0], srcComponent=SENDER[1])
    packer.seq = sequence & 255
    return packer


def flattened(values: dict[str, Any], layout: Layout) -> list[float]:
    """Values by name in wire order, arrays flattened."""
    flat: list[float] = []
    for field in layout.fields:
        value = values[field]
        flat += value if isinstance(value, list | tuple) else [value]
    return flat


def odometry(sequence: int = 0, **changed: Any) -> bytes:
    values: dict[str, Any] = {
        "time_usec": 12_345_678, "frame_id": 1, "child_frame_id": 1, "x": 1.5, "y": -2.25, "z": -3.0,
        "q": [0.9, 0.1, -0.3, 0.2], "vx": 0.1, "vy": 0.2, "vz": -0.3, "rollspeed": 0.01, "pitchspeed": 0.02,
        "yawspeed": 0.03, "pose_covariance": [math.nan] * 21, "velocity_covariance": [0.5] * 21, "reset_counter": 7,
        "estimator_type": 8, "quality": 100,
    }  # fmt: skip
    return bytes(mavlink.MAVLink_odometry_message(**{**values, **changed}).pack(sender(sequence)))


def current_mode(sequence: int = 0) -> bytes:
    return bytes(mavlink.MAVLink_current_mode_message(3, 0x3040000, 0x60000).pack(sender(sequence)))


def heartbeat(sequence: int = 0) -> bytes:
    return bytes(px4.heartbeat(mavlink.MAV_STATE_ACTIVE).pack(sender(sequence)))


def setpoint(sequence: int = 0) -> bytes:
    message = mavlink.MAVLink_set_attitude_target_message(1000, 1, 1, 7, [1.0, 0.0, 0.0, 0.0], 0.0, 0.0, 0.0, 0.5)
    return bytes(message.pack(sender(sequence)))


FRAMES = {
    "HEARTBEAT": heartbeat(1),
    "CURRENT_MODE": current_mode(2),
    "SET_ATTITUDE_TARGET": setpoint(3),
    "ODOMETRY": odometry(4),
}
each_frame = pytest.mark.parametrize("frame", FRAMES.values(), ids=FRAMES)
streams_and_datagrams = pytest.mark.parametrize("stream", [False, True], ids=["datagrams", "stream"])

# Bytes that are no frame: anything; anything rich in the magic; a real frame's beginning. Little enough of it that what
# the tests below put together stays below `MOST_REJECTED`.
garbage = st.one_of(
    st.binary(max_size=14),
    st.lists(st.sampled_from([0xFD, 0x00, 0x09, 0x53, 0xFF]), max_size=14).map(bytes),
    st.builds(
        lambda frame, length: frame[: min(length, len(frame) - 1)],
        st.sampled_from(list(FRAMES.values())),
        st.integers(0, 250),
    ),
)
good_frames = st.integers(0, 255).flatmap(
    lambda sequence: st.sampled_from([f(sequence) for f in (heartbeat, current_mode, setpoint, odometry)])
)


# --- framing --------------------------------------------------------------------------------------------------------


@streams_and_datagrams
def test_whole_frames_come_out_in_order_with_their_header(stream: bool) -> None:
    parser = FrameParser(stream=stream)
    frames = parser.feed(b"".join(FRAMES.values()))
    assert [frame.raw for frame in frames] == list(FRAMES.values())
    assert [frame.message_id for frame in frames] == [0, 436, 82, 331]
    assert [frame.sequence for frame in frames] == [1, 2, 3, 4]
    assert {(frame.system_id, frame.component_id) for frame in frames} == {SENDER}
    assert [frame.payload for frame in frames] == [raw[HEADER_BYTES:-CRC_BYTES] for raw in FRAMES.values()]
    assert (parser.frames, parser.bad_crc, parser.unknown, parser.dropped_bytes) == (4, 0, 0, 0)


@each_frame
def test_a_frame_with_any_one_bit_flipped_is_counted_and_dropped(frame: bytes) -> None:
    for bit in range(8 * len(frame)):
        flipped = bytearray(frame)
        flipped[bit // 8] ^= 1 << bit % 8
        parser = FrameParser()
        assert parser.feed(bytes(flipped)) == [], f"bit {bit}"
        assert (parser.frames, parser.dropped_bytes) == (0, len(frame)), f"bit {bit}"
        if bit // 8 > 2:  # not the magic, the length or the signature flag: those leave bytes that are no frame at all
            assert parser.bad_crc + parser.unknown > 0, f"bit {bit}"


@each_frame
@streams_and_datagrams
def test_a_flipped_bit_costs_that_frame_alone(frame: bytes, stream: bool) -> None:
    after = [heartbeat(n) for n in range(20)]  # more than the longest frame that a broken length can announce
    assert len(b"".join(after)) > MAX_FRAME_BYTES
    for bit in range(0, 8 * len(frame), 5):
        flipped = bytearray(frame)
        flipped[bit // 8] ^= 1 << bit % 8
        parser = FrameParser(stream=stream)
        assert [found.raw for found in parser.feed(bytes(flipped) + b"".join(after))] == after, f"bit {bit}"
        assert (parser.frames, parser.dropped_bytes) == (20, len(frame)), f"bit {bit}"


@each_frame
def test_a_truncated_datagram_is_dropped_and_forgotten(frame: bytes) -> None:
    for length in range(1, len(frame)):
        parser = FrameParser()
        assert parser.feed(frame[:length]) == []
        assert (parser.frames, parser.dropped_bytes) == (0, length)
        assert parser.feed(frame[length:] + heartbeat())[-1].raw == heartbeat(), f"cut at {length}"
        assert parser.frames == 1, f"the two halves cut at {length} are two datagrams, not a frame"


@each_frame
def test_a_truncated_stream_waits_for_the_rest(frame: bytes) -> None:
    for length in range(1, len(frame)):
        parser = FrameParser(stream=True)
        assert parser.feed(frame[:length]) == []
        assert parser.dropped_bytes == 0
        assert [found.raw for found in parser.feed(frame[length:])] == [frame]
        assert (parser.frames, parser.dropped_bytes) == (1, 0)


def test_a_message_id_that_the_dialect_does_not_know_is_counted() -> None:
    frame = bytearray(heartbeat())
    frame[7:10] = b"\xff\xff\x00"
    parser = FrameParser()
    assert [found.raw for found in parser.feed(bytes(frame) + current_mode())] == [current_mode()]
    assert (parser.frames, parser.unknown, parser.bad_crc, parser.dropped_bytes) == (1, 1, 0, len(frame))


def test_a_mavlink_1_frame_is_dropped() -> None:
    message = px4.heartbeat(mavlink.MAV_STATE_ACTIVE)
    old = bytes(message.pack(sender(), force_mavlink1=True))
    assert old[0] == 0xFE
    parser = FrameParser()
    assert [found.raw for found in parser.feed(old + heartbeat())] == [heartbeat()]
    assert parser.dropped_bytes == len(old)


@streams_and_datagrams
def test_a_signed_frame_is_taken_whole(stream: bool) -> None:
    packer = sender(9)
    packer.signing.secret_key = bytes(range(32))
    packer.signing.sign_outgoing = True
    packer.signing.timestamp = 1
    signed = bytes(px4.heartbeat(mavlink.MAV_STATE_ACTIVE).pack(packer))
    assert len(signed) == len(heartbeat()) + 13
    parser = FrameParser(stream=stream)
    frames = parser.feed(signed + heartbeat(10))
    assert [frame.raw for frame in frames] == [signed, heartbeat(10)]
    assert frames[0].payload == heartbeat(9)[HEADER_BYTES:-CRC_BYTES]
    assert parser.dropped_bytes == 0


@MANY
@given(st.lists(st.tuples(garbage, good_frames), min_size=1, max_size=8), garbage)
def test_garbage_between_the_frames_of_a_datagram_never_costs_one(
    pieces: list[tuple[bytes, bytes]], tail: bytes
) -> None:
    parser = FrameParser()
    frames = parser.feed(b"".join(noise + frame for noise, frame in pieces) + tail)
    assert [frame.raw for frame in frames] == [frame for _, frame in pieces]
    assert parser.frames == len(pieces)
    assert parser.dropped_bytes == sum(len(noise) for noise, _ in pieces) + len(tail)


@MANY
@given(st.lists(st.tuples(garbage, good_frames), min_size=1, max_size=8), st.lists(st.integers(1, 400), max_size=20))
def test_a_stream_cut_anywhere_gives_the_frames_of_the_whole(
    pieces: list[tuple[bytes, bytes]], lengths: list[int]
) -> None:
    line = b"".join(noise + frame for noise, frame in pieces)
    line += bytes(MAX_FRAME_BYTES)  # so that no announced length is still waited for at the end
    parser = FrameParser(stream=True)
    found: list[Frame] = []
    at = 0
    for length in [*lengths, len(line)]:
        found += parser.feed(line[at : at + length])
        at += length
    assert [frame.raw for frame in found] == [frame for _, frame in pieces]
    whole = FrameParser(stream=True)
    assert whole.feed(line) == found
    counters = ("frames", "bad_crc", "unknown", "dropped_bytes")
    assert [getattr(parser, name) for name in counters] == [getattr(whole, name) for name in counters]


@MANY
@given(st.lists(st.binary(max_size=300), max_size=10), st.booleans())
def test_noise_is_no_frame_and_raises_nothing(chunks: list[bytes], stream: bool) -> None:
    parser = FrameParser(stream=stream)
    for chunk in chunks:
        assert parser.feed(chunk) == []
    assert parser.frames == 0
    assert parser.dropped_bytes <= sum(map(len, chunks))
    if not stream:
        assert parser.dropped_bytes == sum(map(len, chunks))


# Each byte or every few of them may begin a frame: by its header alone, by a length beyond the datagram, by its CRC.
CRAFTED = {
    "unknown": b"\xfd" * 2048,
    "too long": b"".join(b"\xfd\xff\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00" for _ in range(21)),
    "bad CRC": (b"\xfd\xff\x01\x01\x00" * 410)[:2048],
}


@streams_and_datagrams
@pytest.mark.parametrize("data", CRAFTED.values(), ids=CRAFTED)
def test_crafted_bytes_are_given_up_after_a_bounded_number_of_looks(data: bytes, stream: bool) -> None:
    parser = FrameParser(stream=stream)
    for _ in range(10):
        before = parser.unknown + parser.bad_crc
        assert parser.feed(data) == []
        assert parser.unknown + parser.bad_crc - before <= (len(data) if stream else MOST_REJECTED)
    assert [frame.raw for frame in parser.feed(bytes(MAX_FRAME_BYTES) + heartbeat())] == [heartbeat()]


FALSE = b"\xfd\x00\x00" + b"\xff" * 9  # as a beginning has it, of a message that there is not


def test_in_a_datagram_frames_before_the_crafted_bytes_are_kept_and_those_behind_them_lost() -> None:
    parser = FrameParser()
    frames = parser.feed(heartbeat(1) + FALSE * MOST_REJECTED + heartbeat(2))
    assert [frame.raw for frame in frames] == [heartbeat(1)]
    assert parser.dropped_bytes == MOST_REJECTED * len(FALSE) + len(heartbeat(2))
    frames = parser.feed(heartbeat(3) + FALSE * (MOST_REJECTED - 1) + heartbeat(4))
    assert [frame.raw for frame in frames] == [heartbeat(3), heartbeat(4)]


@pytest.mark.parametrize("burst", [b"\xfd", b"\xfd\xfd\x00\x00", FALSE, b"\xfd\x00\x00\x00\x00\x01\x01\x00\x00\x00"])
def test_on_a_line_a_frame_behind_a_burst_is_found_whatever_the_burst_is(burst: bytes) -> None:
    """A line with something else's noise on it: each read ends in the vehicle's heartbeat, behind two kilobytes."""
    parser = FrameParser(stream=True)
    for n in range(20):
        frames = parser.feed(burst * (2000 // len(burst)) + b"\xff" * MAX_FRAME_BYTES + heartbeat(n))
        assert [frame.raw for frame in frames] == [heartbeat(n)]
        assert len(parser._rest) < MAX_FRAME_BYTES


@streams_and_datagrams
def test_a_burst_of_beginnings_costs_no_more_than_a_search(stream: bool) -> None:
    parser = FrameParser(stream=stream)
    parser.feed(b"\xfd" * 1_000_000)
    assert (parser.frames, parser.bad_crc, parser.unknown) == (0, 0, 0)
    assert parser.dropped_bytes >= 1_000_000 - 2


# --- layouts --------------------------------------------------------------------------------------------------------


def test_a_layout_is_that_of_the_dialect() -> None:
    layout = Layout("ODOMETRY")
    assert (layout.message_id, layout.crc_extra, layout.size) == (331, 91, 233)
    assert layout.fields == tuple(mavlink.MAVLink_odometry_message.ordered_fieldnames)
    assert layout.place("q") == slice(4, 8)
    assert layout.index("vx") == 8
    with pytest.raises(KeyError, match="array"):
        layout.index("q")
    with pytest.raises(KeyError):
        layout.place("no_such_field")
    with pytest.raises(KeyError):
        Layout("NO_SUCH_MESSAGE")
    with pytest.raises(ValueError, match="STATUSTEXT carries text"):
        Layout("STATUSTEXT")


def test_every_message_without_text_has_a_layout_of_the_size_pymavlink_reads() -> None:
    for message in mavlink.mavlink_map.values():
        if b"c" in bytes(message.native_format):
            continue
        layout = Layout(message.msgname)
        assert layout.size == message.unpacker.size, message.msgname
        assert len(layout.unpack(b"")) == len(message.unpacker.unpack(bytes(message.unpacker.size))), message.msgname


def test_a_payload_cut_short_is_padded_and_one_too_long_is_cut() -> None:
    layout = Layout("CURRENT_MODE")
    assert layout.unpack(b"\x07") == (7, 0, 0)
    whole = struct.pack("<IIB", 1, 2, 3)
    assert layout.unpack(whole + b"an extension to come") == (1, 2, 3)
    assert layout.named(whole) == {"custom_mode": 1, "intended_custom_mode": 2, "standard_mode": 3}


def test_a_cold_frame_is_decoded_by_pymavlink() -> None:
    message = mavlink.MAVLink_statustext_message(mavlink.MAV_SEVERITY_WARNING, b"companion: pose_stale")
    (frame,) = FrameParser().feed(bytes(message.pack(sender())))
    decoded = decode_cold(frame)
    assert (decoded.get_type(), decoded.text) == ("STATUSTEXT", "companion: pose_stale")


# --- encoding -------------------------------------------------------------------------------------------------------


def unsigned(bits: int) -> st.SearchStrategy[int]:
    return st.integers(0, 2**bits - 1)


single = st.one_of(st.floats(width=32), st.just(0.0), st.just(-0.0))


def several(count: int) -> st.SearchStrategy[list[float]]:
    return st.lists(single, min_size=count, max_size=count)


SET_ATTITUDE_TARGET_VALUES = st.fixed_dictionaries(
    {
        "time_boot_ms": unsigned(32),
        "target_system": unsigned(8),
        "target_component": unsigned(8),
        "type_mask": unsigned(8),
        "q": several(4),
        "body_roll_rate": single,
        "body_pitch_rate": single,
        "body_yaw_rate": single,
        "thrust": single,
    }
)
ODOMETRY_VALUES = st.fixed_dictionaries(
    {
        "time_usec": unsigned(64),
        "frame_id": unsigned(8),
        "child_frame_id": unsigned(8),
        **dict.fromkeys(("x", "y", "z", "vx", "vy", "vz", "rollspeed", "pitchspeed", "yawspeed"), single),
        "q": several(4),
        "pose_covariance": several(21),
        "velocity_covariance": several(21),
        "reset_counter": unsigned(8),
        "estimator_type": unsigned(8),
        "quality": st.integers(-128, 127),
    }
)
HEARTBEAT_VALUES = st.fixed_dictionaries(
    {
        "type": unsigned(8),
        "autopilot": unsigned(8),
        "base_mode": unsigned(8),
        "custom_mode": unsigned(32),
        "system_status": unsigned(8),
        "mavlink_version": unsigned(8),
    }
)


def assert_packed_alike(name: str, values: dict[str, Any], sequence: int, ids: tuple[int, int]) -> None:
    layout = Layout(name)
    packer = mavlink.MAVLink(None, srcSystem=ids[0], srcComponent=ids[1])
    packer.seq = sequence % 256
    theirs = bytes(getattr(mavlink, f"MAVLink_{name.lower()}_message")(**values).pack(packer))
    ours = Encoder(layout, *ids).encode(sequence, *flattened(values, layout))
    assert ours == theirs
    (frame,) = FrameParser().feed(ours)
    assert layout.pack(*layout.unpack(frame.payload)) == layout.pack(*flattened(values, layout))


ids = st.tuples(st.integers(1, 255), st.integers(1, 255))


@FEW
@given(SET_ATTITUDE_TARGET_VALUES, st.integers(0, 1000), ids)
def test_set_attitude_target_is_packed_as_pymavlink_does(
    values: dict[str, Any], sequence: int, ids: tuple[int, int]
) -> None:
    assert_packed_alike("SET_ATTITUDE_TARGET", values, sequence, ids)


@FEW
@given(ODOMETRY_VALUES, st.integers(0, 1000), ids)
def test_odometry_is_packed_as_pymavlink_does(values: dict[str, Any], sequence: int, ids: tuple[int, int]) -> None:
    assert_packed_alike("ODOMETRY", values, sequence, ids)


@FEW
@given(HEARTBEAT_VALUES, st.integers(0, 1000), ids)
def test_heartbeat_is_packed_as_pymavlink_does(values: dict[str, Any], sequence: int, ids: tuple[int, int]) -> None:
    assert_packed_alike("HEARTBEAT", values, sequence, ids)


def test_a_signed_header_is_the_only_difference() -> None:
    layout = Layout("HEARTBEAT")
    plain, signed = (Encoder(layout, *SENDER, signed=flag).encode(7, 0, 18, 8, 0, 4, 3) for flag in (False, True))
    assert (plain[2], signed[2]) == (0, 1)
    assert signed[3:-CRC_BYTES] == plain[3:-CRC_BYTES]
    assert signed[-CRC_BYTES:] != plain[-CRC_BYTES:]


def test_trailing_zeros_are_cut_down_to_one_byte() -> None:
    layout = Layout("ODOMETRY")
    encoder = Encoder(layout, *SENDER)
    zeros = [0] * len(layout.unpack(b""))
    for nonzero in range(len(zeros) + 1):
        values = [1] * nonzero + zeros[nonzero:]
        named = dict(zip(layout.fields, _regrouped(values, layout), strict=True))
        expected = bytes(mavlink.MAVLink_odometry_message(**named).pack(sender(5)))
        assert encoder.encode(5, *values) == expected, f"{nonzero} values that are not zero"
    assert len(encoder.encode(0, *zeros)) == HEADER_BYTES + 1 + CRC_BYTES
    (frame,) = FrameParser().feed(encoder.encode(0, *zeros))
    assert frame.payload == b"\0"
    assert layout.unpack(frame.payload) == tuple(zeros)


def _regrouped(values: list[float], layout: Layout) -> list[Any]:
    return [values[layout.place(field)] for field in layout.fields]


def test_the_sequence_wraps_at_256() -> None:
    layout = Layout("HEARTBEAT")
    encoder = Encoder(layout, *SENDER)
    frames = FrameParser().feed(b"".join(encoder.encode(n, 0, 18, 8, 0, 4, 3) for n in range(250, 520)))
    sequences = [frame.sequence for frame in frames]
    assert len(sequences) == 270
    assert all(later == (earlier + 1) % 256 for earlier, later in pairwise(sequences))
    assert encoder.encode(256, 0, 18, 8, 0, 4, 3) == heartbeat(0)
