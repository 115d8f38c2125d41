"""MAVLink 2 signing, held against pymavlink's own both ways; what is replayed, forged or unsigned is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import development as mavlink

from companion.config import ConfigError, load_config
from companion.mavlink import px4
from companion.mavlink.codec import Encoder, Frame, FrameParser, Layout
from companion.mavlink.signing import MINUTE, Signing, read_key, system_clock

KEY = bytes(range(1, 33))
DIGITS = KEY.hex().encode()
NOW = 3_000_000_000_000
keys = st.binary(min_size=32, max_size=32)
MANY = settings(max_examples=100)


def their(key: bytes = KEY, *, link_id: int = 0, timestamp: int = NOW, system: int = 1, component: int = 1) -> Any:
    """pymavlink's packer and parser, signing and checking."""
    mav = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
    mav.signing.secret_key = key
    mav.signing.sign_outgoing = True
    mav.signing.link_id = link_id
    mav.signing.timestamp = timestamp
    return mav


def ours(key: bytes = KEY, *, link_id: int = 0, now: int = NOW) -> Signing:
    return Signing(key, link_id=link_id, clock=lambda: now)


def framed(data: bytes) -> Frame:
    (frame,) = FrameParser().feed(data)
    return frame


def heartbeat(mav: Any) -> bytes:
    return bytes(px4.heartbeat(mavlink.MAV_STATE_ACTIVE).pack(mav))


def unsigned(sequence: int = 0) -> bytes:
    mav = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    mav.seq = sequence
    return heartbeat(mav)


# --- against pymavlink ----------------------------------------------------------------------------------------------


def messages() -> list[Any]:
    return [
        px4.heartbeat(mavlink.MAV_STATE_ACTIVE),
        px4.set_mode(1, 1, px4.Mode.HOLD),
        mavlink.MAVLink_statustext_message(mavlink.MAV_SEVERITY_WARNING, b"companion: pose_stale"),
        mavlink.MAVLink_current_mode_message(3, 0x3040000, 0x60000),
    ]


@pytest.mark.parametrize("link_id", [0, 7, 255])
def test_what_we_sign_is_what_pymavlink_signs(link_id: int) -> None:
    mav, signing = their(link_id=link_id), ours(link_id=link_id)
    plain = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    for sequence, message in enumerate(messages() * 3):
        mav.seq = plain.seq = sequence
        expected = bytes(message.pack(mav))
        assert signing.sign(bytes(message.pack(plain))) == expected


def test_the_fast_encoder_signs_as_pymavlink_does() -> None:
    layout = Layout("SET_ATTITUDE_TARGET")
    mav, signing = their(system=1, component=191), ours()
    encode = Encoder(layout, 1, 191, signed=True).encode
    for sequence in range(300):
        mav.seq = sequence & 255
        q = [1.0, 0.0, 0.001 * sequence, 0.0]
        message = mavlink.MAVLink_set_attitude_target_message(sequence, 1, 1, 7, q, 0.0, 0.0, 0.0, 0.5)
        values = (sequence, *q, 0.0, 0.0, 0.0, 0.5, 1, 1, 7)
        assert signing.seal(encode(sequence, *values)) == bytes(message.pack(mav))


def test_pymavlink_believes_what_we_sign() -> None:
    mav, signing = their(), ours()
    for sequence in range(20):
        decoded = mav.decode(bytearray(signing.sign(unsigned(sequence))))
        assert decoded.get_type() == "HEARTBEAT"
    assert mav.signing.goodsig_count == 20
    with pytest.raises(mavlink.MAVError, match="Invalid signature"):
        mav.decode(bytearray(ours(bytes(32)[:-1] + b"\x01").sign(unsigned())))


def test_we_believe_what_pymavlink_signs() -> None:
    signing = ours()
    for link_id in (0, 3):
        mav = their(link_id=link_id)
        assert all(signing.verify(framed(bytes(message.pack(mav)))) for message in messages() * 5)
    assert (signing.unsigned, signing.bad_signature, signing.replayed) == (0, 0, 0)


@MANY
@given(
    st.binary(min_size=32, max_size=32), st.integers(0, 255), st.integers(NOW, 2**48 - 10), st.integers(0, 2**32 - 1)
)
def test_both_agree_for_any_key_link_and_time(key: bytes, link_id: int, timestamp: int, custom_mode: int) -> None:
    mav = their(key, link_id=link_id, timestamp=timestamp)
    message = mavlink.MAVLink_heartbeat_message(2, 12, 0, custom_mode, 4, 3)
    theirs = bytes(message.pack(mav))
    plain = bytes(message.pack(mavlink.MAVLink(None, srcSystem=1, srcComponent=1)))
    assert ours(key, link_id=link_id, now=timestamp).sign(plain) == theirs
    assert ours(key).verify(framed(theirs))


# --- what is refused ------------------------------------------------------------------------------------------------


def test_an_unsigned_frame_is_refused_but_for_the_radio_s_own_report() -> None:
    signing = ours()
    assert not signing.verify(framed(unsigned()))
    assert signing.unsigned == 1
    radio = mavlink.MAVLink_radio_status_message(200, 200, 90, 20, 20, 0, 0)
    assert signing.verify(framed(bytes(radio.pack(mavlink.MAVLink(None, srcSystem=51, srcComponent=68)))))
    assert signing.unsigned == 1


def test_a_frame_signed_by_another_key_is_refused() -> None:
    signing = ours()
    assert not signing.verify(framed(heartbeat(their(bytes(32)))))
    assert (signing.unsigned, signing.bad_signature, signing.replayed) == (0, 1, 0)


def test_a_forged_frame_does_not_push_the_time_of_its_stream() -> None:
    signing = ours()
    assert not signing.verify(framed(heartbeat(their(bytes(32), timestamp=2**48 - 2))))
    assert signing.verify(framed(heartbeat(their())))
    assert stamp(signing.sign(unsigned())) == NOW + 1


@MANY
@given(st.integers(0, 8 * 34 - 1))
def test_a_frame_with_any_one_bit_flipped_is_never_believed(bit: int) -> None:
    flipped = bytearray(heartbeat(their()))
    assert len(flipped) == 34
    flipped[bit // 8] ^= 1 << bit % 8
    signing = ours()
    assert not any(signing.verify(frame) for frame in FrameParser().feed(bytes(flipped)))


def test_a_replayed_frame_is_refused_and_counted() -> None:
    signing, mav = ours(), their()
    recorded = [framed(heartbeat(mav)) for _ in range(10)]
    assert all(signing.verify(frame) for frame in recorded)
    assert not any(signing.verify(frame) for frame in recorded)
    assert signing.replayed == 10
    assert signing.verify(framed(heartbeat(mav)))


def test_each_system_component_and_link_is_a_stream_of_its_own() -> None:
    signing = ours()
    streams = [(1, 1, 0), (1, 1, 1), (1, 2, 0), (2, 1, 0)]
    for system, component, link_id in streams:
        assert signing.verify(framed(heartbeat(their(link_id=link_id, system=system, component=component))))
    for system, component, link_id in streams:
        assert not signing.verify(framed(heartbeat(their(link_id=link_id, system=system, component=component))))
    assert signing.replayed == 4


@pytest.mark.parametrize(("behind", "believed"), [(0, True), (MINUTE, True), (MINUTE + 1, False), (NOW, False)])
def test_a_new_stream_may_be_a_minute_behind_and_no_more(behind: int, believed: bool) -> None:
    signing = ours()
    assert signing.verify(framed(heartbeat(their(timestamp=NOW - behind)))) is believed
    assert signing.replayed == (not believed)


def test_a_stream_that_has_begun_is_held_to_its_own_order_alone() -> None:
    """A vehicle without a clock that started at zero is heard on, once we have told it the time."""
    signing = ours()
    mav = their(timestamp=NOW - MINUTE)
    assert signing.verify(framed(heartbeat(mav)))
    assert signing.verify(framed(heartbeat(their(timestamp=NOW + 100 * MINUTE, link_id=1))))
    assert signing.verify(framed(heartbeat(mav)))


# --- our own time ---------------------------------------------------------------------------------------------------


def stamp(frame: bytes) -> int:
    return int.from_bytes(frame[-12:-6], "little")


def test_our_stamps_grow_even_where_the_clock_stands_or_goes_back() -> None:
    times = iter([5, 5, 4, 100, 3])
    signing = Signing(KEY, clock=lambda: next(times))
    assert [stamp(signing.sign(unsigned())) for _ in range(5)] == [5, 6, 7, 100, 101]


def test_we_take_the_time_from_whoever_is_ahead() -> None:
    """A companion without a battery-backed clock comes up in the past; the vehicle's frames bring it to the present."""
    signing = Signing(KEY, clock=lambda: 0)
    assert signing.verify(framed(heartbeat(their(timestamp=NOW))))
    assert stamp(signing.sign(unsigned())) == NOW + 1


def test_the_wall_clock_is_read_once(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = system_clock()
    before = clock()
    monkeypatch.setattr("time.time_ns", lambda: 0)
    assert 0 <= clock() - before < 100_000
    assert before > NOW  # 10 µs since 2015


# --- the key file ---------------------------------------------------------------------------------------------------


def write_key(path: Path, data: bytes, mode: int = 0o600) -> Path:
    path.write_bytes(data)
    path.chmod(mode)
    return path


@pytest.mark.parametrize("data", [KEY, DIGITS, DIGITS.upper() + b"\n", b" " + DIGITS])
def test_a_key_is_32_bytes_or_64_digits(tmp_path: Path, data: bytes) -> None:
    assert read_key(write_key(tmp_path / "key", data)) == KEY


def test_a_raw_key_that_looks_like_text_is_taken_as_it_is(tmp_path: Path) -> None:
    assert read_key(write_key(tmp_path / "key", b"0123456789abcdef" * 2)) == b"0123456789abcdef" * 2


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"", "not a key"),
        (KEY + b"\n", "not a key"),
        (KEY.hex().encode()[:-1], "not a key"),
        (b"g" * 64, "not a key"),
        (bytes(32), "key of zeros"),
        (b"0" * 64, "key of zeros"),
    ],
)
def test_what_is_no_key_is_refused_in_one_line(tmp_path: Path, data: bytes, reason: str) -> None:
    path = write_key(tmp_path / "key", data)
    with pytest.raises(ConfigError, match=reason) as caught:
        read_key(path)
    assert str(caught.value).startswith(f"link.signing_key_file {path}: ")
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize(("mode", "taken"), [(0o600, True), (0o640, True), (0o644, False), (0o602, False)])
def test_a_key_that_anybody_may_read_is_refused(tmp_path: Path, mode: int, taken: bool) -> None:
    path = write_key(tmp_path / "key", KEY, mode)
    if taken:
        assert read_key(path) == KEY
        return
    with pytest.raises(ConfigError, match=f"chmod 600 {path}"):
        read_key(path)


def test_a_key_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="No such file"):
        read_key(tmp_path / "key")


def test_a_relative_path_starts_at_the_config(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Not at the folder one happens to be in: a service and a person must mean the same file."""
    shipped = Path(__file__).resolve().parents[3] / "config" / "antx_rig.yaml"
    (tmp_path / "rig.yaml").write_text(shipped.read_text())
    monkeypatch.chdir("/")
    config = load_config(tmp_path / "rig.yaml", ("link.signing_key_file=keys/rig.key",))
    assert config.link.signing_key_file == tmp_path / "keys" / "rig.key"
    absolute = load_config(tmp_path / "rig.yaml", ("link.signing_key_file=/etc/companion/rig.key",))
    assert absolute.link.signing_key_file == Path("/etc/companion/rig.key")
    assert load_config(shipped).link.signing_key_file is None
