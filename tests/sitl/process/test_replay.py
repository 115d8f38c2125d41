"""Recordings of a real PX4 replayed at the flight process, in memory: what it must notice, follow and leave alone.

The recorded vehicle does not obey, so the guards on how it flies are off; those on what it says of itself are at their
defaults. Until the process is at stand-by the vehicle is said to be in Hold, then in the mode that was recorded.
"""

from __future__ import annotations

import contextlib
import math
import re
import struct
import time
from collections import deque
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from harness.fake_autopilot import FakeAutopilot
from harness.virtual_flight import RECEIVE_S
from harness.virtual_time import VirtualTime, virtual_time
from pymavlink.dialects.v20 import development as mavlink

from companion.config import load_config
from companion.config.guards.declaration import Group
from companion.config.guards.rows import GUARDS
from companion.control.attitude import thrust_direction
from companion.flight.authority.states import Reason, State
from companion.flight.host.runtime import Status, Summary
from companion.flight.process import FlightProcess
from companion.mavlink.codec import Layout
from companion.mavlink.px4 import Mode
from companion.record.folder import open_folder
from companion.record.reader import read_flight

HERE = Path(__file__).resolve().parents[1]
DATA = HERE.parent / "data"
ROOT = HERE.parents[1]
FULL = ROOT.parent / "shared" / "data"
CONFIG = ROOT / "config" / "px4_quadrotor.yaml"
ODOMETRY, HEARTBEAT, CURRENT_MODE = Layout("ODOMETRY"), Layout("HEARTBEAT"), Layout("CURRENT_MODE")
HOW_IT_FLIES = [guard.key for reason, guard in GUARDS.items() if reason.group is Group.FLIGHT]
SETTINGS = (
    "tick.rate_hz=25",
    "tick.floor_hz=20",
    "vehicle.hover_thrust_source=config",
    *(f"guards.{name}.enabled=false" for name in HOW_IT_FLIES),
)


class Sent(NamedTuple):
    """A set-point of the process, and the recorded time at which it was heard."""

    at_s: float
    sample_ms: int
    q_wxyz: tuple[float, ...]
    thrust: float


def frames(path: Path, begin_s: float, end_s: float) -> list[tuple[float, bytes]]:
    """(seconds since the full recording began, frame) of the vehicle's frames that the process listens to."""
    data, at, found = path.read_bytes(), 0, []
    origin_s = 24.0 if "replay" in path.name and "flight" in path.name else 10.5 if "replay" in path.name else 0.0
    first = None
    while at < len(data):
        (time_us,) = struct.unpack_from(">Q", data, at)
        end = at + 8 + 12 + data[at + 9]
        raw = data[at + 8 : end]
        at = end
        first = time_us if first is None else first
        at_s = origin_s + (time_us - first) * 1e-6
        number = int.from_bytes(raw[7:10], "little")
        if raw[5:7] == b"\x01\x01" and number in (0, 230, 331, 436) and begin_s <= at_s < end_s:
            found.append((at_s, raw))
    return found


class Vehicle(FakeAutopilot):
    """Plays a recording: in lockstep as fast as its ODOMETRY is answered, or in the time that was recorded.

    It is the link, too: while the process waits for bytes, the recording goes on. Implements
    `companion.mavlink.link.Link`.
    """

    stream = False
    name = "recording"

    def __init__(self, recording: list[tuple[float, bytes]], *, lockstep: bool, forced: bool = True) -> None:
        super().__init__()
        self.switches = False
        self.recording = recording
        self.lockstep = lockstep
        self.forced = forced  # the mode, until the process is at stand-by
        self.clock = VirtualTime()  # where it is not in lockstep
        self.process: FlightProcess | None = None
        self.state = State.CONNECTING
        self.states: list[tuple[float, State]] = []
        self.asked: list[Mode | int] = []
        self.sent: list[Sent] = []
        self.at_s = 0.0
        self._coming: deque[bytes] = deque()
        self._next = 0
        self._began_s: float | None = None
        self._unanswered_ms: int | None = None

    def on_status(self, status: Status) -> None:
        if status.state is not self.state:
            self.state = status.state
            self.states.append((self.at_s, status.state))

    # -- the link -----------------------------------------------------------------------------------------------------

    def receive(self) -> bytes:
        if self._coming:
            return self._coming.popleft()
        if not self.heard:
            return self._nothing()
        first_s = self.recording[0][0]
        if self._began_s is None:
            self._began_s = self.clock.now_s
            self.mode = int(Mode.HOLD) if self.forced else self._mode_at(first_s)
            self._coming.extend(self.pack(self.heartbeat()) for _ in range(3))
            # What was not recorded: that it is in the air, and that its thrust says so too.
            self._coming.append(self.pack(mavlink.MAVLink_extended_sys_state_message(0, 2)))
            level = [1.0, 0.0, 0.0, 0.0]
            self._coming.append(self.pack(mavlink.MAVLink_attitude_target_message(0, 0, level, 0.0, 0.0, 0.0, 0.49)))
        if self._next == len(self.recording):
            assert self.process is not None
            self.process.stop()
            return self._nothing()
        at_s, raw = self.recording[self._next]
        due_s = self._began_s + at_s - first_s
        if not self.lockstep and due_s > self.clock.now_s + RECEIVE_S:
            return self._nothing()
        assert self._unanswered_ms is None, "the process does not answer"
        self.clock.now_s = max(self.clock.now_s, due_s)
        self.at_s = at_s
        self._next += 1
        self._play(raw)
        return self._coming.popleft()

    def send(self, data: bytes) -> None:
        self.hear(data)
        self._coming.extend(map(self.pack, self.answers))
        self.answers.clear()

    def lock(self) -> None: ...

    def close(self) -> None: ...

    def _nothing(self) -> bytes:
        if self.lockstep:
            time.sleep(1e-3)  # before the first sample the process goes by the wall clock
        self.clock.now_s += RECEIVE_S
        return b""

    # -- the vehicle --------------------------------------------------------------------------------------------------

    def _mode_at(self, at_s: float) -> int:
        modes = [(t, CURRENT_MODE.unpack(raw[10:-2])) for t, raw in self.recording if raw[7:10] == b"\xb4\x01\x00"]
        return int(next((m[0] for t, m in reversed(modes) if t <= at_s), modes[0][1][0]))

    def _play(self, raw: bytes) -> None:
        number = int.from_bytes(raw[7:10], "little")
        holding = bool(self.asked) or (self.forced and self.state in (State.CONNECTING, State.CHECKING))
        if number == HEARTBEAT.message_id and holding:
            raw = self.pack(self.heartbeat())
        elif number == CURRENT_MODE.message_id and holding:
            raw = self.pack(self.current_mode())
        elif number == ODOMETRY.message_id and self.lockstep:
            self._unanswered_ms = ODOMETRY.unpack(raw[10:-2])[0] // 1000 & 0xFFFFFFFF
        self._coming.append(raw)

    def react(self, message: Any) -> None:
        super().react(message)
        if message.get_type() == "SET_ATTITUDE_TARGET":
            self.sent.append(Sent(self.at_s, message.time_boot_ms, tuple(message.q), message.thrust))
            if message.time_boot_ms == self._unanswered_ms:
                self._unanswered_ms = None
        elif message.get_type() == "COMMAND_LONG" and message.command == mavlink.MAV_CMD_DO_SET_MODE:
            self.asked.append(self.mode)
            self.answers.append(self.current_mode())


def replay(vehicle: Vehicle, folder: Path, *settings: str) -> Summary:
    config = load_config(CONFIG, (*SETTINGS, *settings))
    recorder = open_folder(folder / "flight", CONFIG, config, blocking=True, direct=True)
    with contextlib.nullcontext() if vehicle.lockstep else virtual_time(vehicle.clock):
        process = FlightProcess(config, vehicle, recorder, lockstep=vehicle.lockstep, on_status=vehicle.on_status)
        vehicle.process = process
        try:
            return process.run()
        finally:
            recorder.close()


def source(name: str, *, full: bool) -> Path:
    path = FULL / name if full else DATA / f"replay_{name}"
    if not path.exists():
        pytest.skip("the full recordings are not beside this checkout")
    return path


def positions(recording: list[tuple[float, bytes]]) -> Iterator[tuple[float, tuple[float, float, float]]]:
    for at_s, raw in recording:
        if int.from_bytes(raw[7:10], "little") == ODOMETRY.message_id:
            v = ODOMETRY.named(raw[10:-2])
            yield at_s, (v["x"], v["y"], v["z"])


both = pytest.mark.parametrize("full", [False, True], ids=["cut", "full rate"])


@both
@pytest.mark.parametrize(
    ("settings", "reason"),
    [((), Reason.POSITION_VARIANCE), (("guards.position_variance_m2.enabled=false",), Reason.ESTIMATOR_FLAGS)],
    ids=["by variance", "by flags"],
)
def test_gps_loss_ends_control_before_the_estimate_has_drifted_two_metres(
    full: bool, settings: tuple[str, ...], reason: Reason, tmp_path: Path
) -> None:
    recording = frames(source("px4_sih_gps_loss.tlog", full=full), 10.5, 23.0)
    vehicle = Vehicle(recording, lockstep=True)
    summary = replay(vehicle, tmp_path, *settings)
    assert (summary.reason, summary.engaged) == (reason, True)
    lost = next(place for at_s, place in positions(recording) if at_s >= 13.4)
    ended_s = next(at_s for at_s, state in reversed(vehicle.states) if state is State.ENGAGED)
    assert ended_s < 13.0
    released_s = vehicle.at_s
    assert 13.4 < released_s < 21.0
    released = next(place for at_s, place in positions(recording) if at_s >= released_s - 1e-6)
    assert math.dist(lost[:2], released[:2]) < 2.0
    assert vehicle.asked == [Mode.HOLD]


@both
def test_a_counted_reset_makes_no_attitude_step_and_the_slide_after_it_has_its_own_reason(
    full: bool, tmp_path: Path
) -> None:
    permissive = ("guards.estimator_jump_m.limit=3", "guards.position_variance_m2.enabled=false",
                  "guards.estimator_flags.enabled=false", "guards.estimate_settled_m.enabled=false")  # fmt: skip
    recording = frames(source("px4_sih_gps_loss.tlog", full=full), 22.4, 24.8)
    vehicle = Vehicle(recording, lockstep=True)
    summary = replay(vehicle, tmp_path, *permissive)
    assert (summary.reason, summary.engaged) == (Reason.VELOCITY_CONSISTENCY, True)
    assert 23.68 < vehicle.at_s < 24.0
    flight = read_flight(tmp_path / "flight")
    (reseated,) = [event.detail for event in flight.events if event.name == "reseated"]
    length_m = float(re.findall(r"[\d.]+(?= m)", reseated)[0])
    assert 1.3 < length_m < 1.7  # 1.37 m; from one thinned sample to the next the slide is in it already
    ticks = flight.ticks[flight.ticks["state"] == State.ENGAGED]
    moved = [math.dist(a, b) for a, b in zip(ticks["position_ned_m"], ticks["position_ned_m"][1:], strict=False)]
    reset = next(k for k, step in enumerate(moved) if step > 1.0)
    assert reset > 3
    before, after = (thrust_direction(*ticks["setpoint_q_wxyz"][k]) for k in (reset, reset + 1))
    assert math.degrees(math.dist(before, after)) < 1.0


def test_the_same_reset_ends_control_where_the_guards_do_not_permit_flying_on(tmp_path: Path) -> None:
    unaware = ("guards.position_variance_m2.enabled=false", "guards.estimator_flags.enabled=false",
               "guards.estimate_settled_m.enabled=false")  # fmt: skip
    recording = frames(source("px4_sih_gps_loss.tlog", full=False), 22.4, 24.8)
    vehicle = Vehicle(recording, lockstep=True)
    summary = replay(vehicle, tmp_path, *unaware)
    assert summary.reason is Reason.ESTIMATOR_JUMP
    assert "more than 0.5 m" in summary.detail
    assert vehicle.asked == [Mode.HOLD]


def test_the_failsafe_of_the_recording_ends_control_without_a_fight(tmp_path: Path) -> None:
    recording = frames(source("px4_sih_flight.tlog", full=False), 24.0, 29.0)
    vehicle = Vehicle(recording, lockstep=False)
    summary = replay(vehicle, tmp_path)
    assert (summary.reason, summary.engaged, summary.failsafe) == (Reason.MODE_CHANGED, True, True)
    assert "failsafe" in summary.detail
    assert "RETURN" in summary.detail
    assert vehicle.asked == []
    assert vehicle.sent[-1].at_s < 26.6  # the mode changed at 26.53


def test_come_up_in_a_failsafe_it_stays_silent_through_offboard_until_a_mode_is_chosen(tmp_path: Path) -> None:
    """26.5: the failsafe flies. 28.0: OFFBOARD by itself. 31.1: the operator chooses Hold."""
    recording = frames(source("px4_sih_flight.tlog", full=False), 26.54, 32.0)
    vehicle = Vehicle(recording, lockstep=False, forced=False)
    summary = replay(vehicle, tmp_path)
    assert (summary.reason, summary.engaged) == (Reason.OPERATOR, False)
    assert vehicle.asked == []
    standby_s = next(at_s for at_s, state in vehicle.states if state is State.STANDBY)
    assert standby_s < 30.0
    assert vehicle.sent, "free again, it offers its stream"
    assert vehicle.sent[0].at_s > 31.0
    assert any("hands off" in event.detail for event in read_flight(tmp_path / "flight").events)
