"""What is thrown at the link of a flight: recordings, our own frames, floods. The newest pose comes through."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest
from harness.link_bench import KEY, OFFBOARD, STEERING, Bench, Log, config, heartbeat, packed, target
from pymavlink.dialects.v20 import development as mavlink

from companion.control.types import AttitudeSetpoint, Odometry, PositionSetpoint
from companion.flight.authority.states import State
from companion.flight.host.clock import Clock
from companion.flight.steering import LiveCommands
from companion.flight.vehicle_link.link import VehicleLink
from companion.mavlink.freshness import TIMESYNC
from companion.mavlink.link import UdpLink, open_link
from companion.mavlink.signing import Signing

HOLD = 4 << 16 | 3 << 24


# --- recordings -----------------------------------------------------------------------------------------------------


def test_a_recording_of_seconds_before_does_not_become_the_vehicle(key_file: str) -> None:
    vehicle, first = Signing(KEY), Bench(key_file)
    first.prove(vehicle)
    recording = [vehicle.sign(heartbeat()) for _ in range(5)]
    assert first.hear(*recording) == [0] * 5
    again = Bench(key_file)
    assert again.hear(*recording, *recording) == []
    assert (again.link.connected, again.wire.locked, again.link.mode) == (False, 0, 0)
    assert "or are old" in again.link.no_vehicle(10.0)


def test_an_old_heartbeat_of_another_link_id_does_not_change_the_mode(key_file: str) -> None:
    bench, vehicle, other = Bench(key_file), Signing(KEY), Signing(KEY, link_id=4)
    recorded = other.sign(heartbeat(mode=HOLD))
    bench.prove(vehicle)
    assert bench.link.mode == OFFBOARD
    assert bench.hear(recorded) == []
    assert bench.link.mode == OFFBOARD
    assert bench.link.tally().endswith(f"{2} unproven")  # the heartbeat that was asked, and this one


def test_what_a_run_has_heard_is_old_to_the_next(
    key_file: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    bench, ahead = Bench(key_file), Signing(KEY, clock=lambda: 2**47)
    bench.prove(ahead)
    assert bench.link.close() is None
    again = Bench(key_file)
    assert again.link.remarks == []
    again.hear(Signing(KEY).sign(heartbeat()))
    answer = packed(mavlink.MAVLink_timesync_message(1, again.asked()))
    assert again.hear(Signing(KEY).sign(answer)) == []
    assert again.link._signing is not None
    assert not again.link._signing.proven  # whose clock fell back has not heard us
    again.hear(ahead.sign(answer))
    assert again.link._signing.proven


def test_a_damaged_file_of_stamps_is_said(key_file: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    bench = Bench(key_file)
    bench.prove(Signing(KEY))
    assert bench.link.close() is None
    (path,) = (tmp_path / "state" / "companion").iterdir()
    path.write_text("{")
    again = Bench(key_file)
    assert len(again.link.remarks) == 1
    assert "damaged" in again.link.remarks[0]


# --- reflection -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("keyed", [False, True], ids=["unsigned", "signed"])
def test_our_own_frames_sent_back_are_counted_and_are_no_rival(keyed: bool, key_file: str) -> None:
    bench = Bench(*([key_file] if keyed else []))
    if keyed:
        bench.prove(Signing(KEY))
    else:
        bench.hear(heartbeat())
    for n in range(300):
        bench.link.send_setpoint(n, AttitudeSetpoint(1.0, 0.0, 0.0, 0.0, 0.5))
        if n % 50 == 0:
            bench.link.send_heartbeat(State.STANDBY)
    sent = list(bench.wire.sent)
    assert bench.hear(*sent, *sent[::-1]) == []
    assert bench.link.rival() is None
    assert bench.link.echoed == 2 * len(sent)
    assert "a router loops" in bench.link.tally()


def test_a_twin_is_no_echo() -> None:
    bench, twin = Bench(), Bench()
    for one in (bench, twin):
        one.hear(heartbeat())
        one.link.send_setpoint(3, AttitudeSetpoint(1.0, 0.0, 0.0, 0.0, 0.5 if one is bench else 0.6))
    bench.hear(twin.wire.sent[-1])
    assert bench.link.echoed == 0
    assert bench.link.rival() == "1/191 streams to the vehicle"


# --- floods ---------------------------------------------------------------------------------------------------------


def pose(x: float, time_us: int) -> bytes:
    covariance = [0.01] * 21
    return packed(
        mavlink.MAVLink_odometry_message(
            time_us, 1, 1, x, 0, 0, [1, 0, 0, 0], 0, 0, 0, 0, 0, 0, covariance, covariance, 0
        )
    )


@pytest.fixture
def wire() -> Iterator[tuple[UdpLink, socket.socket]]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle:
        vehicle.bind(("127.0.0.1", 0))
        link = open_link(f"udpout://127.0.0.1:{vehicle.getsockname()[1]}")
        assert isinstance(link, UdpLink)
        link.send(b"hello")
        _, address = vehicle.recvfrom(100)
        vehicle.connect(address)
        yield link, vehicle
        link.close()


def test_behind_a_flood_the_newest_pose_comes_first(wire: tuple[UdpLink, socket.socket]) -> None:
    """From the vehicle's own address: a turn of the loop takes all that waits, and flies one pose of it."""
    udp, vehicle = wire
    link = VehicleLink(config(), udp, Log(), Clock())  # type: ignore[arg-type]
    vehicle.send(heartbeat())
    assert len(list(link.messages(link.receive()))) == 1
    junk = heartbeat(system=77)
    poses: list[float] = []
    turns = 0
    for n in range(10):
        for k in range(60):
            vehicle.send(junk if k % 20 else pose(float(100 * n + k), 1000 * (100 * n + k) + 1))
        vehicle.send(heartbeat())
        before = link.mode_reports
        while link.mode_reports == before:
            turns += 1
            poses += [message.x_m for message in link.messages(link.receive()) if isinstance(message, Odometry)]
    assert poses == sorted(poses)
    assert poses[-5:] == [540.0, 640.0, 740.0, 840.0, 940.0]  # the newest of each sixty alone
    assert turns < 200  # not one for each of 610 datagrams
    assert link.foreign == 10 * 57


def test_without_a_flood_every_pose_is_flown(wire: tuple[UdpLink, socket.socket]) -> None:
    udp, vehicle = wire
    link = VehicleLink(config(), udp, Log(), Clock())  # type: ignore[arg-type]
    for frame in (heartbeat(), *(pose(float(n), 1000 * n + 1) for n in range(20))):
        vehicle.send(frame)
    poses = [
        message.x_m for _ in range(21) for message in link.messages(link.receive()) if isinstance(message, Odometry)
    ]
    assert poses == [float(n) for n in range(20)]


def test_bad_signatures_do_not_overtake_the_vehicle_s_pose(key_file: str, wire: tuple[UdpLink, socket.socket]) -> None:
    udp, socket_ = wire
    link = VehicleLink(config(key_file), udp, Log(), Clock())  # type: ignore[arg-type]
    vehicle, forger = Signing(KEY), Signing(bytes(31) + b"\x07")
    socket_.send(vehicle.sign(heartbeat()))
    list(link.messages(link.receive()))
    nonce = TIMESYNC.named(socket_.recv(300)[10:26])["ts1"]
    for frame in (packed(mavlink.MAVLink_timesync_message(1, nonce)), heartbeat()):
        socket_.send(vehicle.sign(frame))
        list(link.messages(link.receive()))
    for _ in range(200):  # a datagram may come later than a receive waits for it
        if link.connected:
            break
        list(link.messages(link.receive()))
    assert link.connected
    seen: list[float] = []
    for n in range(10):
        socket_.send(vehicle.sign(pose(float(n), 1000 * n + 1)))
        for _ in range(100):
            socket_.send(forger.sign(pose(666.0, 1000 * n + 2)))
        while link._signing is not None and link._signing.bad_signature < 100 * (n + 1):
            seen += [message.x_m for message in link.messages(link.receive()) if isinstance(message, Odometry)]
    assert seen == [float(n) for n in range(10)]


def test_a_flood_of_steering_is_not_recorded_and_the_last_of_it_is_kept() -> None:
    bench = Bench(*STEERING)
    bench.hear(heartbeat())
    before = len(bench.log.records)
    for n in range(2000):
        bench.hear(target(x=float(n)))
    assert len(bench.log.records) == before
    assert bench.steered() == [1996.0, 1997.0, 1998.0, 1999.0]
    assert len(bench.log.records) == before + 4


def test_a_flood_of_steering_is_flown_fifty_times_a_second_and_ends_where_it_ended() -> None:
    bench = Bench(*STEERING)
    bench.hear(heartbeat())
    clock, steered = Clock(), []
    flight = SimpleNamespace(
        link=bench.link,
        clock=clock,
        state=State.ENGAGED,
        config=config(*STEERING),
        announce=lambda *_: None,
        pilot=SimpleNamespace(origin=PositionSetpoint(0.0, 0.0, 0.0, 0.0), steer=steered.append, stream=None),
    )
    live = LiveCommands(flight)  # type: ignore[arg-type]
    for n in range(1001):
        clock.now_s = 10.0 + 0.001 * n
        bench.hear(*(target(x=0.001 * n) for _ in range(4)))
        live.fly_newest()
    assert 4 * 45 <= len(steered) <= 4 * 51  # what waits is four at most
    clock.now_s += 0.02
    live.fly_newest()
    assert abs(steered[-1].x_m - 1.0) < 1e-6
