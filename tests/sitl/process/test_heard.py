"""Somebody is on the link, and it is not the vehicle: each is named as what it is, by every command, over a socket."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from harness.command import companion
from harness.fake_autopilot import HOLD
from harness.process_flight import AutopilotOnSocket
from harness.processes import RIG
from harness.virtual_flight import SLOW
from pymavlink.dialects.v10 import common as mavlink1
from pymavlink.dialects.v20 import development as mavlink

PATIENCE_S = {"run": 3.0, "vehicle": 1.0, "logs": 1.0}  # of `run` from its start on, which takes its time
Words = Callable[[bytes], list[bytes]]  # what is said to a datagram


@contextmanager
def speaking(words: Words) -> Iterator[int]:
    """Somebody on a port of this machine, which it yields: answers each datagram with `words`."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as own:
        own.bind(("127.0.0.1", 0))
        own.settimeout(0.05)
        over = threading.Event()

        def serve() -> None:
            while not over.is_set():
                try:
                    data, peer = own.recvfrom(2048)
                except TimeoutError:
                    continue
                for word in words(data):
                    own.sendto(word, peer)

        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        try:
            yield own.getsockname()[1]
        finally:
            over.set()
            thread.join()


def heartbeat(autopilot: int, system: int = 1, component: int = 1, kind: int = mavlink.MAV_TYPE_QUADROTOR) -> bytes:
    return bytes(
        mavlink.MAVLink_heartbeat_message(kind, autopilot, 81, HOLD, 4, 3).pack(
            mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
        )
    )


def heartbeat_v1(autopilot: int) -> bytes:
    sender = mavlink1.MAVLink(None, srcSystem=1, srcComponent=1)
    return bytes(mavlink1.MAVLink_heartbeat_message(2, autopilot, 81, HOLD, 4, 3).pack(sender))


PX4, ARDUPILOT = mavlink.MAV_AUTOPILOT_PX4, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
STATION = heartbeat(mavlink.MAV_AUTOPILOT_INVALID, 255, 190, mavlink.MAV_TYPE_GCS)
HEARD: dict[str, tuple[Words, str]] = {
    "ArduPilot": (lambda _: [heartbeat(ARDUPILOT)], "it is an ArduPilot, and this companion flies PX4 alone"),
    "MAVLink 1": (lambda _: [heartbeat_v1(PX4)], "it speaks MAVLink 1 only: set its MAV_PROTO_VER to 2"),
    "ArduPilot in MAVLink 1": (lambda _: [heartbeat_v1(ARDUPILOT)], "it is an ArduPilot"),
    "system 42": (
        lambda _: [STATION, heartbeat(PX4, 42)],
        "a PX4 is there as 42/1: is that it? Then set vehicle.system_id to 42",
    ),
    "echo": (lambda data: [data], "heard was our own frames, which a router sends back: check the link"),
    "ground station": (lambda _: [STATION], "heard was a ground station as 255/190: check the link"),
    "no MAVLink": (lambda _: [b"$GPGGA,1*00\r\n"], "bytes were heard that are no MAVLink: check the port"),
}
COMMANDS: dict[str, tuple[str, ...]] = {
    "run": ("--uncertified", "--out", "{folder}/flights"),
    "vehicle": (),
    "logs": ("--out", "{folder}/logs"),
}


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("who", HEARD)
def test_who_is_there_is_named_as_what_it_is(who: str, command: str, tmp_path: Path) -> None:
    words, told = HEARD[who]
    options = [option.format(folder=tmp_path) for option in COMMANDS[command]]
    patience_s = PATIENCE_S[command]
    with speaking(words) as port:
        url = f"udpout://127.0.0.1:{port}"
        ended = companion(command, RIG, "--link", url, "--set", f"link.connect_timeout_s={patience_s}", *options)
    (line,) = ended.stderr.strip().splitlines()[-1:]
    assert ended.returncode == 2, ended
    assert f"no heartbeat of vehicle 1/1 within {patience_s:g} s: " in line
    assert told in line


class BusyStation(AutopilotOnSocket):
    """Loses the first request to arm, while its own ground station's is accepted."""

    def react(self, message: Any) -> None:
        if message.get_type() == "COMMAND_LONG" and message.command == mavlink.MAV_CMD_COMPONENT_ARM_DISARM:
            if not self.commands(mavlink.MAV_CMD_COMPONENT_ARM_DISARM)[1:]:
                theirs = mavlink.MAVLink_command_ack_message(
                    message.command, mavlink.MAV_RESULT_ACCEPTED, 0, 0, target_system=255, target_component=190
                )
                self.answers.append(theirs)
                return
            self.armed = True
        super().react(message)


@pytest.mark.realtime
def test_an_answer_to_somebody_else_is_not_ours_and_ours_is_asked_for_again(tmp_path: Path) -> None:
    vehicle = BusyStation()
    vehicle.armed = vehicle.switches = False
    vehicle.start()
    settings = [part for setting in (*SLOW, "mission={duration_s: 1}") for part in ("--set", setting)]
    try:
        ended = companion(
            "run", RIG, "--link", f"udpout://127.0.0.1:{vehicle.port}", "--engage", "--uncertified",
            "--out", tmp_path, *settings,
        )  # fmt: skip
    finally:
        vehicle.close()
    asked = vehicle.commands(mavlink.MAV_CMD_COMPONENT_ARM_DISARM)
    assert len(asked) == 2, ended
    assert ended.returncode == 0, ended
