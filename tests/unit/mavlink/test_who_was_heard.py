"""Who was heard instead of the vehicle, whatever comes, in whatever pieces."""

from __future__ import annotations

from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v10 import common as mavlink1
from pymavlink.dialects.v20 import development as mavlink

from companion.mavlink.heard import Heard


def old(autopilot: int) -> bytes:
    """A heartbeat of 1/1 in MAVLink 1."""
    message = mavlink1.MAVLink_heartbeat_message(2, autopilot, 81, 0, 4, 3)
    return bytes(message.pack(mavlink1.MAVLink(None, srcSystem=1, srcComponent=1)))


@given(
    before=st.binary(max_size=40).filter(lambda data: b"\xfe" not in data and b"\xfd" not in data),
    cuts=st.lists(st.integers(0, 120), max_size=6),
)
def test_mavlink_1_is_known_on_a_line_that_cuts_it_anywhere(before: bytes, cuts: list[int]) -> None:
    heard = Heard((1, 1), (1, 191), stream=True)
    data = before + old(mavlink.MAV_AUTOPILOT_PX4) + before + old(mavlink.MAV_AUTOPILOT_PX4)
    places = sorted({0, len(data), *(min(cut, len(data)) for cut in cuts)})
    for begin, end in pairwise(places):
        heard.take(data[begin:end])
    assert "it speaks MAVLink 1 only" in heard.complaint(1.0)


@given(st.lists(st.binary(max_size=600), max_size=20), st.booleans())
def test_whatever_comes_ends_in_one_line(pieces: list[bytes], stream: bool) -> None:
    heard = Heard((1, 1), (1, 191), stream=stream)
    for piece in pieces:
        heard.take(piece)
    line = heard.complaint(1.0)
    assert line.startswith("no heartbeat of vehicle 1/1 within 1 s: ")
    assert "\n" not in line


def test_a_px4_that_was_old_and_then_new_is_no_longer_called_old() -> None:
    heard = Heard((1, 1), (1, 191), stream=False)
    heard.take(old(mavlink.MAV_AUTOPILOT_PX4))
    new = mavlink.MAVLink_heartbeat_message(2, mavlink.MAV_AUTOPILOT_PX4, 81, 0, 4, 3)
    heard.take(bytes(new.pack(mavlink.MAVLink(None, 1, 1))))
    assert "MAVLink 1" not in heard.complaint(1.0)


def test_frames_without_a_heartbeat_and_one_more_companion() -> None:
    heard = Heard((1, 1), (1, 191), stream=False)
    ping = mavlink.MAVLink_ping_message(0, 0, 0, 0)
    heard.take(bytes(ping.pack(mavlink.MAVLink(None, 7, 7))))
    assert "1 frames of others were heard, no heartbeat" in heard.complaint(1.0)
    heard.take(bytes(ping.pack(mavlink.MAVLink(None, 1, 191))))
    assert "another companion that goes by 1/191 as we do" in heard.complaint(1.0)
    assert heard.complaint(1.0, unsigned=3).endswith(
        "3 frames in its name were not signed by link.signing_key_file, or are old"
    )
