"""Who may steer a flight, and what a ground station and a supervisor are told of it."""

import re
import socket
import time
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import development as mavlink
from scripted_autopilot import Autopilot, flown, until

from companion.record.reader import read_flight

FENCED = (
    "--set", "steering.enabled=true", "--set", "steering.system_ids=[255]",
    "--set", "guards.fence={enabled: true, radius_m: 2, lower_ned_m: [-2, -2, -2], upper_ned_m: [2, 2, 2]}",
    "--set", "controller.anchor=setpoint", "--set", "controller.limits.speed_m_s=0.5",
    "--set", "guards.attitude_response_deg.enabled=false",  # the scripted vehicle does not move
)  # fmt: skip
POSITION_ALONE = 0xDF8


class Target(mavlink.MAVLink_set_position_target_local_ned_message):
    """A live command, as PX4 forwards it from a ground station."""

    def __init__(self, x: float, *, system: int = 255, mask: int = POSITION_ALONE) -> None:
        super().__init__(0, 1, 191, 1, mask, x, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0)
        self.sender = mavlink.MAVLink(None, system, 190)

    def pack(self, _: mavlink.MAVLink) -> bytes:
        return bytes(super().pack(self.sender))


def said(autopilot: Autopilot, kind: str) -> list[mavlink.MAVLink_message]:
    return [message for message in autopilot.heard if message.get_type() == kind]


def statuses(autopilot: Autopilot) -> list[int]:
    return [message.system_status for message in said(autopilot, "HEARTBEAT")]


def within(seconds: float, happened: object) -> bool:
    until_s = time.monotonic() + seconds
    while not happened():  # type: ignore[operator]
        if time.monotonic() > until_s:
            return False
        time.sleep(0.02)
    return True


def test_a_ground_station_that_may_steer_does_and_is_told_why_not(tmp_path: Path) -> None:
    with flown(tmp_path, *FENCED) as (autopilot, process):
        autopilot.start()
        until(process, "^engaged")
        autopilot.answers += [Target(0.1, system=254), Target(0.3)]
        time.sleep(1.0)
        autopilot.answers += [Target(2.5)]
        assert within(3.0, lambda: any("2.5 m away, fence 2 m" in m.text for m in said(autopilot, "STATUSTEXT")))
        time.sleep(1.1)
        autopilot.answers += [Target(0.2, mask=0)] * 20
        assert within(3.0, lambda: any("velocity must be" in m.text for m in said(autopilot, "STATUSTEXT")))
        time.sleep(0.3)
        autopilot.mode = 4 << 16 | 3 << 24
        until(process, "^released")
        process.wait(5.0)
    (folder,) = tmp_path.iterdir()
    flight = read_flight(folder)
    engaged = flight.ticks[flight.ticks["state"] == 3]
    assert set(engaged["target_ned_m"][:, 0].round(3)) == {0.0, 0.3}
    refused = [event.detail for event in flight.events if event.name == "command_refused"]
    assert refused == ["2.5 m away, fence 2 m", "velocity must be ignored"]


def test_without_leave_nobody_steers(tmp_path: Path) -> None:
    with flown(tmp_path) as (autopilot, process):
        autopilot.start()
        until(process, "^engaged")
        autopilot.answers += [Target(0.3)] * 5
        time.sleep(0.5)
        autopilot.mode = 4 << 16 | 3 << 24
        until(process, "^released")
        process.wait(5.0)
    (folder,) = tmp_path.iterdir()
    flight = read_flight(folder)
    assert set(flight.ticks[flight.ticks["state"] == 3]["target_ned_m"][:, 0]) == {0.0}
    (traffic,) = [event.detail for event in flight.events if event.name == "traffic"]
    assert re.search(r"\b5 foreign\b", traffic)


def test_a_ground_station_and_a_supervisor_are_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as supervisor:
        supervisor.bind(str(tmp_path / "notify"))
        supervisor.setblocking(False)
        told: list[str] = []

        def hear() -> list[str]:
            try:
                while True:
                    told.append(supervisor.recv(4096).decode())
            except BlockingIOError:
                return told

        monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
        monkeypatch.setenv("WATCHDOG_USEC", "1500000")
        service = ("--set", "service.realtime_priority=5", "--set", "service.lock_memory=true")
        with flown(tmp_path / "flights", *service) as (autopilot, process):
            assert "SCHED_FIFO 5" in until(process, "granted: SCHED_FIFO")
            assert "memory" in until(process, "granted: memory")
            autopilot.switches = False
            autopilot.start()
            until(process, "^standby")
            assert within(1.0, lambda: "READY=1" in hear())
            assert "STATUS=engaged" not in told
            assert within(2.0, lambda: mavlink.MAV_STATE_STANDBY in statuses(autopilot))
            autopilot.mode = 6 << 16
            until(process, "^engaged")
            time.sleep(2.0)
            fed = hear().count("WATCHDOG=1")
            assert fed >= 4
            assert "STATUS=engaged" in told
            assert mavlink.MAV_STATE_ACTIVE in statuses(autopilot)
            names = [m.name for m in said(autopilot, "NAMED_VALUE_FLOAT")]
            assert {"err_track", "w_pos_x", "hedge_x", "latency_ms"} <= set(names)
            assert 2 <= names.count("err_track") <= 10
            autopilot.mode = 4 << 16 | 3 << 24
            until(process, "^released")
            process.wait(5.0)
        assert "STOPPING=1" in hear()
        assert told.index("STATUS=connecting") < told.index("READY=1") < told.index("STOPPING=1")
        assert statuses(autopilot)[-1] == mavlink.MAV_STATE_POWEROFF
    (folder,) = (tmp_path / "flights").iterdir()
    assert len([event for event in read_flight(folder).events if event.name == "process"]) == 2


@pytest.mark.parametrize("other_key", [None, bytes(31) + b"\x07"], ids=["no key", "another key"])
def test_a_vehicle_that_does_not_sign_with_our_key_is_nobody(tmp_path: Path, other_key: bytes | None) -> None:
    key = tmp_path / "key"
    key.write_bytes(bytes(range(1, 33)))
    key.chmod(0o600)
    settings = ("--set", f"link.signing_key_file={key}", "--set", "link.connect_timeout_s=1.5")
    with flown(tmp_path / "flights", *settings) as (autopilot, process):
        if other_key is not None:
            autopilot.mav.signing.secret_key, autopilot.mav.signing.sign_outgoing = other_key, True
            autopilot.mav.signing.timestamp = 2**47
        autopilot.start()
        assert process.wait(10.0) == 2
        assert process.stderr is not None
        assert "frames in its name were not signed by link.signing_key_file" in process.stderr.read()
        assert not said(autopilot, "SET_ATTITUDE_TARGET")
        assert not said(autopilot, "COMMAND_LONG")
