"""Who is believed on the link: one vehicle, once it has proved to be PX4's, and those who may steer."""

from __future__ import annotations

from typing import get_args, get_type_hints

import pytest
from harness.link_bench import (
    KEY,
    OFFBOARD,
    STEERING,
    Bench,
    Log,
    Wire,
    config,
    current_mode,
    heartbeat,
    packed,
    target,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import development as mavlink

from companion.control.types import AttitudeSetpoint, Odometry
from companion.flight.authority.states import State
from companion.flight.process import FlightProcess
from companion.flight.vehicle_link.messages import ROWS, Heartbeat, ModeReport
from companion.mavlink.codec import FrameParser
from companion.mavlink.signing import Signing
from companion.record.recorder import RECEIVED, SENT

# --- the vehicle ----------------------------------------------------------------------------------------------------


def test_nothing_is_believed_before_a_heartbeat_of_px4() -> None:
    bench = Bench()
    assert bench.hear(current_mode()) == []
    assert bench.hear(heartbeat(autopilot=8), current_mode()) == [0]
    assert (bench.link.connected, bench.link.mode, bench.wire.locked) == (False, 0, 0)
    assert bench.hear(heartbeat()) == [0]
    assert (bench.link.connected, bench.link.mode, bench.link.armed, bench.wire.locked) == (True, OFFBOARD, True, 1)
    assert bench.hear(current_mode(5, 7), heartbeat()) == [436, 0]
    assert bench.wire.locked == 1


def test_a_heartbeat_that_is_not_px4_s_changes_nothing_later_either() -> None:
    bench = Bench()
    bench.hear(heartbeat())
    reports = bench.link.mode_reports
    bench.hear(heartbeat(autopilot=8, mode=1 << 16))
    assert (bench.link.mode, bench.link.mode_reports) == (OFFBOARD, reports)


@pytest.mark.parametrize("sender", [{"system": 2}, {"component": 2}, {"system": 255, "component": 190}])
def test_others_are_counted_and_neither_believed_nor_recorded(sender: dict[str, int]) -> None:
    bench = Bench()
    assert bench.hear(heartbeat(**sender), heartbeat(**sender)) == []
    assert bench.link.foreign == 2
    assert (bench.link.connected, bench.wire.locked, bench.log.records) == (False, 0, [])
    assert "2 foreign" in bench.link.tally()


def test_the_mode_that_was_intended_is_known_where_it_is_told() -> None:
    bench = Bench()
    bench.hear(heartbeat())
    assert bench.link.intended_mode is None
    bench.hear(current_mode(5, 0))
    assert bench.link.intended_mode is None
    bench.hear(current_mode(5, OFFBOARD))
    assert (bench.link.mode, bench.link.intended_mode) == (5, OFFBOARD)


# --- steering -------------------------------------------------------------------------------------------------------


def test_commands_of_those_who_may_steer_wait_to_be_taken_away() -> None:
    bench = Bench(*STEERING)
    bench.hear(target())
    assert bench.steered() == []  # nobody has proved to be the autopilot yet
    bench.hear(heartbeat(), target())
    bench.hear(target(x=2.0))
    assert bench.steered() == [2.0]  # the first came in the datagram that proved it
    for n in range(50):
        bench.hear(target(x=float(n)))
    assert bench.steered() == [46.0, 47.0, 48.0, 49.0]
    assert bench.steered() == []


def test_nobody_else_steers() -> None:
    bench = Bench(*STEERING)
    bench.hear(heartbeat())
    before = bench.link.foreign
    bench.hear(target(system=254), target(component=1), target(component=0), heartbeat(system=255))
    assert (bench.steered(), bench.link.foreign - before) == ([], 4)


def test_nobody_steers_by_default() -> None:
    bench = Bench("steering.system_ids=[255]")
    bench.hear(heartbeat())
    bench.hear(target())
    assert (bench.steered(), bench.link.foreign) == ([], 1)


# --- rivals ---------------------------------------------------------------------------------------------------------


def stream(sender: tuple[int, int], system: int = 1, component: int = 1) -> bytes:
    message = mavlink.MAVLink_set_attitude_target_message(0, system, component, 7, [1, 0, 0, 0], 0, 0, 0, 0.5)
    return packed(message, *sender)


@pytest.mark.parametrize(
    ("frame", "expected"),
    [
        (heartbeat(system=1, component=191), "another companion is 1/191 too"),
        (stream((1, 191), 7, 1), "1/191 streams to the vehicle"),
        (stream((255, 190)), "255/190 streams to the vehicle"),
        (stream((1, 195), 1, 0), "1/195 streams to the vehicle"),
        (stream((255, 190), 2, 1), None),  # another vehicle's
        (heartbeat(system=255, component=190), None),
        (heartbeat(system=1, component=195), None),
    ],
)
def test_somebody_else_who_flies_the_vehicle_is_recognised(frame: bytes, expected: str | None) -> None:
    bench = Bench()
    bench.hear(frame)
    assert bench.link.rival() is None  # nobody has proved to be the autopilot yet
    bench.hear(heartbeat())
    assert bench.hear(frame) == []
    assert bench.link.rival() == expected


# --- the key --------------------------------------------------------------------------------------------------------


def test_with_a_key_only_what_it_signed_is_believed_and_only_once(key_file: str) -> None:
    bench, vehicle, forger = Bench(key_file), Signing(KEY), Signing(bytes(31) + b"\x01")
    assert bench.hear(heartbeat(), forger.sign(heartbeat())) == []
    assert (bench.link.connected, bench.wire.locked) == (False, 0)
    bench.prove(vehicle)
    signed = vehicle.sign(heartbeat())
    assert bench.hear(signed, vehicle.sign(current_mode())) == [0, 436]
    assert bench.hear(signed, vehicle.sign(current_mode()), heartbeat()) == [436]
    assert bench.link.tally().endswith("2 unsigned, 1 bad_signature, 1 replayed, 1 unproven")


def test_a_person_who_waits_is_told_what_was_heard_instead(key_file: str) -> None:
    bench = Bench(key_file)
    assert bench.link.no_vehicle(2.0).endswith("check the link and vehicle.system_id; nothing was heard")
    bench.hear(heartbeat(system=7))
    assert bench.link.no_vehicle(2.0).endswith("Then set vehicle.system_id to 7")
    bench.hear(heartbeat(), Signing(bytes(31) + b"\x01").sign(heartbeat()))
    assert bench.link.no_vehicle(2.0).endswith(
        "2 frames in its name were not signed by link.signing_key_file, or are old"
    )


def test_another_s_frame_goes_out_as_it_is_but_for_the_signature(key_file: str) -> None:
    frame = heartbeat(component=142)
    plain, keyed = Bench(), Bench(key_file)
    plain.link.forward(frame)
    keyed.link.forward(frame)
    assert plain.wire.sent == [frame]
    (signed,) = FrameParser().feed(keyed.wire.sent[0])
    assert (signed.component_id, signed.sequence, signed.payload) == (142, 0, FrameParser().feed(frame)[0].payload)
    assert Signing(KEY).verify(signed)


def test_with_a_key_everything_is_signed(key_file: str) -> None:
    bench, vehicle = Bench(key_file), Signing(KEY)
    bench.link.send_heartbeat(State.STANDBY)
    bench.link.send_setpoint(5, AttitudeSetpoint(1.0, 0.0, 0.0, 0.0, 0.5))
    frames = [FrameParser().feed(data)[0] for data in bench.wire.sent]
    assert [frame.message_id for frame in frames] == [0, 82]
    assert all(vehicle.verify(frame) for frame in frames)
    assert bench.log.records == [(SENT, data) for data in bench.wire.sent]


def test_with_a_key_a_rival_must_have_it_too(key_file: str) -> None:
    bench, vehicle, twin = Bench(key_file), Signing(KEY), Signing(KEY, link_id=3)
    bench.prove(vehicle)
    bench.hear(heartbeat(system=1, component=191))
    assert bench.link.rival() is None
    bench.hear(twin.sign(heartbeat(system=1, component=191)))
    assert bench.link.rival() is not None


def test_with_a_key_steering_must_be_signed_too(key_file: str) -> None:
    bench, vehicle, station = Bench(key_file, *STEERING), Signing(KEY), Signing(KEY, link_id=3)
    bench.prove(vehicle)
    signed = station.sign(target())
    bench.hear(target(), signed, signed)
    assert bench.steered() == [1.0]
    assert [data for kind, data in bench.log.records if kind == RECEIVED][-1] == signed


# --- hostile --------------------------------------------------------------------------------------------------------

forged = st.builds(
    lambda make, system, component: make(system=system, component=component),
    st.sampled_from([heartbeat, target]),
    st.integers(1, 255),
    st.integers(1, 255),
)
real = st.sampled_from([heartbeat(), current_mode(), target(system=1, component=1)])
mutated = st.builds(
    lambda frame, bit: bytes(b ^ (1 << bit % 8 if n == bit // 8 else 0) for n, b in enumerate(frame)),
    real,
    st.integers(0, 8 * 21 - 1),
)


@settings(max_examples=200)
@given(st.lists(st.one_of(st.binary(max_size=80), forged, mutated, real), max_size=12), st.booleans())
def test_only_whole_frames_of_the_vehicle_ever_come_out(pieces: list[bytes], connected: bool) -> None:
    bench = Bench(*STEERING)
    if connected:
        bench.hear(heartbeat())
    known = {heartbeat(), current_mode(), target(system=1, component=1)}
    bench.hear(*pieces)
    for frame in bench.link.heard:
        assert (frame.system_id, frame.component_id) == (1, 1)
        assert frame.raw in known
        assert connected or frame.message_id == 0


def test_whatever_the_link_tells_has_somebody_who_takes_it() -> None:
    """A record that nobody handles would end a flight with internal_error: every row's is among the handlers."""
    process = FlightProcess(config(), Wire(), Log())  # type: ignore[arg-type]
    told = {get_type_hints(row.decode)["return"] for row in ROWS}
    records = {part for hint in told for part in (get_args(hint) or (hint,)) if part is not type(None)}
    assert records | {Odometry, Heartbeat, ModeReport} == set(process._handlers)
