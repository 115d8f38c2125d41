"""A flight under hostile inputs: what they cost the tick, and that none of them does more than that.

    python benchmarks/hostile.py [--inputs N] [--json]

`companion run` flies for a scripted autopilot; a second process throws datagrams at it that come, as far as the kernel
can tell, from that autopilot: random bytes, mutated real frames, frames forged in the name of others, and with a
signing key replayed and forged signed ones. Quiet and hostile periods take turns, so that the machine's noise hits both
alike. Then the log is read: every set-point sent must be one that may be sent.
"""

from __future__ import annotations

import argparse
import contextlib
import itertools
import json
import math
import os
import random
import select
import statistics
import subprocess
import sys
import tempfile
import time
import tty
from pathlib import Path
from typing import Any, NamedTuple

from attacker import TLOG_STAMP_BYTES, Attacker, datagrams
from autopilot import BY_TIME, Autopilot, Timing
from harness.ports import free_port
from processes import Candidate
from pymavlink.dialects.v20 import development as mavlink

from companion.config.guards.declaration import Group
from companion.config.guards.rows import GUARDS, Reason
from companion.mavlink.codec import FrameParser, Layout
from companion.mavlink.px4 import Mode
from companion.mavlink.signing import Signing
from companion.record.reader import read_flight

HERE = Path(__file__).resolve().parent
KEY = bytes(range(1, 33))
KINDS = {"udp": 0.45, "signed": 0.5, "serial": 0.05}  # shares of the inputs
_READY_S = 120.0  # on a machine that does other things as well
_LINE_HZ = 60.0  # datagrams a second that 921600 baud carry beside the odometry
_RATE_HZ = 250.0
_PRIORITY = 40
_PERIOD_S = 0.5  # quiet and hostile take turns
_SETTINGS = (
    "tick.rate_hz=250", "tick.floor_hz=50", "mission.duration_s=100000", "steering.enabled=true",
    "steering.system_ids=[250]", "controller.anchor=setpoint", "controller.limits.speed_m_s=0.3",
    "guards.fence={enabled: true, radius_m: 5, lower_ned_m: [-5, -5, -5], upper_ned_m: [5, 5, 5]}",
    "guards.pose_age_s.limit=2",
    "guards.clock_jump_s.limit=1",
)  # fmt: skip
# The driver's vehicle obeys nobody, and on a busy machine it is late itself: neither is what is measured here.
_GUARDS_OFF = (
    *(guard.key for reason, guard in GUARDS.items() if reason.group is Group.FLIGHT and reason is not Reason.FENCE),
    "velocity_consistency_m", "link_jitter_s", "link_delay_s", "pose_rate_hz", "tick_overrun_s",
)  # fmt: skip


class Terminal:
    """One end of a pseudo-terminal, used like a socket: a frame at a time."""

    def __init__(self) -> None:
        self.fd, self._far = os.openpty()
        for fd in (self.fd, self._far):
            tty.setraw(fd)
        os.set_blocking(self.fd, False)
        self.name = os.ttyname(self._far)
        self._parser = FrameParser(stream=True)
        self._frames: list[bytes] = []

    def fileno(self) -> int:
        return self.fd

    def send(self, data: bytes) -> None:
        with contextlib.suppress(BlockingIOError):  # nobody reads: lost, as on a line
            os.write(self.fd, data)

    def recv(self, _size: int, _flags: int = 0) -> bytes:
        if not self._frames:
            self._frames = [frame.raw for frame in self._parser.feed(os.read(self.fd, 65536))]
        return self._frames.pop(0) if self._frames else b""

    def close(self) -> None:
        os.close(self.fd)
        os.close(self._far)


class Vehicle(Autopilot):
    """The scripted autopilot, on a socket or a terminal, signing where there is a key; keeps what it sent last."""

    def __init__(self, port: int, *, terminal: Terminal | None, signing: Signing | None) -> None:
        super().__init__(port)
        self._signing = signing
        self.sent: list[bytes] = []
        if terminal is not None:
            self._socket.close()
            self._socket = terminal  # type: ignore[assignment]

    def fileno(self) -> int:
        return self._socket.fileno()

    def _sample(self, rate_hz: float) -> bytes:
        return self._signed(super()._sample(rate_hz))

    def _put(self, frame: bytes) -> None:
        super()._put(frame if frame[2] else self._signed(frame))

    def _signed(self, frame: bytes) -> bytes:
        if self._signing is not None:
            frame = self._signing.sign(frame)
        self.sent = [*self.sent[-400:], frame]
        return frame


# --- what is thrown ---------------------------------------------------------------------------------------------------


class Thrower:
    """A process that makes the inputs and throws them from the vehicle's own socket, at times that it cannot know."""

    def __init__(self, vehicle: Vehicle, inputs: int, rate_hz: float, seed: int, genuine: Path) -> None:
        fd = vehicle.fileno()
        command = [sys.executable, str(Path(__file__)), "--throw", str(fd), str(genuine), "--inputs", str(inputs)]
        command += ["--rate", str(rate_hz), "--seed", str(seed)]
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, pass_fds=(fd,), text=True, bufsize=1
        )

    def answer(self, vehicle: Vehicle) -> int:
        """What it says next, the vehicle flying on meanwhile."""
        assert self._process.stdout is not None
        while not select.select([self._process.stdout], [], [], 0.0)[0]:
            vehicle.play(_RATE_HZ, 0.05)
        return int(self._process.stdout.readline())

    def throw(self, count: int) -> None:
        """So many datagrams; it answers when they are out."""
        assert self._process.stdin is not None
        self._process.stdin.write(f"{count}\n")

    def close(self) -> None:
        self._process.kill()
        self._process.communicate()


def throw(fd: int, genuine: Path, inputs: int, rate_hz: float, seed: int) -> None:
    """The thrower's own process."""
    frames = [frame.raw for frame in FrameParser().feed(genuine.read_bytes())]
    thrown = iter(made := datagrams(Attacker(seed, frames), inputs))
    print(len(made), flush=True)
    chosen = random.Random(seed)
    for line in sys.stdin:
        due_s = time.monotonic()
        for datagram in itertools.islice(thrown, int(line)):
            due_s += chosen.expovariate(rate_hz)
            time.sleep(max(0.0, due_s - time.monotonic()))
            with contextlib.suppress(BlockingIOError, ConnectionRefusedError):
                os.write(fd, datagram)
        print(0, flush=True)


# --- what became of it ------------------------------------------------------------------------------------------------


class Verdict(NamedTuple):
    """What the log says."""

    setpoints: int
    invalid: int  # not finite, no unit quaternion, thrust outside 0 to 1, or anything but what a companion sends
    reason: str
    traffic: str
    refused: int


_OURS = frozenset(
    {
        mavlink.MAVLINK_MSG_ID_HEARTBEAT, mavlink.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET,
        mavlink.MAVLINK_MSG_ID_COMMAND_LONG, mavlink.MAVLINK_MSG_ID_STATUSTEXT, mavlink.MAVLINK_MSG_ID_TIMESYNC,
        mavlink.MAVLINK_MSG_ID_NAMED_VALUE_FLOAT, mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_READ,
    }
)  # fmt: skip


def judge(folder: Path) -> Verdict:
    """Read a flight's folder."""
    data = (folder / "traffic.tlog").read_bytes()
    layout = Layout("SET_ATTITUDE_TARGET")
    setpoints = invalid = at = 0
    while (at := at + TLOG_STAMP_BYTES) < len(data):
        size = 12 + data[at + 1] + 13 * (data[at + 2] & 1)
        (frame,) = FrameParser().feed(data[at : at + size])
        at += size
        if (frame.system_id, frame.component_id) != (1, 191):
            continue
        if frame.message_id == layout.message_id:
            setpoints += 1
            values = layout.named(frame.payload)
            numbers = (*values["q"], values["thrust"], values["body_roll_rate"])
            length = math.sqrt(sum(q * q for q in values["q"]))
            good = all(map(math.isfinite, numbers)) and abs(length - 1.0) < 1e-3 and 0.0 <= values["thrust"] <= 1.0
            invalid += not (good and values["type_mask"] == 7)
        elif frame.message_id not in _OURS:
            invalid += 1
    events = read_flight(folder).events
    traffic = next((event.detail for event in events if event.name == "traffic"), "")
    refused = sum(event.name == "command_refused" for event in events)
    return Verdict(setpoints, invalid, events[-1].name, traffic, refused)


def settle(candidate: Candidate, vehicle: Vehicle) -> None:
    """Play until it is in control."""
    until_s = time.monotonic() + _READY_S
    while not candidate.is_ready():
        vehicle.play(_RATE_HZ, 0.1)
        if time.monotonic() > until_s:
            raise RuntimeError(f"not engaged within {_READY_S:g} s: {candidate.output().strip()}")
    vehicle.play(_RATE_HZ, 0.5)


def fly(
    folder: Path, inputs: int, rate_hz: float, *, signed: bool, serial: bool, realtime: bool, seed: int
) -> dict[str, Any]:
    """One flight under fire."""
    port, terminal = free_port(), Terminal() if serial else None
    rate_hz = min(rate_hz, _LINE_HZ) if serial else rate_hz
    url = f"serial://{terminal.name}:921600" if terminal else f"udpin://127.0.0.1:{port}"
    settings = [*_SETTINGS, *(f"guards.{name}.enabled=false" for name in _GUARDS_OFF)]
    if realtime:
        settings += [f"service.realtime_priority={_PRIORITY}", "service.lock_memory=true"]
    if signed:
        key = folder / "key"
        key.write_bytes(KEY)
        key.chmod(0o600)
        settings.append(f"link.signing_key_file={key}")
    config = HERE.parent / "config" / "paper_quadrotor.yaml"
    command = [sys.executable, "-m", "companion", "run", "--uncertified", str(config), "--link", url]
    command += ["--out", str(folder / "flights")] + [part for text in settings for part in ("--set", text)]
    candidate = Candidate(command, "engaged", folder / "output")
    vehicle = Vehicle(port, terminal=terminal, signing=Signing(KEY, link_id=1) if signed else None)
    quiet, hostile = Timing([], 0), Timing([], 0)
    attacker = None
    try:
        settle(candidate, vehicle)
        genuine = folder / "genuine"
        genuine.write_bytes(b"".join(vehicle.sent) if signed else b"")
        attacker = Thrower(vehicle, inputs, rate_hz, seed, genuine)
        left = thrown = attacker.answer(vehicle)
        while left > 0:
            for under_fire in (False, True):
                count = min(left, max(1, round(rate_hz * _PERIOD_S))) if under_fire else 0
                left -= count
                attacker.throw(count)
                if serial:
                    vehicle.play(_RATE_HZ, _PERIOD_S)
                else:
                    timing = vehicle.time(_RATE_HZ, _PERIOD_S, BY_TIME)
                    before = hostile if under_fire else quiet
                    after = Timing(before.latencies_us + timing.latencies_us, before.lost + timing.lost)
                    quiet, hostile = (quiet, after) if under_fire else (after, hostile)
                attacker.answer(vehicle)
        if candidate.process.poll() is not None:
            raise RuntimeError(f"it ended: {candidate.output().strip()}")
        vehicle.mode = Mode.HOLD
        vehicle.play(_RATE_HZ, 0.3)
        ended = candidate.ends(_READY_S)
    except ConnectionRefusedError:
        raise RuntimeError(f"it ended: {candidate.output().strip()}") from None
    finally:
        if attacker is not None:
            attacker.close()
        vehicle.close()
        candidate.kill()
    (flight,) = (folder / "flights").iterdir()
    row: dict[str, Any] = {
        "inputs": inputs, "datagrams": thrown,
        "ended_well": ended and candidate.process.returncode == 0, **judge(flight)._asdict(),
    }  # fmt: skip
    if not serial:
        for name, timing in (("quiet", quiet), ("hostile", hostile)):
            row[f"{name}_samples"], row[f"{name}_unanswered"] = len(timing.latencies_us), timing.lost
            row[f"{name}_median_us"] = round(statistics.median(timing.latencies_us), 1)
            row[f"{name}_p99_us"] = round(statistics.quantiles(timing.latencies_us, n=100)[98], 1)
        row["p99_ratio"] = round(row["hostile_p99_us"] / row["quiet_p99_us"], 2)
    ticks = read_flight(flight).ticks
    row["tick_p99_us"] = round(1e6 * float(sorted(ticks["latency_s"])[int(0.99 * len(ticks))]), 1)
    return row


def main() -> None:
    parser = argparse.ArgumentParser(description="A flight under hostile inputs.")
    parser.add_argument("--inputs", type=int, default=1_000_000, help="in all (default: a million)")
    parser.add_argument("--rate", type=float, default=600.0, help="hostile datagrams a second (default: 600)")
    parser.add_argument(
        "--realtime", action="store_true", help="driver and companion under SCHED_FIFO: the machine's other work waits"
    )
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", choices=list(KINDS), help="only this flight, with all the inputs")
    parser.add_argument("--throw", nargs=2, help=argparse.SUPPRESS)
    parser.add_argument("--json", action="store_true", help="one JSON object on stdout and nothing else")
    arguments = parser.parse_args()
    if arguments.throw is not None:
        fd, genuine = arguments.throw
        throw(int(fd), Path(genuine), arguments.inputs, arguments.rate, arguments.seed)
        return
    if arguments.realtime:
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(_PRIORITY))
    rows = []
    for kind, share in KINDS.items():
        if arguments.only not in (None, kind):
            continue
        inputs = arguments.inputs if arguments.only else round(arguments.inputs * share)
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            row = fly(
                folder,
                inputs,
                arguments.rate,
                signed=kind == "signed",
                serial=kind == "serial",
                realtime=arguments.realtime,
                seed=arguments.seed,
            )
        rows.append({"kind": kind, **row})
        if not arguments.json:
            print(json.dumps(rows[-1], indent=2))
    if arguments.json:
        print(json.dumps({"inputs": sum(row["inputs"] for row in rows), "flights": rows}))


if __name__ == "__main__":
    main()
