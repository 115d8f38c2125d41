"""Nobody is believed on a recording: the vehicle answers a question first, and what is kept outlives a restart."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import development as mavlink

from companion.mavlink import px4
from companion.mavlink.codec import Frame, FrameParser
from companion.mavlink.freshness import FreshSigning
from companion.mavlink.signing import MINUTE, Signing
from companion.mavlink.stamps import read_stamps, stamps_file, write_stamps

KEY = bytes(range(1, 33))
NOW = 3_000_000_000_000
SECOND = MINUTE // 60
VEHICLE, OWN = (1, 1), (1, 191)


class Sender:
    """Somebody with the key, on one link."""

    def __init__(self, system: int = 1, component: int = 1, *, link_id: int = 0, now: int = NOW) -> None:
        self._packer = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
        self._signing = Signing(KEY, link_id=link_id, clock=lambda: now)

    def says(self, message: Any) -> Frame:
        (frame,) = FrameParser().feed(self._signing.sign(bytes(message.pack(self._packer))))
        return frame

    def heartbeat(self) -> Frame:
        return self.says(px4.heartbeat(mavlink.MAV_STATE_ACTIVE))

    def answers(self, nonce: int | None, theirs: int = 7) -> Frame:
        assert nonce is not None
        return self.says(mavlink.MAVLink_timesync_message(theirs, nonce))


def listener(now: int = NOW, kept: dict[tuple[int, int, int], int] | None = None) -> FreshSigning:
    return FreshSigning(KEY, VEHICLE, OWN, kept=kept, clock=lambda: now)


def proven(vehicle: Sender, signing: FreshSigning) -> FreshSigning:
    assert signing.verify(vehicle.answers(signing.challenge(0.0)))
    return signing


def test_a_recording_of_the_vehicle_is_not_believed_after_a_restart() -> None:
    vehicle, first = Sender(), listener()
    question = first.challenge(0.0)
    recording = [vehicle.heartbeat(), vehicle.answers(question), *(vehicle.heartbeat() for _ in range(20))]
    assert [first.verify(frame) for frame in recording] == [False] + [True] * 21
    again = listener()  # no second later, and nothing kept
    assert not any(again.verify(frame) for frame in recording)
    assert (again.unproven, again.replayed, again.proven, again.wanted) == (22, 0, False, True)
    assert not again.verify(vehicle.answers(question))  # the last run's
    assert again.verify(vehicle.answers(again.challenge(0.0)))
    assert not any(again.verify(frame) for frame in recording)
    assert again.verify(vehicle.heartbeat())


def test_an_old_heartbeat_of_another_link_of_the_vehicle_is_dropped_in_flight() -> None:
    vehicle, other = Sender(link_id=2), Sender(link_id=5, now=NOW - 30 * SECOND)
    signing = proven(vehicle, listener())
    assert not signing.verify(other.heartbeat())
    assert (signing.unproven, signing.wanted) == (1, True)
    assert signing.verify(vehicle.heartbeat())
    assert signing.verify(other.answers(signing.challenge(10.0)))  # it lives: a second radio
    assert signing.verify(other.heartbeat())


def test_only_the_vehicle_s_own_answer_counts() -> None:
    signing, vehicle = listener(), Sender()
    nonce = signing.challenge(0.0)
    assert not signing.verify(vehicle.answers((nonce or 0) ^ 2))
    for other in (Sender(1, 2), Sender(*OWN)):
        signing.verify(other.answers(nonce, theirs=0))  # our own question, sent back, among them
        assert not signing.proven


def test_questions_cannot_be_guessed_and_are_not_worn_out_by_a_recording_that_asks_for_them() -> None:
    numbers = {listener().challenge(0.0) for _ in range(50)}
    assert len(numbers) == 50
    assert all(number is not None and 0 < number < 2**63 for number in numbers)
    signing, vehicle = listener(), Sender()
    asked = signing.challenge(0.0)
    for n in range(1000):
        signing.challenge(0.001 * n)
    assert signing.verify(vehicle.answers(asked))


def test_an_answer_that_is_older_than_two_questions_is_nothing() -> None:
    signing, vehicle = listener(), Sender()
    asked = signing.challenge(0.0)
    for second in (2.5, 5.0, 7.5):
        signing.challenge(second)
    assert not signing.verify(vehicle.answers(asked))


def test_in_flight_nobody_makes_us_ask_more_than_five_times_a_second() -> None:
    signing = proven(Sender(), listener())
    asked = [signing.challenge(1.0 + 0.001 * n) for n in range(1000)]
    assert 4 <= sum(number is not None for number in asked) <= 5


def test_a_vehicle_whose_stamps_are_behind_is_asked_and_takes_ours() -> None:
    """A PX4 that has just started signs with old stamps until it hears a newer one."""
    signing = listener(kept={(1, 1, 0): NOW - SECOND})
    late = Sender(now=NOW - 500 * MINUTE)
    assert not signing.verify(late.heartbeat())
    assert signing.wanted
    assert not signing.verify(late.answers(signing.challenge(0.0)))  # it has not heard the question
    assert signing.verify(Sender(now=NOW + 1).answers(signing.challenge(3.0)))


def test_what_others_recorded_before_we_began_is_refused() -> None:
    station = Sender(255, 190, now=NOW - 5)
    assert not listener().verify(station.heartbeat())
    assert listener().verify(Sender(255, 190, now=NOW + 1).heartbeat())
    assert not listener(kept={(9, 9, 9): NOW + 10}).verify(Sender(255, 190, now=NOW + 5).heartbeat())


def test_what_others_say_is_newer_than_what_they_said_over_any_link() -> None:
    signing = proven(Sender(), listener())
    assert signing.verify(Sender(255, 190, link_id=1, now=NOW + 20).heartbeat())
    assert not signing.verify(Sender(255, 190, link_id=2, now=NOW + 10).heartbeat())
    assert signing.verify(Sender(255, 190, link_id=2, now=NOW + 30).heartbeat())


def test_what_goes_by_our_own_name_is_new_or_our_own() -> None:
    signing = listener(NOW + 20 * SECOND)
    signing._began = signing._stamp = NOW
    assert not signing.verify(Sender(*OWN, now=NOW + SECOND).heartbeat())
    assert signing.verify(Sender(*OWN, now=NOW + 19 * SECOND).heartbeat())


def test_our_own_stamps_go_on_where_the_last_run_ended_whatever_the_clock_says() -> None:
    signing = listener(now=5, kept={(1, 191, 0): NOW})
    frame = signing.sign(bytes(px4.heartbeat(0).pack(mavlink.MAVLink(None, 1, 191))))
    assert int.from_bytes(frame[-12:-6], "little") == NOW + 1
    assert signing.stamps() == {(1, 191, 0): NOW + 1}


def test_the_last_stamp_there_is_does_no_harm() -> None:
    signing = proven(Sender(now=2**48 - 1), listener())
    signing.sign(bytes(px4.heartbeat(0).pack(mavlink.MAVLink(None, 1, 191))))
    assert max(signing.stamps().values()) == 2**48 - 1


# --- what is kept ---------------------------------------------------------------------------------------------------


def test_what_is_kept_is_found_again_and_is_this_user_s_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    path = stamps_file(KEY)
    assert path.is_relative_to(tmp_path)
    assert KEY.hex()[:8] not in path.name
    assert read_stamps(path) == ({}, None)
    stamps = {(1, 1, 0): NOW, (1, 191, 0): 2**48 - 1}
    assert write_stamps(path, stamps) is None
    assert write_stamps(path, stamps) is None
    assert read_stamps(path) == (stamps, None)
    assert (path.stat().st_mode & 0o777, path.parent.stat().st_mode & 0o777) == (0o600, 0o700)
    assert [entry.name for entry in path.parent.iterdir()] == [path.name]


@pytest.mark.parametrize(
    "content",
    [
        b"", b"{", b"[]", b'"x"', b"\xff\xfe", b'{"1/1/0": -1}', b'{"1/1/0": 1.5}', b'{"1/1/0": true}',
        b'{"1/1": 1}', b'{"1/1/256": 1}', b'{"1/1/0": 281474976710656}', b'{"1/1/0": 1' + b"0" * 5000 + b"}",
        b"[" * 100_000,
    ],
)  # fmt: skip
def test_a_damaged_file_is_one_line_and_nothing_of_it_is_believed(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "stamps.json"
    path.write_bytes(content)
    path.chmod(0o600)
    stamps, complaint = read_stamps(path)
    assert stamps == {}
    assert complaint is not None
    assert "damaged" in complaint
    assert "\n" not in complaint
    assert write_stamps(path, {(1, 1, 0): 5}) is None
    assert read_stamps(path) == ({(1, 1, 0): 5}, None)


def test_a_file_that_others_may_read_or_made_or_a_link_or_a_pipe_is_not_believed(tmp_path: Path) -> None:
    path = tmp_path / "stamps.json"
    assert write_stamps(path, {(1, 1, 0): 5}) is None
    (tmp_path / "link").symlink_to(path)
    os.mkfifo(tmp_path / "pipe", 0o600)
    path.chmod(0o644)
    for name in ("stamps.json", "link", "pipe"):
        stamps, complaint = read_stamps(tmp_path / name)
        assert (stamps, complaint is not None) == ({}, True), name


def test_a_folder_that_cannot_be_written_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    complaint = write_stamps(tmp_path / "file" / "stamps.json", {})
    assert complaint is not None
    assert "cannot be kept" in complaint
    assert "\n" not in complaint
