"""The plant met by a client that speaks plain pymavlink: its wires on real ones, all else in simulated time."""

from __future__ import annotations

import math
import os
import socket
import struct
import time
from contextlib import closing
from typing import Final

import pytest
from harness.plant_client import HOVER, NAN, Client, UdpClient, clients
from harness.processes import PATIENCE_S
from harness.running_plant import RunningPlant, autopilot, quadrotor, rig
from pymavlink.dialects.v20 import development as mavlink

from sitl.autopilot.modes import FlightMode, custom_mode
from sitl.messages.streams import Profile, default_intervals_us
from sitl.wire.lockstep import LockstepTimeoutError
from sitl.wire.ports import SerialEndpoint, UdpEndpoint, parse_serial
from sitl.wire.server import StopReason

ODOMETRY: Final = mavlink.MAVLINK_MSG_ID_ODOMETRY


@pytest.fixture
def client() -> Client:
    """Of a plant in simulated time."""
    quick = {"COM_SPOOLUP_TIME": 0.1, "MPC_TKO_RAMP_T": 0.2, "NAV_MC_ALT_RAD": 0.5, "MIS_TAKEOFF_ALT": 1.0}
    (companion,) = clients(autopilot(quadrotor(), **quick), (Profile.ONBOARD, 191))
    companion.heartbeat()
    companion.wait("ATTITUDE")
    return companion


def fly(client: Client) -> None:
    """Arm, take off, reach Hold."""
    client.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 436, 20_000)
    client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    assert client.acknowledged(mavlink.MAV_CMD_COMPONENT_ARM_DISARM) == 0
    client.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, NAN, NAN, NAN, NAN)
    assert client.acknowledged(mavlink.MAV_CMD_NAV_TAKEOFF) == 0
    client.until_mode(FlightMode.TAKEOFF)
    client.until_mode(FlightMode.HOLD)


def to_offboard(client: Client) -> None:
    for _ in range(5):
        client.setpoint()
    client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 6)
    client.until_mode(FlightMode.OFFBOARD)


# --- the wire -------------------------------------------------------------------------------------------------------


@pytest.mark.realtime
def test_heartbeats_go_to_the_remote_port_until_somebody_is_heard() -> None:
    with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as listener:
        listener.bind(("127.0.0.1", 0))
        listener.settimeout(3.0)
        remote = listener.getsockname()[1]
        with RunningPlant(autopilot(quadrotor()), endpoints=[UdpEndpoint(0, remote)]) as running:
            message = mavlink.MAVLink(None).parse_buffer(listener.recv(2048))[0]
            assert message.get_type() == "HEARTBEAT"
            assert (message.get_srcSystem(), message.get_srcComponent()) == (1, 1)
            assert (message.type, message.autopilot, message.base_mode) == (2, mavlink.MAV_AUTOPILOT_PX4, 29)
            assert (message.custom_mode, message.system_status) == (custom_mode(FlightMode.HOLD), 3)
            with closing(UdpClient(running.port)) as first, closing(UdpClient(running.port, 192)) as second:
                first.heartbeat()
                first.wait("ODOMETRY")
                second.heartbeat()
                assert second.collect(0.3) == [], "locked on the first"
            listener.settimeout(1.2)
            with pytest.raises(TimeoutError):
                listener.recv(2048)


def test_a_busy_port_is_named() -> None:
    with (
        RunningPlant(autopilot(quadrotor())) as plant,
        pytest.raises(OSError, match=f"UDP port {plant.port} is busy"),
    ):
        RunningPlant(autopilot(quadrotor()), endpoints=[UdpEndpoint(plant.port)]).__enter__()
    assert plant.result is not None
    assert plant.result.reason is StopReason.REQUESTED


@pytest.mark.realtime
def test_in_real_time_simulated_time_is_the_wall_clock_s() -> None:
    with RunningPlant(autopilot(quadrotor())) as running, closing(UdpClient(running.port)) as client:
        client.heartbeat()
        began_s, first = time.monotonic(), client.wait("ODOMETRY")
        client.collect(1.0)
        last, ended_s = client.wait("ODOMETRY"), time.monotonic()
    simulated_s = 1e-6 * (last.time_usec - first.time_usec)
    assert simulated_s < ended_s - began_s + 0.05
    assert running.result is not None
    assert simulated_s > 0.9 or running.result.stalls, "only a machine too slow lets it slip"


def test_an_absent_device_is_named() -> None:
    with pytest.raises(OSError, match="serial device /dev/nothing cannot be opened"):
        RunningPlant(autopilot(quadrotor()), endpoints=[SerialEndpoint("/dev/nothing")]).__enter__()


def test_serial_url() -> None:
    assert parse_serial("serial:///dev/ttyUSB0:921600") == SerialEndpoint("/dev/ttyUSB0", 921600)
    for bad in ("serial:///dev/ttyUSB0", "udp://:14540", "serial://ttyUSB0:9600"):
        with pytest.raises(ValueError, match="not a serial link"):
            parse_serial(bad)


@pytest.mark.realtime
def test_serial_line() -> None:
    ours, theirs = os.openpty()
    name = os.ttyname(theirs)
    with RunningPlant(autopilot(rig()), endpoints=[SerialEndpoint(name)]):
        parser = mavlink.MAVLink(None, srcSystem=1, srcComponent=191)
        parser.robust_parsing = True
        command = mavlink.MAVLink_command_long_message(1, 1, 512, 0, 148, 0, 0, 0, 0, 0, 0).pack(parser)
        os.write(ours, command[:7])  # frames may come in pieces
        time.sleep(0.05)
        os.write(ours, command[7:])
        names: list[str] = []
        deadline = time.monotonic() + PATIENCE_S
        while "COMMAND_ACK" not in names and time.monotonic() < deadline:
            names += [m.get_type() for m in parser.parse_buffer(os.read(ours, 4096)) or []]
    os.close(ours)
    os.close(theirs)
    assert "AUTOPILOT_VERSION" in names
    assert "COMMAND_ACK" in names


def test_default_rates_and_set_message_interval(client: Client) -> None:
    def rates(seconds: float) -> dict[str, float]:
        found = [m.get_type() for m in client.collect(seconds)]
        return {name: found.count(name) / seconds for name in set(found)}

    default = rates(2.0)
    assert default["ODOMETRY"] == pytest.approx(30, rel=0.1)
    assert default["ATTITUDE_QUATERNION"] == pytest.approx(50, rel=0.1)
    assert default["LOCAL_POSITION_NED"] == pytest.approx(30, rel=0.1)
    assert default["ATTITUDE"] == pytest.approx(100, rel=0.1)
    assert {"SYS_STATUS", "EXTENDED_SYS_STATE", "HOME_POSITION", "GPS_RAW_INT", "ESTIMATOR_STATUS"} <= set(default)

    for message_id, interval in ((ODOMETRY, 4000), (31, -1), (32, 100_000), (436, 50_000)):
        client.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, message_id, interval)
        assert client.acknowledged(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL) == 0
    client.collect(0.1)
    asked = rates(2.0)
    assert asked["ODOMETRY"] == pytest.approx(250, rel=0.05)
    assert "ATTITUDE_QUATERNION" not in asked
    assert asked["LOCAL_POSITION_NED"] == pytest.approx(10, abs=1)
    assert asked["CURRENT_MODE"] == pytest.approx(20, abs=1)

    client.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 31, 0)
    client.command(mavlink.MAV_CMD_GET_MESSAGE_INTERVAL, 31)
    assert client.wait("MESSAGE_INTERVAL").interval_us == 20_000
    for unknown in (0, 66, 60_000):
        client.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, unknown, 1000)
        assert client.acknowledged(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL) == mavlink.MAV_RESULT_FAILED


def test_heartbeat_cannot_be_stopped(client: Client) -> None:
    client.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 0, -1)
    assert client.acknowledged(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL) == mavlink.MAV_RESULT_FAILED
    client.wait("HEARTBEAT", timeout_s=1.5)


def test_every_periodic_message_can_be_asked_for(client: Client) -> None:
    ids = {*default_intervals_us(Profile.ONBOARD), *default_intervals_us(Profile.GROUND_STATION), 0, 148}
    for message_id in sorted(ids):
        client.command(mavlink.MAV_CMD_REQUEST_MESSAGE, message_id)
        client.wait(mavlink.mavlink_map[message_id].msgname)
        assert client.acknowledged(mavlink.MAV_CMD_REQUEST_MESSAGE) == 0
    client.command(mavlink.MAV_CMD_REQUEST_MESSAGE, 397)
    assert client.acknowledged(mavlink.MAV_CMD_REQUEST_MESSAGE) == mavlink.MAV_RESULT_DENIED
    client.command(mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES, 1)
    assert client.wait("AUTOPILOT_VERSION").flight_sw_version >> 16 == 0x0111


def test_odometry_as_px4_fills_it(client: Client) -> None:
    message = client.wait("ODOMETRY")
    assert (message.frame_id, message.child_frame_id) == (mavlink.MAV_FRAME_LOCAL_NED, mavlink.MAV_FRAME_LOCAL_NED)
    assert message.estimator_type == mavlink.MAV_ESTIMATOR_TYPE_AUTOPILOT
    known = [index for index, value in enumerate(message.pose_covariance) if not math.isnan(value)]
    assert known == [0, 6, 11, 15, 18, 20]
    assert [i for i, v in enumerate(message.velocity_covariance) if not math.isnan(v)] == [0, 6, 11]
    assert client.wait("ODOMETRY").time_usec - message.time_usec in (33_000, 34_000)


def test_commands_for_others_and_damaged_frames_are_ignored(client: Client) -> None:
    client.command(400, 1.0, target=(2, 1))
    client.command(400, 1.0, target=(1, 25))
    good = bytearray(mavlink.MAVLink_command_long_message(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0).pack(client.mav))
    good[14] ^= 1
    client.send_raw(bytes(good))
    client.send_raw(b"\xfd\xff\xfd nonsense")
    client.command(31_999)
    assert client.acknowledged(31_999) == mavlink.MAV_RESULT_UNSUPPORTED
    assert not client.wait("HEARTBEAT").base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED


def test_command_int_is_acknowledged_too(client: Client) -> None:
    client.send(mavlink.MAVLink_command_int_message(1, 1, 0, 31_998, 0, 0, 0, 0, 0, 0, 0, 0, 0))
    assert client.acknowledged(31_998) == mavlink.MAV_RESULT_UNSUPPORTED


def test_parameters_on_the_wire(client: Client) -> None:
    client.send(mavlink.MAVLink_param_request_read_message(1, 1, b"COM_OBL_RC_ACT", -1))
    answer = client.wait("PARAM_VALUE")
    assert answer.param_type == mavlink.MAV_PARAM_TYPE_INT32
    assert struct.pack("<f", answer.param_value) == struct.pack("<i", 0)

    (five,) = struct.unpack("<f", struct.pack("<i", 5))
    client.send(mavlink.MAVLink_param_set_message(1, 1, b"COM_OBL_RC_ACT", five, mavlink.MAV_PARAM_TYPE_INT32))
    assert struct.pack("<f", client.wait("PARAM_VALUE").param_value) == struct.pack("<i", 5)
    client.send(mavlink.MAVLink_param_request_read_message(1, 0, b"", answer.param_index))
    assert client.wait("PARAM_VALUE").param_id == "COM_OBL_RC_ACT"

    client.send(mavlink.MAVLink_param_set_message(1, 1, b"MC_ROLL_P", 3.0, mavlink.MAV_PARAM_TYPE_REAL32))
    assert client.wait("PARAM_VALUE").param_value == 3.0

    client.send(mavlink.MAVLink_param_request_read_message(1, 1, b"NO_SUCH_THING", -1))
    client.send(mavlink.MAVLink_param_request_read_message(1, 1, b"_HASH_CHECK", -1))
    hashed = client.wait("PARAM_VALUE")
    assert (hashed.param_id, hashed.param_type, hashed.param_index) == ("_HASH_CHECK", 5, 65535)

    client.send(mavlink.MAVLink_param_request_list_message(1, 1))
    assert client.wait("PARAM_VALUE").param_id == "_HASH_CHECK"
    names = [client.wait("PARAM_VALUE").param_id for _ in range(hashed.param_count)]
    assert names == sorted(names)
    assert "MIS_TAKEOFF_ALT" in names


def test_time_ping_and_mission(client: Client) -> None:
    client.send(mavlink.MAVLink_timesync_message(0, 123_456))
    answer = client.wait("TIMESYNC", lambda m: m.tc1 != 0)
    assert answer.ts1 == 123_456
    client.send(mavlink.MAVLink_ping_message(77, 5, 0, 0))
    pong = client.wait("PING")
    assert (pong.time_usec, pong.seq, pong.target_system, pong.target_component) == (77, 5, 1, 191)
    client.send(mavlink.MAVLink_mission_request_list_message(1, 1))
    assert client.wait("MISSION_COUNT").count == 0
    client.send(mavlink.MAVLink_mission_count_message(1, 1, 3))
    assert client.wait("MISSION_ACK").type == mavlink.MAV_MISSION_NO_SPACE


def test_status_texts_only_reach_ground_stations() -> None:
    (companion,) = clients(autopilot(quadrotor()), (Profile.ONBOARD, 191))
    companion.heartbeat()
    companion.command(400, 1.0)
    companion.acknowledged(400)
    assert "STATUSTEXT" not in [m.get_type() for m in companion.collect(0.3)]
    companion.heartbeat(mavlink.MAV_TYPE_GCS)
    companion.command(400, 0.0)
    assert "Disarmed" in companion.wait("STATUSTEXT").text


def test_links_have_their_own_rates_and_tell_of_each_others_parameters() -> None:
    companion, ground = clients(autopilot(quadrotor()), (Profile.ONBOARD, 191), (Profile.GROUND_STATION, 191))
    companion.heartbeat()
    ground.heartbeat(mavlink.MAV_TYPE_GCS)
    companion.wait("ODOMETRY")
    names = [m.get_type() for m in ground.collect(1.2)]
    assert "ODOMETRY" not in names
    assert "VFR_HUD" in names
    ground.send(mavlink.MAVLink_param_set_message(1, 1, b"MC_ROLL_P", 3.5, mavlink.MAV_PARAM_TYPE_REAL32))
    assert companion.wait("PARAM_VALUE").param_value == 3.5


# --- flight ---------------------------------------------------------------------------------------------------------


def test_set_mode_is_acknowledged_twice(client: Client) -> None:
    fly(client)
    client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 6)
    assert client.acknowledged(mavlink.MAV_CMD_DO_SET_MODE) == mavlink.MAV_RESULT_ACCEPTED
    assert client.acknowledged(mavlink.MAV_CMD_DO_SET_MODE) == mavlink.MAV_RESULT_TEMPORARILY_REJECTED
    client.setpoint()
    client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 6)
    assert [client.acknowledged(mavlink.MAV_CMD_DO_SET_MODE) for _ in range(2)] == [0, 0]
    client.until_mode(FlightMode.OFFBOARD)
    custom = custom_mode(FlightMode.HOLD)
    client.send(mavlink.MAVLink_set_mode_message(1, 1, custom))
    assert client.acknowledged(mavlink.MAV_CMD_DO_SET_MODE) == 0
    client.until_mode(FlightMode.HOLD)


def test_offboard_is_lost_after_a_second_of_silence_and_comes_back(client: Client) -> None:
    fly(client)
    to_offboard(client)
    client.collect(0.3, client.setpoint)
    silent_since_s = client.now_s()
    lost = client.until_mode(FlightMode.RTL, 2.0)
    assert 0.95 < client.now_s() - silent_since_s < 1.2
    assert lost.intended_custom_mode == custom_mode(FlightMode.OFFBOARD)
    client.wait("HEARTBEAT", lambda m: m.system_status == mavlink.MAV_STATE_CRITICAL)

    client.setpoint()
    back = client.until_mode(FlightMode.OFFBOARD, 0.5)
    assert back.intended_custom_mode == custom_mode(FlightMode.OFFBOARD)

    client.until_mode(FlightMode.RTL, 2.0)
    client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4, 3)
    client.until_mode(FlightMode.HOLD)
    modes = {m.custom_mode for m in client.collect(0.4, client.setpoint) if m.get_type() == "CURRENT_MODE"}
    assert modes == {custom_mode(FlightMode.HOLD)}, "another mode was asked for: a resumed stream changes nothing"


def test_setpoints_for_others_do_not_count(client: Client) -> None:
    fly(client)
    q = [1.0, 0.0, 0.0, 0.0]
    client.send(mavlink.MAVLink_set_attitude_target_message(0, 7, 1, 7, q, 0.0, 0.0, 0.0, HOVER))
    client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 6)
    assert [client.acknowledged(mavlink.MAV_CMD_DO_SET_MODE) for _ in range(2)] == [0, 1]
    client.send(mavlink.MAVLink_set_attitude_target_message(0, 0, 0, 7, q, 0.0, 0.0, 0.0, HOVER))
    client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 6)
    assert [client.acknowledged(mavlink.MAV_CMD_DO_SET_MODE) for _ in range(2)] == [0, 0]


# --- lockstep -------------------------------------------------------------------------------------------------------


def lockstep_flight(interval_us: int, ticks: int, linger_s: float) -> tuple[list[bytes], RunningPlant]:
    """Fly the rig for a number of ticks; the datagrams since the clock started, and the plant."""
    pilot = autopilot(rig())
    with RunningPlant(pilot, lockstep=True) as running, closing(UdpClient(running.port)) as client:
        client.heartbeat()
        client.wait("HEARTBEAT")
        time.sleep(linger_s)  # how long the clock stands must not matter
        assert pilot.time_us == 0
        client.command(400, 1.0)
        client.acknowledged(400)
        client.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, ODOMETRY, interval_us)
        client.acknowledged(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL)
        client.raw.clear()
        for tick in range(1, ticks + 1):
            odometry = client.wait("ODOMETRY")
            assert odometry.time_usec == tick * interval_us
            if tick == 10:
                client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 6)
            pitch = 0.1 * math.sin(0.05 * tick)
            client.setpoint((math.cos(0.5 * pitch), 0.0, math.sin(0.5 * pitch), 0.0), HOVER, odometry.time_usec // 1000)
        client.wait("ODOMETRY")
        assert pilot.time_us == (ticks + 1) * interval_us, "it waits for the set-point of its last sample"
        frames = [message for message in client.raw if not _is_heartbeat_alone(message)]
    return frames, running


def _is_heartbeat_alone(datagram: bytes) -> bool:
    return datagram[7] == 0 and len(datagram) == datagram[1] + 12


def test_lockstep_is_deterministic() -> None:
    first, plant = lockstep_flight(4000, 300, 0.0)
    second, _ = lockstep_flight(4000, 300, 0.37)
    assert first == second
    assert plant.autopilot.commander.mode is FlightMode.OFFBOARD
    assert abs(plant.autopilot.estimate().position_ned_m[0]) > 0.001
    assert plant.result is not None
    assert plant.result.odometry_sent == 301


def test_lockstep_stands_still_until_odometry_is_wanted() -> None:
    pilot = autopilot(rig())
    with RunningPlant(pilot, lockstep=True) as running, closing(UdpClient(running.port)) as client:
        client.heartbeat()
        client.wait("HEARTBEAT")
        client.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 31, 10_000)
        client.send(mavlink.MAVLink_param_request_read_message(1, 1, b"MC_ROLL_P", -1))
        assert client.wait("PARAM_VALUE").param_value == 4.0
        assert pilot.time_us == 0


def test_lockstep_gives_up_with_a_named_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sitl.wire.lockstep.SETPOINT_TIMEOUT_S", 0.2)
    running = RunningPlant(autopilot(rig()), lockstep=True)
    with running, closing(UdpClient(running.port)) as client:
        client.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, ODOMETRY, 4000)
        client.setpoint(ms=1)  # stamped for another sample
        running.join()
    assert isinstance(running.error, LockstepTimeoutError)
    assert "time_boot_ms 4 within" in str(running.error)


# --- from one link to the others ------------------------------------------------------------------------------------


def test_what_is_not_for_the_autopilot_alone_is_passed_on_to_the_other_link() -> None:
    companion, station = clients(autopilot(quadrotor()), (Profile.ONBOARD, 191), (Profile.GROUND_STATION, 190))
    companion.heartbeat()
    station.heartbeat(mavlink.MAV_TYPE_GCS)
    companion.wait("HEARTBEAT", lambda m: m.get_srcComponent() == 190)
    place = (10, 1, 191, 1, 0x9F8, 1.0, 2.0, -3.0, *(0.0,) * 8)
    station.command(mavlink.MAV_CMD_REQUEST_MESSAGE, 148)
    station.send(mavlink.MAVLink_set_position_target_local_ned_message(*place))
    found = companion.collect(0.5)
    steered = [m for m in found if m.get_type() == "SET_POSITION_TARGET_LOCAL_NED"]
    assert [(m.x, m.y, m.z, m.get_srcComponent()) for m in steered] == [(1.0, 2.0, -3.0, 190)]
    assert not [m for m in found if m.get_type() == "COMMAND_LONG"]  # that was for the autopilot alone
    companion.setpoint()
    companion.send(mavlink.MAVLink_statustext_message(4, b"companion: fence"))
    heard = station.collect(0.5)
    assert [m.text for m in heard if m.get_type() == "STATUSTEXT"] == ["companion: fence"]
    assert not [m for m in heard if m.get_type() == "SET_ATTITUDE_TARGET"]
