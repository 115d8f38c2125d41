"""A log that nothing can be identified from ends as one clear line that says what to fly instead, and exit code 2."""

from __future__ import annotations

import math
import re
import shutil
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from harness.identify_logs import Change, Known, flown_tlog, fly, frame, only, tlog

from companion.attitude_response.kind import LinearResponse
from companion.attitude_response.kinds import SecondOrder
from companion.cli import main
from companion.mavlink.px4 import Mode

ROOT = Path(__file__).resolve().parents[3]
RIG, QUADROTOR = (ROOT / "config" / f"{name}.yaml" for name in ("antx_rig", "paper_quadrotor"))
Topics = dict[str, dict[str, Any]]
Cut = Callable[[str], Path]
FLY = r"fly at least three doublets of 5 to 10 deg"


def refused(capsys: pytest.CaptureFixture[str], *arguments: object) -> str:
    """The one line that a command ends with."""
    with pytest.raises(SystemExit) as ended:
        main(["identify", *(str(argument) for argument in arguments)])
    out, err = capsys.readouterr()
    assert ended.value.code == 2, out + err
    (line,) = err.splitlines()
    assert "Traceback" not in out
    return line


# --- ULogs with their data changed ------------------------------------------------------------------------------------


def no_setpoints(topics: Topics) -> None:
    topics["vehicle_attitude_setpoint"].clear()


def no_attitude(topics: Topics) -> None:
    topics["vehicle_attitude"].clear()


def no_status(topics: Topics) -> None:
    topics["vehicle_status"].clear()


def in_position_mode(topics: Topics) -> None:
    topics["vehicle_status"]["nav_state"][:] = 2


def disarmed(topics: Topics) -> None:
    topics["vehicle_status"]["arming_state"][:] = 1


def rates_only(topics: Topics) -> None:
    topics["vehicle_control_mode"]["flag_control_attitude_enabled"][:] = 0


def offboard_by_position(topics: Topics) -> None:
    topics["offboard_control_mode"]["attitude"][:] = 0
    topics["offboard_control_mode"]["position"][:] = 1


def _angles(topic: dict[str, Any], name: str) -> tuple[Any, Any]:
    w, x, y, z = (topic[f"{name}[{i}]"].astype(float) for i in range(4))
    return np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)), np.arcsin(2 * (w * y - z * x))


def _set_angles(topic: dict[str, Any], name: str, roll: Any, pitch: Any) -> None:
    cr, sr, cp, sp = np.cos(roll / 2), np.sin(roll / 2), np.cos(pitch / 2), np.sin(pitch / 2)
    for i, q in enumerate((cr * cp, sr * cp, cr * sp, -sr * sp)):
        topic[f"{name}[{i}]"] = q.astype(np.float32)


def wrong_sign(topics: Topics) -> None:
    roll, pitch = _angles(topics["vehicle_attitude"], "q")
    _set_angles(topics["vehicle_attitude"], "q", -roll, -pitch)


def clipped(topics: Topics) -> None:
    roll, pitch = _angles(topics["vehicle_attitude"], "q")
    limit = math.radians(4.0)
    _set_angles(topics["vehicle_attitude"], "q", np.clip(roll, -limit, limit), np.clip(pitch, -limit, limit))


def too_large(topics: Topics) -> None:
    for topic, name in (("vehicle_attitude_setpoint", "q_d"), ("vehicle_attitude", "q")):
        roll, pitch = _angles(topics[topic], name)
        _set_angles(topics[topic], name, 5.0 * roll, 5.0 * pitch)


def too_small(topics: Topics) -> None:
    for topic, name in (("vehicle_attitude_setpoint", "q_d"), ("vehicle_attitude", "q")):
        roll, pitch = _angles(topics[topic], name)
        _set_angles(topics[topic], name, 0.1 * roll, 0.1 * pitch)


def actuators_at_their_limit(topics: Topics) -> None:
    topics["actuator_motors"]["control[0]"][:] = 1.0


def torque_not_reached(topics: Topics) -> None:
    topics["control_allocator_status"]["torque_setpoint_achieved"][:] = 0


def gap_in_attitude(topics: Topics) -> None:
    stamps = topics["vehicle_attitude"]["timestamp"]
    only(topics["vehicle_attitude"], (stamps < 36_500_000) | (stamps > 37_500_000))


def gap_in_setpoints(topics: Topics) -> None:
    stamps = topics["vehicle_attitude_setpoint"]["timestamp"]
    only(topics["vehicle_attitude_setpoint"], (stamps < 43_000_000) | (stamps > 43_900_000))


def two_doublets(topics: Topics) -> None:
    for topic in topics.values():
        only(topic, topic["timestamp"] < 47_000_000)


def never_a_number(topics: Topics) -> None:
    topics["vehicle_attitude"]["q[0]"][:] = np.nan


def rough(topics: Topics) -> None:
    roll, pitch = _angles(topics["vehicle_attitude"], "q")
    noise = np.radians(4.0) * np.random.default_rng(0).normal(size=(2, len(roll)))
    _set_angles(topics["vehicle_attitude"], "q", roll + noise[0], pitch + noise[1])


CHANGES: dict[str, tuple[Change, str]] = {
    "no set-points": (no_setpoints, r"no attitude set-points \(vehicle_attitude_setpoint\): log them and fly doublets"),
    "no attitude": (no_attitude, r"no attitude \(vehicle_attitude\)"),
    "no status": (no_status, r"no vehicle_status"),
    "position mode": (
        in_position_mode,
        r"the vehicle was never armed in a mode that follows attitude set-points: fly doublets in OFF",
    ),
    "disarmed": (disarmed, r"the vehicle was never armed in a mode that follows attitude set-points"),
    "rates only": (rates_only, r"the vehicle was never armed in a mode that follows attitude set-points"),
    "OFFBOARD by position": (
        offboard_by_position,
        r"PX4's own position control made the set-points \(OFFBOARD by position, velocity or acceleration\)",
    ),
    "wrong sign": (wrong_sign, r"wrong sign: roll goes against its set-point: check the frames"),
    "clipped": (clipped, r"saturated: roll goes \d+ % of its set-point"),
    "too large": (too_large, r"saturated: the roll set-point reaches \d+ deg, and beyond 35 deg"),
    "too small": (too_small, rf"too little excitation: {FLY}"),
    "motors": (actuators_at_their_limit, r"saturated: thrust or an actuator is at its limit between"),
    "allocation": (torque_not_reached, r"saturated: thrust or an actuator is at its limit between"),
    "gap in attitude": (
        gap_in_attitude,
        r"gap: no attitude for 1\.0\d s after 36\.\d\d s \(vehicle's clock\): fly again",
    ),
    "gap in set-points": (gap_in_setpoints, r"gap: no set-points for 0\.9\d s after 4[23]\.\d\d s"),
    "two doublets": (two_doublets, rf"too little excitation in roll, 2 manoeuvres of 3: {FLY}"),
    "never a number": (never_a_number, r"no attitude: not one vehicle_attitude\.q is a rotation"),
    "rough": (rough, r"no model explains roll \(fit 0\.\d\d of at least 0\.9\)"),
}


@pytest.mark.parametrize("name", CHANGES)
def test_a_ulog_that_tells_too_little(
    name: str, bad_ulog: Callable[[Change], Path], capsys: pytest.CaptureFixture[str]
) -> None:
    change, line = CHANGES[name]
    said = refused(capsys, bad_ulog(change))
    assert re.match(rf"companion: \S+bad\.ulg: {line}", said), said


def test_a_ulog_whose_clock_goes_back(cut: Cut, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data = bytearray(cut("px4_sih_attitude_p4.ulg").read_bytes())
    at = 16
    while at < len(data):
        size = int.from_bytes(data[at : at + 2], "little")
        if data[at + 2] == ord("D") and at > len(data) // 2:
            stamp = int.from_bytes(data[at + 5 : at + 13], "little") - 3_000_000
            data[at + 5 : at + 13] = stamp.to_bytes(8, "little")
        at += 3 + size
    path = tmp_path / "back.ulg"
    path.write_bytes(data)
    line = r"the clock goes backwards: vehicle_attitude falls by (2\.9\d?|3) s after \d+\.\d+ s"
    assert re.match(rf"companion: {path}: {line}", said := refused(capsys, path)), said


# --- files that are no logs, or not all of one ------------------------------------------------------------------------


def _flagged(ulog: bytes) -> bytes:
    assert ulog[18] == ord("B")
    return ulog[:28] + b"\x02" + ulog[29:]


def test_files_that_are_no_logs(cut: Cut, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    ulog, traffic = cut("px4_sih_attitude_p4.ulg").read_bytes(), cut("px4_sih_doublets_p3.tlog").read_bytes()
    cases = {
        "empty": (b"", r"empty: a ULog \(\.ulg\), a tlog or a flight folder is wanted"),
        "text": (b"this is no log at all, it is text\n" * 99, r"not a log: a ULog"),
        "zeros": (bytes(4096), r"not a log"),
        "ulog header": (ulog[:16], r"truncated: nothing whole is behind its header"),
        "cut in its flags": (ulog[:23], r"truncated: nothing whole is behind its header"),
        "a quarter of a ulog": (
            ulog[: len(ulog) // 4 + 1],
            rf"(too little excitation|not enough information).*{FLY}.* \(\S+: the end is cut at byte \d+ of \d+ ",
        ),
        "damaged ulog": (
            ulog[:4_000] + bytes(len(ulog) - 8_000) + ulog[-4_000:],
            r"no attitude set-points \(vehicle_attitude_setpoint\), the file is damaged or cut at byte \d+ of \d+",
        ),
        "newer ulog": (_flagged(ulog), r"not a readable ULog: its flags say that it is of a newer format"),
        "a quarter of a tlog": (
            traffic[: len(traffic) // 4 + 3],
            rf"(too little excitation|not enough information).*{FLY}.* \(\S+: the end is cut at byte \d+ of \d+ ",
        ),
        "tlog header": (traffic[:9], r"truncated: no whole record in its 9 bytes"),
    }
    for name, (data, line) in cases.items():
        path = tmp_path / name.replace(" ", "_")
        path.write_bytes(data)
        said = refused(capsys, path)
        assert re.match(rf"companion: {path}: {line}", said), said


def test_places_without_a_log(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert refused(capsys, tmp_path / "none.ulg").endswith("none.ulg: no such file")
    assert "not a flight folder: neither traffic.tlog nor flight.mcap in it" in refused(capsys, tmp_path)


# --- tlogs ------------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def one_axis(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A tlog of a vehicle of which only pitch was excited."""
    path = tmp_path_factory.mktemp("one") / "pitch.tlog"
    path.write_bytes(flown_tlog(fly(Known(LinearResponse(SecondOrder, (9.0, 0.9))), 1, manoeuvres=3)))
    return path


def records(data: bytes) -> list[tuple[float, bytes]]:
    found, at = [], 0
    while at < len(data):
        end = at + 8 + 12 + data[at + 9]
        found.append((int.from_bytes(data[at : at + 8]) * 1e-6, data[at + 8 : end]))
        at = end
    return found


def restarted(raw: bytes) -> bytes:
    """The frame as the vehicle would send it 12 s earlier."""
    if raw[7] != 31:
        return raw
    values = dict(zip(("q1", "q2", "q3", "q4"), struct.unpack_from("<4f", raw.ljust(60, b"\0"), 14), strict=True))
    return frame("ATTITUDE_QUATERNION", (1, 1), time_boot_ms=int.from_bytes(raw[10:14], "little") - 12_000, **values)


def test_one_axis_is_identified_and_the_other_asked_for(one_axis: Path, capsys: pytest.CaptureFixture[str]) -> None:
    line = refused(capsys, one_axis, "--config", QUADROTOR)
    assert re.match(rf"companion: \S+: too little excitation in roll, no manoeuvre: {FLY}", line), line
    assert refused(capsys, one_axis) == line
    with pytest.raises(SystemExit) as ended:  # a rig only pitches
        main(["identify", str(one_axis), "--config", str(RIG)])
    assert ended.value.code == 0
    out, err = capsys.readouterr()
    assert "pitch, 3 manoeuvres" in out
    assert "roll" not in out
    assert err == ""


def test_an_axis_too_few_writes_nothing(one_axis: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    config = tmp_path / "my.yaml"
    shutil.copy(QUADROTOR, config)
    assert "too little excitation in roll" in refused(capsys, one_axis, "--config", config, "--write")
    assert config.read_bytes() == QUADROTOR.read_bytes()
    assert [path.name for path in tmp_path.iterdir()] == ["my.yaml"]


def test_another_vehicle(cut: Cut, one_axis: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    config = tmp_path / "seven.yaml"
    config.write_text(RIG.read_text().replace("system_id: 1 ", "system_id: 7 "))
    assert "wrong vehicle: attitude of system 1 in it, of 7 none" in refused(capsys, one_axis, "--config", config)
    ulog = cut("px4_sih_attitude_p4.ulg")
    assert "wrong vehicle: a log of system 1, wanted is 7" in refused(capsys, ulog, "--config", config)
    other = tmp_path / "other.tlog"
    other.write_bytes(
        tlog(
            (t, frame("ATTITUDE_QUATERNION", (3, 1), q1=1.0) if raw[7] == 31 else raw)
            for t, raw in records(one_axis.read_bytes())
        )
    )
    assert "wrong vehicle: set-points go to system 1, attitude comes from 3" in refused(capsys, other)


def test_a_frame_inside_a_damaged_one_is_none(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Found by fuzzing: it ended in a traceback."""
    inner = frame("COMMAND_LONG", (1, 191))
    outer = b"\xfd" + bytes([len(inner), 0, 0, 0, 1, 1, 31, 0, 0]) + inner + b"\0\0"
    path = tmp_path / "damaged.tlog"
    path.write_bytes(tlog([(0.0, outer)]))
    assert "no attitude" in refused(capsys, path)


def test_tlogs_that_tell_too_little(one_axis: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    whole = records(one_axis.read_bytes())
    hold = {"base_mode": 0x81, "custom_mode": int(Mode.HOLD), "autopilot": 12}
    cases = {
        "no set-points": (
            tlog(r for r in whole if r[1][7] != 82),
            r"no set-points: no SET_ATTITUDE_TARGET to vehicle 1",
        ),
        "no attitude": (tlog(r for r in whole if r[1][7] != 31), r"no attitude: no ODOMETRY or ATTITUDE_QUATERNION"),
        "gap": (
            tlog(r for r in whole if not 11.0 < r[0] < 11.8),
            r"gap: no set-points for 0\.8\d? s after 1[01]\.\d\d s",
        ),
        "not OFFBOARD": (
            tlog((t, frame("HEARTBEAT", (1, 1), **hold) if raw[7] == 0 else raw) for t, raw in whole),
            r"the vehicle was never armed in a mode that follows attitude set-points",
        ),
        "clock of the vehicle": (
            tlog((t, restarted(raw) if t > 12.0 else raw) for t, raw in whole),
            r"the clock goes backwards: the vehicle's time in ATTITUDE_QUATERNION falls by 12 s",
        ),
    }
    for name, (data, line) in cases.items():
        path = tmp_path / f"{name.replace(' ', '_')}.tlog"
        path.write_bytes(data)
        said = refused(capsys, path, "--config", RIG)
        assert re.match(rf"companion: {path}: .*{line}", said), said


def test_write_needs_a_config(cut: Cut, capsys: pytest.CaptureFixture[str]) -> None:
    assert "--write: give the config to write into" in refused(capsys, cut("px4_sih_attitude_p4.ulg"), "--write")
