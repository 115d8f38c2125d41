"""Who may steer a flight, and what a ground station and a supervisor are told of it."""

import re
import socket
from pathlib import Path

import pytest
from harness.fake_autopilot import HOLD, OFFBOARD, FakeAutopilot
from harness.process_flight import run_against
from harness.processes import PATIENT, end_of, eventually, line_with
from harness.virtual_flight import flown
from pymavlink.dialects.v20 import development as mavlink

from companion.record.reader import read_flight

FENCED = (
    "steering.enabled=true", "steering.system_ids=[255]",
    "guards.fence={enabled: true, radius_m: 2, lower_ned_m: [-2, -2, -2], upper_ned_m: [2, 2, 2]}",
    "controller.anchor=setpoint", "controller.limits.speed_m_s=0.5",
    "guards.attitude_response_deg.enabled=false",  # the scripted vehicle does not move
    "guards.estimate_stuck_s.enabled=false",
)  # fmt: skip
POSITION_ALONE = 0xDF8


class Target(mavlink.MAVLink_set_position_target_local_ned_message):
    """A live command, as PX4 forwards it from a ground station."""

    def __init__(self, x: float, *, system: int = 255, mask: int = POSITION_ALONE) -> None:
        super().__init__(0, 1, 191, 1, mask, x, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0)
        self.sender = mavlink.MAVLink(None, system, 190)

    def pack(self, _: mavlink.MAVLink) -> bytes:
        return bytes(super().pack(self.sender))


def told(autopilot: FakeAutopilot, text: str) -> bool:
    return any(text in message.text for message in autopilot.of_kind("STATUSTEXT"))


def test_a_ground_station_that_may_steer_does_and_is_told_why_not(tmp_path: Path) -> None:
    with flown(tmp_path, *FENCED) as flight:
        autopilot = flight.autopilot
        flight.until("^engaged")
        autopilot.answers += [Target(0.1, system=254), Target(0.3)]
        flight.fly_on(1.0)
        autopilot.answers += [Target(2.5)]
        assert flight.until_heard(
            lambda: any("2.5 m away, fence 2 m" in m.text for m in autopilot.of_kind("STATUSTEXT")), 3.0
        )
        flight.fly_on(1.1)
        autopilot.answers += [Target(0.2, mask=0)] * 20
        assert flight.until_heard(
            lambda: any("yaw rate must be" in m.text for m in autopilot.of_kind("STATUSTEXT")), 3.0
        )
        flight.fly_on(0.3)
        autopilot.mode = HOLD
        flight.until("^released")
        flight.exit_code(5.0)
    record = read_flight(flight.folder)
    engaged = record.ticks[record.ticks["state"] == 3]
    assert set(engaged["target_ned_m"][:, 0].round(3)) == {0.0, 0.3}
    refused = [event.detail for event in record.events if event.name == "command_refused"]
    assert refused == ["2.5 m away, fence 2 m", "yaw rate must be ignored"]


def test_without_leave_nobody_steers(tmp_path: Path) -> None:
    with flown(tmp_path) as flight:
        autopilot = flight.autopilot
        flight.until("^engaged")
        autopilot.answers += [Target(0.3)] * 5
        flight.fly_on(0.5)
        autopilot.mode = HOLD
        flight.until("^released")
        flight.exit_code(5.0)
    record = read_flight(flight.folder)
    assert set(record.ticks[record.ticks["state"] == 3]["target_ned_m"][:, 0]) == {0.0}
    (traffic,) = [event.detail for event in record.events if event.name == "traffic"]
    assert re.search(r"\b5 foreign\b", traffic)


@pytest.mark.realtime
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
        with run_against(tmp_path / "flights", *service, *PATIENT) as (autopilot, process):
            assert "SCHED_FIFO 5" in line_with(process, "granted: SCHED_FIFO")
            assert "memory" in line_with(process, "granted: memory")
            autopilot.switches = False
            autopilot.start()
            line_with(process, "^standby")
            assert eventually(lambda: "READY=1" in hear())
            assert "STATUS=engaged" not in told
            assert eventually(lambda: mavlink.MAV_STATE_STANDBY in autopilot.statuses())
            autopilot.mode = OFFBOARD
            line_with(process, "^engaged")
            assert eventually(lambda: hear().count("WATCHDOG=1") >= 4)
            assert "STATUS=engaged" in told
            assert eventually(lambda: mavlink.MAV_STATE_ACTIVE in autopilot.statuses())
            autopilot.mode = HOLD
            line_with(process, "^released")
            end_of(process)
        assert "STOPPING=1" in hear()
        assert told.index("STATUS=connecting") < told.index("READY=1") < told.index("STOPPING=1")
        assert autopilot.of_kind("HEARTBEAT")[-1].system_status == mavlink.MAV_STATE_POWEROFF
    (folder,) = (tmp_path / "flights").iterdir()
    assert len([event for event in read_flight(folder).events if event.name == "process"]) == 2


def test_a_ground_station_is_told_how_it_flies_now_and_then(tmp_path: Path) -> None:
    with flown(tmp_path) as flight:
        flight.until("^engaged")
        flight.fly_on(2.0)
        names = [message.name for message in flight.autopilot.of_kind("NAMED_VALUE_FLOAT")]
    assert {"err_track", "w_pos_x", "hedge_x", "latency_ms"} <= set(names)
    assert 2 <= names.count("err_track") <= 10


@pytest.mark.parametrize("other_key", [None, bytes(31) + b"\x07"], ids=["no key", "another key"])
def test_a_vehicle_that_does_not_sign_with_our_key_is_nobody(tmp_path: Path, other_key: bytes | None) -> None:
    key = tmp_path / "key"
    key.write_bytes(bytes(range(1, 33)))
    key.chmod(0o600)
    settings = (f"link.signing_key_file={key}", "link.connect_timeout_s=1.5")
    with flown(tmp_path, *settings) as flight:
        autopilot = flight.autopilot
        if other_key is not None:
            autopilot.mav.signing.secret_key, autopilot.mav.signing.sign_outgoing = other_key, True
            autopilot.mav.signing.timestamp = 2**47
        assert flight.exit_code(10.0) == 2
        assert "frames in its name were not signed by link.signing_key_file" in flight.complaint
        assert not autopilot.of_kind("SET_ATTITUDE_TARGET")
        assert not autopilot.of_kind("COMMAND_LONG")
