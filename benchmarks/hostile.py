"""A flight under hostile inputs: what they cost the tick, and that none of them does more than that.

    python benchmarks/hostile.py [--inputs N] [--json]

`companion run` flies for a scripted autopilot; a second process throws datagrams at it that come, as far as the kernel
can tell, from that autopilot: random bytes, mutated real frames, frames forged in the name of others, and with a
signing key replayed and forged signed ones. Other flights begin under the recording of a flight before, or get all they
send sent back, or are flooded as fast as the machine can. Quiet and hostile periods take turns, so that the machine's
noise hits both alike. Then the log is read: every set-point sent must be one that may be sent.
"""

from __future__ import annotations

import argparse
import contextlib
import itertools
import json
import math
import os
import socket
import statistics
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, NamedTuple

from attacker import FLOODS, TLOG_STAMP_BYTES
from autopilot import BY_TIME, Timing
from harness.ports import free_port
from hostile_vehicle import KEY, Terminal, Vehicle
from processes import Candidate
from pymavlink.dialects.v20 import development as mavlink
from thrower import Thrower

from companion.config.guards.declaration import Group
from companion.config.guards.rows import GUARDS, Reason
from companion.mavlink.codec import FrameParser, Layout
from companion.mavlink.px4 import Mode
from companion.mavlink.signing import Signing
from companion.record.reader import read_flight

HERE = Path(__file__).resolve().parent


class Kind(NamedTuple):
    """A flight: its share of the inputs, what is thrown (several in turns), and over what."""

    share: float
    attacks: tuple[str, ...]
    signed: bool = False
    serial: bool = False


REFLECTION = "reflection"
KINDS = {
    "udp": Kind(0.3, ("mixed",)),
    "signed": Kind(0.3, ("mixed",), signed=True),
    "serial": Kind(0.04, ("line",), serial=True),
    "replay": Kind(0.04, ("replay",), signed=True),
    "reflection": Kind(0.01, (REFLECTION,)),
    "reflection_signed": Kind(0.01, (REFLECTION,), signed=True),
    "flood": Kind(0.2, ("foreign", "steering")),
    "flood_signed": Kind(0.1, ("bad_signatures", "foreign"), signed=True),
}
_READY_S = 120.0  # on a machine that does other things as well
_LINE_HZ = 60.0  # datagrams a second that 921600 baud carry beside the odometry
_RATE_HZ = 250.0
_PRIORITY = 40
_RECORDING_S = 3.0
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


class Fire:
    """What is thrown in a flight. Attributes: `thrown` datagrams, `left` whether there are more."""

    def __init__(self, kind: Kind, vehicle: Vehicle, inputs: int, rate_hz: float, seed: int, genuine: Path) -> None:
        self._vehicle, self._inputs = vehicle, inputs
        self._rates = [
            FLOODS.get(attack, min(rate_hz, _LINE_HZ) if kind.serial else rate_hz) for attack in kind.attacks
        ]
        self._began = vehicle.reflected
        self._throwers = [
            Thrower(vehicle, attack, inputs // len(kind.attacks), seed, genuine)
            for attack in kind.attacks
            if attack != REFLECTION
        ]
        self.thrown = sum(thrower.left for thrower in self._throwers) or inputs
        self._turn = 0

    @property
    def left(self) -> bool:
        if not self._throwers:
            return self._vehicle.reflected - self._began < self._inputs
        return any(thrower.left for thrower in self._throwers)

    def throw(self, *, under_fire: bool) -> None:
        """For a period, or nothing."""
        if not self._throwers:
            self._vehicle.reflects = under_fire
        elif under_fire:
            at = self._turn % len(self._throwers)
            self._throwers[at].throw(self._rates[at], _PERIOD_S)

    def wait(self, *, under_fire: bool) -> None:
        """Until all of it is out."""
        if self._throwers and under_fire:
            self._throwers[self._turn % len(self._throwers)].answer(self._vehicle)
            self._turn += 1

    def close(self) -> None:
        for thrower in self._throwers:
            thrower.close()


def play_recording(recording: list[bytes], port: int, seconds: float) -> None:
    """From a port of somebody else, to whoever has just started."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.connect(("127.0.0.1", port))
        until_s = time.monotonic() + seconds
        for frame in itertools.cycle(recording):
            with contextlib.suppress(ConnectionRefusedError):
                other.send(frame)
            time.sleep(0.001)
            if time.monotonic() > until_s:
                return


def fly(folder: Path, kind: Kind, inputs: int, rate_hz: float, *, realtime: bool, seed: int) -> dict[str, Any]:
    """One flight under fire."""
    signed, serial = kind.signed, kind.serial
    port, terminal = free_port(), Terminal() if serial else None
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
    fire, genuine = None, folder / "genuine"
    vehicle.reflects = REFLECTION in kind.attacks
    try:
        recording = vehicle.recording(500) if "replay" in kind.attacks else []
        if recording:
            play_recording(recording, port, _RECORDING_S)
            if "checking" in (said := candidate.output()):
                raise RuntimeError(f"it believed a recording: {said.strip()}")
        settle(candidate, vehicle)
        genuine.write_bytes(b"".join(recording or vehicle.sent) if signed else b"")
        fire = Fire(kind, vehicle, inputs, rate_hz, seed, genuine)
        thrown = fire.thrown
        while fire.left:
            for under_fire in (False, True):
                fire.throw(under_fire=under_fire)
                if serial:
                    vehicle.play(_RATE_HZ, _PERIOD_S)
                else:
                    timing = vehicle.time(_RATE_HZ, _PERIOD_S, BY_TIME)
                    before = hostile if under_fire else quiet
                    after = Timing(before.latencies_us + timing.latencies_us, before.lost + timing.lost)
                    quiet, hostile = (quiet, after) if under_fire else (after, hostile)
                fire.wait(under_fire=under_fire)
        if candidate.process.poll() is not None:
            raise RuntimeError(f"it ended: {candidate.output().strip()}")
        vehicle.mode = Mode.HOLD
        vehicle.play(_RATE_HZ, 0.3)
        ended = candidate.ends(_READY_S)
    except ConnectionRefusedError:
        raise RuntimeError(f"it ended: {candidate.output().strip()}") from None
    finally:
        if fire is not None:
            fire.close()
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
    parser.add_argument("--json", action="store_true", help="one JSON object on stdout and nothing else")
    arguments = parser.parse_args()
    if arguments.realtime:
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(_PRIORITY))
    rows = []
    for name, kind in KINDS.items():
        if arguments.only not in (None, name):
            continue
        inputs = arguments.inputs if arguments.only else round(arguments.inputs * kind.share)
        with tempfile.TemporaryDirectory() as folder:
            os.environ["XDG_STATE_HOME"] = folder
            row = fly(Path(folder), kind, inputs, arguments.rate, realtime=arguments.realtime, seed=arguments.seed)
        rows.append({"kind": name, **row})
        if not arguments.json:
            print(json.dumps(rows[-1], indent=2))
    if arguments.json:
        print(json.dumps({"inputs": sum(row["inputs"] for row in rows), "flights": rows}))


if __name__ == "__main__":
    main()
