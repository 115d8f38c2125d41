"""The tool server of a flying process, over a real Unix socket: who gets in, what goes out, what comes through."""

from __future__ import annotations

import contextlib
import os
import socket
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import development as mavlink

from companion.mavlink import px4
from companion.mavlink.client import open_shared
from companion.mavlink.codec import Frame, FrameParser, Layout
from companion.mavlink.link import LinkError
from companion.mavlink.logs.protocol import DATA_BYTES, ON_A_LINE
from companion.mavlink.socket_owner import refusal
from companion.mavlink.tool_client import ToolLink, tool_socket, tool_sockets
from companion.mavlink.tool_server import COLD, ToolServer, question

REQUEST_DATA = Layout("LOG_REQUEST_DATA")
TOOL = mavlink.MAVLink(None, srcSystem=1, srcComponent=192)


def frame_of(message: Any) -> Frame:
    (frame,) = FrameParser().feed(bytes(message.pack(TOOL)))
    return frame


@pytest.fixture
def server(tmp_path: Path) -> Iterator[ToolServer]:
    tmp_path.chmod(0o700)
    opened = ToolServer(tmp_path / "tools.sock")
    yield opened
    opened.close()


@pytest.fixture
def tool(server: ToolServer) -> Iterator[ToolLink]:
    link = ToolLink(server.path, 0.02)
    yield link
    link.close()


READ = mavlink.MAVLink_param_request_read_message(1, 1, b"MC_ROLL_P", -1)
QUESTIONS = [
    READ,
    mavlink.MAVLink_log_request_list_message(1, 1, 0, 0xFFFF),
    mavlink.MAVLink_log_request_data_message(1, 1, 0, 0, 90),
    mavlink.MAVLink_log_request_end_message(1, 1),
    mavlink.MAVLink_ping_message(1, 2, 0, 0),
    px4.request_message(1, 1, 148),
    px4.command(1, 1, mavlink.MAV_CMD_GET_MESSAGE_INTERVAL, 331),
]
ORDERS = [
    px4.arm(1, 1),
    px4.set_mode(1, 1, px4.Mode.LAND),
    px4.message_interval(1, 1, 331, 1.0),
    px4.heartbeat(4),
    px4.command(1, 1, mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1.0),
    px4.command(1, 1, mavlink.MAV_CMD_DO_FLIGHTTERMINATION, 1.0),
    mavlink.MAVLink_set_mode_message(1, 1, 0),
    mavlink.MAVLink_param_set_message(1, 1, b"MC_ROLL_P", 9.0, 9),
    mavlink.MAVLink_log_erase_message(1, 1),
    mavlink.MAVLink_param_request_list_message(1, 1),  # a burst of a thousand frames
    mavlink.MAVLink_set_attitude_target_message(0, 1, 1, 7, [1.0, 0.0, 0.0, 0.0], 0.0, 0.0, 0.0, 0.5),
    mavlink.MAVLink_set_position_target_local_ned_message(0, 1, 1, 1, 0, *([0.0] * 11)),
    mavlink.MAVLink_manual_control_message(1, 0, 0, 0, 0, 0),
    mavlink.MAVLink_serial_control_message(10, 0, 0, 0, 0, [0] * 70),
]


@pytest.mark.parametrize("message", QUESTIONS, ids=lambda m: m.get_type())
def test_a_question_goes_out(server: ToolServer, tool: ToolLink, message: Any) -> None:
    frame = frame_of(message)
    assert question(frame)
    tool.send(frame.raw)
    assert server.asked(10.0) == frame.raw
    assert server.attached


@pytest.mark.parametrize("message", ORDERS, ids=lambda m: m.get_type())
def test_an_order_does_not(server: ToolServer, tool: ToolLink, message: Any) -> None:
    tool.send(frame_of(message).raw)
    assert server.asked(10.0) == b""
    assert server.refused == 1


def test_an_order_behind_a_question_does_not_slip_through(server: ToolServer, tool: ToolLink) -> None:
    tool.send(frame_of(READ).raw + frame_of(px4.arm(1, 1)).raw)
    assert server.asked(10.0) == b""
    assert server.refused == 1


def test_rubbish_goes_nowhere(server: ToolServer, tool: ToolLink) -> None:
    tool.send(b"\xfd" * 300)
    tool.send(frame_of(READ).raw[:-1])
    assert [server.asked(10.0), server.asked(10.0)] == [b"", b""]


def test_what_is_hot_stays_inside(server: ToolServer, tool: ToolLink) -> None:
    tool.send(b"")
    assert server.asked(10.0) == b""
    assert server.attached, "an empty datagram says that a tool is there"
    hot = frame_of(READ)._replace(message_id=mavlink.MAVLINK_MSG_ID_ODOMETRY)
    cold = frame_of(mavlink.MAVLink_param_value_message(b"MC_ROLL_P", 4.0, 9, 1, 0))
    server.offer([hot, cold, hot])
    assert tool.receive() == cold.raw
    assert tool.receive() == b""
    for name in ("ODOMETRY", "ATTITUDE_QUATERNION", "LOCAL_POSITION_NED", "ATTITUDE", "HIGHRES_IMU", "CURRENT_MODE"):
        assert getattr(mavlink, f"MAVLINK_MSG_ID_{name}") not in COLD


def test_a_log_is_asked_for_in_small_bursts_one_after_the_other(server: ToolServer, tool: ToolLink) -> None:
    big = frame_of(mavlink.MAVLink_log_request_data_message(1, 1, 3, 4500, 1000))
    tool.send(big.raw)
    now_s, asked = 10.0, []
    while now_s < 10.5:
        if data := server.asked(now_s):
            (frame,) = FrameParser().feed(data)
            values = REQUEST_DATA.named(frame.payload)
            assert (values["id"], values["target_system"], values["target_component"]) == (3, 1, 1)
            asked.append((now_s, values["ofs"], values["count"]))
        now_s += 0.004
    size = ON_A_LINE.burst_frames * DATA_BYTES
    assert [(offset, count) for _, offset, count in asked] == [
        (4500, size),
        (4500 + size, size),
        (4500 + 2 * size, 1000 - 2 * size),
    ]
    assert min(b[0] - a[0] for a, b in pairwise(asked)) >= ON_A_LINE.interval_s


def test_a_new_request_takes_the_place_of_the_last_and_an_end_ends_it(server: ToolServer, tool: ToolLink) -> None:
    tool.send(frame_of(mavlink.MAVLink_log_request_data_message(1, 1, 3, 0, 46080)).raw)
    tool.send(frame_of(mavlink.MAVLink_log_request_data_message(1, 1, 4, 90, 46080)).raw)
    bursts = FrameParser().feed(b"".join(server.asked(10.0 + 0.004 * turn) for turn in range(20)))
    assert [REQUEST_DATA.named(frame.payload)["id"] for frame in bursts] == [3, 4, 4, 4]
    end = frame_of(mavlink.MAVLink_log_request_end_message(1, 1))
    tool.send(end.raw)
    assert end.raw in [server.asked(10.081), server.asked(10.082)]
    assert [server.asked(11.0), server.asked(12.0)] == [b"", b""]


def test_the_end_of_a_log_is_heard_where_the_loop_turns_slowly(server: ToolServer, tool: ToolLink) -> None:
    tool.send(frame_of(mavlink.MAVLink_log_request_data_message(1, 1, 3, 0, 0xFFFFFFFF)).raw)
    assert server.asked(10.0) != b""
    end = frame_of(mavlink.MAVLink_log_request_end_message(1, 1))
    tool.send(end.raw)
    assert end.raw in [server.asked(10.1), server.asked(10.2)]
    assert server.asked(10.3) == b""


@pytest.mark.parametrize("offset", [0, 0xFFFFFFFF])
def test_a_request_without_end_does_not_break_the_server(server: ToolServer, tool: ToolLink, offset: int) -> None:
    tool.send(frame_of(mavlink.MAVLink_log_request_data_message(1, 1, 3, offset, 0xFFFFFFFF)).raw)
    assert len([data for step in range(300) if (data := server.asked(10.0 + step))]) == (300 if offset == 0 else 1)


def test_one_tool_at_a_time_until_he_has_gone(server: ToolServer, tool: ToolLink) -> None:
    second = ToolLink(server.path, 0.02)
    try:
        tool.send(b"")
        server.asked(10.0)
        second.send(frame_of(READ).raw)
        assert server.asked(11.0) == b""
        second.send(frame_of(READ).raw)
        assert server.asked(13.0) == frame_of(READ).raw, "the first has been silent for two seconds"
    finally:
        second.close()


def test_a_tool_who_died_is_forgotten(server: ToolServer, tool: ToolLink) -> None:
    tool.send(b"")
    server.asked(10.0)
    tool.close()
    server.offer([frame_of(mavlink.MAVLink_param_value_message(b"MC_ROLL_P", 4.0, 9, 1, 0))])
    assert not server.attached


def test_a_tool_who_falls_silent_is_forgotten(server: ToolServer, tool: ToolLink) -> None:
    tool.send(b"")
    server.asked(10.0)
    server.asked(11.0)
    assert server.attached
    server.asked(13.0)
    assert not server.attached


def test_a_tool_who_does_not_read_holds_nobody_up(server: ToolServer, tool: ToolLink) -> None:
    tool.send(b"")
    server.asked(10.0)
    frame = frame_of(mavlink.MAVLink_param_value_message(b"MC_ROLL_P", 4.0, 9, 1, 0))
    server.offer([frame] * 5000)
    assert server.attached
    assert tool.receive() == frame.raw


def test_a_path_too_long_for_a_socket_is_one_line(tmp_path: Path) -> None:
    tmp_path.chmod(0o700)
    with pytest.raises(LinkError, match="too long"):
        ToolServer(tmp_path / ("x" * 120))


def test_the_socket_of_a_process_that_ended_says_so(server: ToolServer, tool: ToolLink) -> None:
    server.close()
    with pytest.raises(LinkError, match="has ended"):
        tool.send(b"")
    assert not server.path.exists()


def test_what_a_dead_process_left_is_replaced(server: ToolServer) -> None:
    again = ToolServer(server.path)
    link = ToolLink(server.path, 0.02)
    link.send(frame_of(READ).raw)
    assert again.asked(10.0) == frame_of(READ).raw
    link.close()
    again.close()


def test_nobody_else_can_attach(server: ToolServer) -> None:
    assert server.path.stat().st_mode & 0o077 == 0


def test_a_folder_that_anybody_may_write_is_refused(tmp_path: Path) -> None:
    folder = tmp_path / "open"
    folder.mkdir()
    folder.chmod(0o777)
    with pytest.raises(LinkError, match="may be written by others"):
        ToolServer(folder / "tools.sock")


def test_a_folder_that_somebody_else_made_is_refused_by_both_sides(
    server: ToolServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As root's `companion vehicle` would meet it: /tmp/companion-0, made by whoever came first."""
    monkeypatch.setattr("os.geteuid", lambda: os.getuid() + 4242)
    ours = os.getuid() == 0  # then the folder is root's, and root is believed by everybody
    assert (refusal(tmp_path, mine=True, user=4242) is None) == ours
    other, made = 4243, tmp_path / "made"
    made.mkdir(mode=0o700)
    if ours:
        os.chown(made, other, other)
    assert "belongs to somebody else" in str(refusal(made, mine=True, user=4242))
    planted = made / "planted.sock"
    planted.touch()
    for opens in (lambda: ToolServer(made / "tools.sock"), lambda: ToolLink(planted, 0.02, mine=True)):
        with pytest.raises(LinkError, match="belongs to somebody else"):
            opens()


def test_a_link_in_the_place_of_the_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "real").mkdir(mode=0o700)
    (tmp_path / "link").symlink_to(tmp_path / "real")
    assert refusal(tmp_path / "real", mine=True) is None
    assert "is no folder" in str(refusal(tmp_path / "link", mine=True))


def test_what_lies_under_a_folder_that_others_may_write_is_refused(tmp_path: Path) -> None:
    above = tmp_path / "above"
    (above / "mine").mkdir(mode=0o700, parents=True)
    above.chmod(0o777)
    assert "may be written by others" in str(refusal(above / "mine", mine=True))
    above.chmod(0o1777)  # as /tmp: nobody else can take the folder away
    assert refusal(above / "mine", mine=True) is None


def test_a_service_s_user_is_believed_where_root_has_given_the_folder(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    folder.mkdir(mode=0o700)
    assert refusal(folder, mine=False) is None
    if os.getuid() == 0:
        os.chown(folder, 4243, 4243)
        assert refusal(folder, mine=False) is None
        assert "belongs to somebody else" in str(refusal(folder, mine=True))
        tmp_path.chmod(0o1777)  # whoever came first may have made it
        assert "belongs to somebody else" in str(refusal(folder, mine=False))


def test_each_side_looks_who_sends(server: ToolServer, tool: ToolLink, monkeypatch: pytest.MonkeyPatch) -> None:
    frame = frame_of(READ)
    tool.send(frame.raw)
    assert server.asked(10.0) == frame.raw
    answer = frame_of(mavlink.MAVLink_param_value_message(b"MC_ROLL_P", 4.0, 9, 1, 0))
    server.offer([answer])
    tool._users = {4243}
    assert tool.receive() == b""
    other = os.geteuid() + 4242
    monkeypatch.setattr("companion.mavlink.tool_server.receive", lambda *_: (frame.raw, other, "@somebody"))
    assert server.asked(11.0) == b""
    assert server.refused == 1


def test_a_tool_that_floods_is_heard_a_hundred_times_a_second(server: ToolServer, tool: ToolLink) -> None:
    frame, asked, now_s = frame_of(READ).raw, 0, 10.0
    while now_s < 11.0:
        with contextlib.suppress(BlockingIOError):
            tool._socket.send(frame, socket.MSG_DONTWAIT)
        asked += server.asked(now_s) != b""
        now_s += 0.001
    assert 80 <= asked <= 101


@pytest.mark.parametrize("url", ["udpin://127.0.0.1:{}", "udpout://127.0.0.1:{}"])
def test_a_tool_finds_the_socket_of_whoever_has_the_link(url: str, monkeypatch: Any, tmp_path: Path) -> None:
    tmp_path.chmod(0o700)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        url = url.format(free.getsockname()[1])
    server = ToolServer(tool_socket(url))
    try:
        for name in (url, f"unix://{server.path}"):
            link = open_shared(name)
            assert link.name == f"unix://{server.path}"
            link.close()
    finally:
        server.close()
    link = open_shared(url)
    assert link.name == url
    link.close()


def test_a_service_has_its_socket_in_its_own_folder(monkeypatch: pytest.MonkeyPatch) -> None:
    url = "serial:///dev/ttyAMA0:921600"
    monkeypatch.setenv("RUNTIME_DIRECTORY", "/run/companion")
    monkeypatch.delenv("XDG_RUNTIME_DIR", raising=False)
    assert (tool_socket(url), False) in tool_sockets(url)
    monkeypatch.delenv("RUNTIME_DIRECTORY")
    assert (tool_socket(url), True) == tool_sockets(url)[0]
    assert tool_socket(url) != tool_socket("serial:///dev/ttyAMA1:921600")


def test_a_socket_left_behind_is_passed_by(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    tmp_path.chmod(0o700)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    url = "udpout://127.0.0.1:14999"
    server = ToolServer(tool_socket(url))
    server._socket.close()  # as a kill -9 does
    link = open_shared(url)
    assert link.name == url
    link.close()
    with pytest.raises(LinkError, match="refused"):
        open_shared(f"unix://{server.path}")
