"""A file read by MAVLink FTP over a wire that loses frames: both sides without a link."""

from __future__ import annotations

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import development as mavlink

from companion.mavlink.codec import Frame, FrameParser
from companion.mavlink.logs.ftp import PAYLOAD, FtpRead, Opcode, answer, entry, request
from sitl.messages.file_transfer import FileTransfer
from sitl.messages.log_card import LogFile, synthetic_log

OURS, VEHICLE = (1, 192), (1, 1)


class Wire:
    """The vehicle behind a wire that loses a share of what passes, and carries so many frames in 10 ms."""

    def __init__(self, log: LogFile, lost: float = 0.0, seed: int = 1, frames_a_step: int = 1000) -> None:
        self._vehicle = FileTransfer([log], mav_log=True)
        self._lost, self._frames_a_step = lost, frames_a_step
        self._random = random.Random(seed)
        self._queue: list[bytes] = []
        self.now_s, self.asked = 0.0, 0
        self._sender = mavlink.MAVLink(None, *VEHICLE)
        name = b"@MAV_LOG/sess001/log001.ulg"
        self._vehicle.answer(bytes(request(VEHICLE, 1, Opcode.OPEN_FILE_RO, 0, 0, name, len(name)).payload))

    def ask(self, messages: list[mavlink.MAVLink_file_transfer_protocol_message]) -> None:
        for message in messages:
            self.asked += 1
            if self._random.random() >= self._lost:
                payload = self._vehicle.answer(bytes(message.payload), round(1e6 * self.now_s))
                told = mavlink.MAVLink_file_transfer_protocol_message(0, *OURS, list(payload))
                self._queue.append(bytes(told.pack(self._sender)))

    def frames(self) -> list[Frame]:
        self.now_s += 0.01
        carried, self._queue = self._queue[: self._frames_a_step], self._queue[self._frames_a_step :]
        return FrameParser().feed(b"".join(frame for frame in carried if self._random.random() >= self._lost))


def read(wire: Wire, size: int, start: int = 0) -> bytes:
    download = FtpRead(VEHICLE, OURS, 0, size, start)
    data = b""
    while not download.done:
        assert not download.stalled(wire.now_s)
        wire.ask(download.requests(wire.now_s))
        for frame in wire.frames():
            data += download.take(frame, wire.now_s)
    return data


@settings(max_examples=30)
@given(
    size=st.integers(19, 20_000),
    start=st.floats(0, 1),
    lost=st.sampled_from([0.0, 0.05, 0.3]),
    seed=st.integers(0, 1000),
)
def test_every_byte_comes_whatever_is_lost(size: int, start: float, lost: float, seed: int) -> None:
    log = synthetic_log(size, seed, time_utc_s=0)
    begin = int(start * size)
    assert read(Wire(log, lost, seed), size, begin) == log.data[begin:]


@pytest.mark.parametrize("frames_a_step", [1, 2])
def test_a_slow_line_is_not_asked_twice(frames_a_step: int) -> None:
    """16 answers under way take as long as a line needs; each is asked for once."""
    log = synthetic_log(60_000, 3, time_utc_s=0)
    wire = Wire(log, frames_a_step=frames_a_step)
    assert read(wire, 60_000) == log.data
    assert wire.asked == -(-60_000 // 239)


def test_what_is_lost_on_a_quick_link_does_not_cost_a_silence_each() -> None:
    log = synthetic_log(200_000, 3, time_utc_s=0)
    wire = Wire(log, 0.02)
    assert read(wire, 200_000) == log.data
    assert wire.now_s < 2.5


def test_an_answer_to_somebody_else_is_none_of_ours() -> None:
    payload = [2, 0, 0, Opcode.ACK, 0, Opcode.OPEN_FILE_RO, *[0] * 245]
    for target, ours in (((1, 192), True), ((0, 0), True), ((255, 190), False), ((1, 191), False)):
        message = mavlink.MAVLink_file_transfer_protocol_message(0, *target, payload)
        (frame,) = FrameParser().feed(bytes(message.pack(mavlink.MAVLink(None, *VEHICLE))))
        assert frame.message_id == PAYLOAD.message_id
        assert (answer(frame, OURS) is not None) is ours


@given(st.text(max_size=60))
def test_whatever_a_listing_says_is_a_name_and_numbers_of_32_bits(text: str) -> None:
    name, size, written = entry(text)
    assert text.startswith(name)
    assert 0 <= size < 2**32
    assert 0 <= written < 2**32


def test_a_listing_with_and_without_time() -> None:
    assert entry("a.ulg\t1234\t1700000000") == ("a.ulg", 1234, 1_700_000_000)
    assert entry("a.ulg\t1234") == ("a.ulg", 1234, 0)
    assert entry("a.ulg\t99999999999\t\u00b2") == ("a.ulg", 0, 0)
