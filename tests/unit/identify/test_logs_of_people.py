"""Logs that people really have: read to the end of what is whole, or refused in one line that says what it is."""

from __future__ import annotations

import json
import math
import re
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from harness.log_edits import UlogEdit, first_version, number, packed, records, repacked, stepped

from companion.cli import main
from companion.identify import ulog
from companion.identify.identification import Identification, identify_log
from companion.identify.logs import read_log

Cut = Callable[[str], Path]
ULOG, TLOG = "px4_sih_attitude_p4.ulg", "px4_sih_doublets_p3.tlog"
ATTITUDE, SETPOINT, STATUS = "vehicle_attitude", "vehicle_attitude_setpoint", "vehicle_status"
ASKED, CONTROL = "offboard_control_mode", "vehicle_control_mode"
V1_11 = {
    "position": "ignore_position",
    "velocity": "ignore_velocity",
    "acceleration": "ignore_acceleration_force",
    "attitude": "ignore_attitude",
}
SMALL = 0.1  # of an interval: what one sample of thousands may change


@pytest.fixture(scope="module")
def whole(cut: Cut) -> dict[str, Identification]:
    return {name: identify_log([cut(name)]) for name in (ULOG, TLOG)}


def as_whole(found: Identification, clean: Identification, share: float = SMALL) -> None:
    """The same numbers, by a share of their intervals."""
    assert set(found.axes) == set(clean.axes) == {"roll", "pitch"}
    for axis, identified in found.axes.items():
        known = clean.axes[axis].chosen
        assert identified.chosen.model.name == known.model.name
        for value, of_whole, (low, high) in zip(identified.chosen.values, known.values, known.interval_95, strict=True):
            assert value == pytest.approx(of_whole, abs=share * (high - low)), axis


def edit(cut: Cut) -> UlogEdit:
    return UlogEdit(cut(ULOG).read_bytes())


def with_hole(data: bytes) -> bytes:
    return data[: len(data) // 2] + bytes(64) + data[len(data) // 2 + 64 :]


def flipped_signs(log: UlogEdit) -> bytes:
    for start in range(7, len(log.at(ATTITUDE)), 14):
        log.change(ATTITUDE, "q", "4f", lambda q: -q, slice(start, start + 7))
    return log.pack()


READ: dict[str, tuple[Callable[[UlogEdit], bytes], str]] = {
    "cut": (lambda log: log.pack()[:-5], r"the end is cut at byte \d+ of \d+ \(its last message is cut short\)"),
    "zeros": (lambda log: log.pack() + bytes(4096), r"the end is cut at byte \d+ of \d+ \(4096 zeros\)"),
    "rubbish behind": (lambda log: log.pack() + b"\xa5\x17" * 999, r"damaged from byte \d+ of \d+ to its end"),
    "hole": (lambda log: with_hole(log.pack()), r"damaged at byte \d+ of \d+: \d+ bytes in 1 place passed over"),
    "appended": (lambda log: log.appended(0.4), ""),
    "swapped": (lambda log: log.swap(ATTITUDE, 1200, 1201).pack(), r"1 of 2750 samples dropped: vehicle_attitude is"),
    "zero stamp": (
        lambda log: log.set(SETPOINT, "timestamp", "Q", 0, which=slice(5, 6)).pack(),
        r"1 of 880 samples dropped: vehicle_attitude_setpoint is out of order",
    ),
    "not a number": (
        lambda log: log.set(SETPOINT, "q_d", "4f", *[math.nan] * 4, which=slice(2, 3)).pack(),
        r"1 of 880 samples dropped: vehicle_attitude_setpoint\.q_d is not a number or no rotation",
    ),
    "last stamp UTC": (
        lambda log: log.set(ATTITUDE, "timestamp", "Q", 1_700_000_000_000_000, which=slice(-1, None)).pack(),
        r"1 of 2750 samples dropped: vehicle_attitude is out of order",
    ),
    "a stamp UTC": (
        lambda log: log.set(ATTITUDE, "timestamp", "Q", 1_700_000_000_000_000, which=slice(900, 901)).pack(),
        r"1 of 2750 samples dropped: vehicle_attitude is out of order",
    ),
    "status stamped UTC": (
        lambda log: log.set(STATUS, "timestamp", "Q", 1_700_000_000_000_000, which=slice(-1, None)).pack(),
        r"1 of 91 samples dropped: vehicle_status is out of order",
    ),
    "signs": (flipped_signs, ""),
    "a hovering VTOL": (
        lambda log: log.set(STATUS, "is_vtol", "B", 1).set(STATUS, "system_type", "B", 22).pack(),
        "",
    ),
    "a heading reset": (
        lambda log: (
            log.set(ATTITUDE, "quat_reset_counter", "B", 3, which=slice(1300, None))
            .set(ATTITUDE, "delta_q_reset", "4f", math.cos(0.5), 0, 0, math.sin(0.5), which=slice(1300, None))
            .pack()
        ),
        "",
    ),
}


@pytest.mark.parametrize("name", READ)
def test_a_ulog_is_read_around_what_is_wrong_with_it(
    name: str, cut: Cut, whole: dict[str, Identification], tmp_path: Path
) -> None:
    change, line = READ[name]
    path = tmp_path / "log.ulg"
    path.write_bytes(change(edit(cut)))
    found = identify_log([path])
    as_whole(found, whole[ULOG])
    assert len(found.notes) == bool(line)
    assert not line or re.match(rf"{path}: {line}", found.notes[0]), found.notes


def by_position(log: UlogEdit) -> UlogEdit:
    return log.set(ASKED, "attitude", "B", 0).set(ASKED, "position", "B", 1)


def of_v1_11(log: UlogEdit) -> UlogEdit:
    for field in V1_11:
        log.change(ASKED, field, "B", lambda flag: 1 - flag)
    return log.rename(ASKED, V1_11)


REFUSED: dict[str, tuple[Callable[[UlogEdit], UlogEdit], str]] = {
    "fixed wing": (
        lambda log: log.set(STATUS, "vehicle_type", "B", 2),
        r"a fixed wing flew \(vehicle_status\.vehicle_t",
    ),
    "rover": (lambda log: log.set(STATUS, "vehicle_type", "B", 3), r"a rover flew \(vehicle_status\.vehicle_type\)"),
    "transition": (
        lambda log: log.set(STATUS, "is_vtol", "B", 1).set(STATUS, "in_transition_mode", "B", 1),
        r"a VTOL in transition flew \(vehicle_status\.in_transition_mode\)",
    ),
    "by position": (by_position, r"PX4's own position control made the set-points"),
    "by position, v1.11": (lambda log: of_v1_11(by_position(log)), r"PX4's own position control made the set-points"),
    "by position, flags": (
        lambda log: log.without(ASKED).set(CONTROL, "flag_control_velocity_enabled", "B", 1),
        r"PX4's own position control made the set-points",
    ),
    "whose set-points": (
        lambda log: log.without(ASKED, CONTROL),
        r"neither offboard_control_mode\.attitude and \.position nor vehicle_control_mode\.flag_control_position_enab",
    ),
    "invalid attitude": (
        lambda log: log.set(ATTITUDE, "quat_reset_counter", "B", 3, which=slice(None, None, 2)).set(
            ATTITUDE, "delta_q_reset", "4f", math.cos(0.1), math.sin(0.1), 0, 0
        ),
        r"the vehicle was never armed in a mode that follows|too little excitation",
    ),
    **{
        f"no {topic}.{field}": (
            lambda log, topic=topic, field=field: log.rename(topic, {field: "other"}),  # type: ignore[misc]
            rf"no field {topic}\.{field} in it",
        )
        for topic, field in (
            (SETPOINT, "q_d"),
            (ATTITUDE, "q"),
            (STATUS, "nav_state"),
            (STATUS, "arming_state"),
            (STATUS, "vehicle_type"),
        )
    },
    "nothing of a VTOL": (
        lambda log: log.rename(STATUS, {"is_vtol": "a", "in_transition_mode": "b"}),
        r"no field vehicle_status\.in_transition_mode in it",
    ),
}


def refused(capsys: pytest.CaptureFixture[str], path: Path) -> str:
    with pytest.raises(SystemExit) as ended:
        main(["identify", str(path), "--json"])
    out, err = capsys.readouterr()
    assert ended.value.code == 2, out + err
    (line,) = err.splitlines()
    return line


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_not_logged_or_not_a_hovering_multicopter_is_named(
    name: str, cut: Cut, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    change, line = REFUSED[name]
    path = tmp_path / "log.ulg"
    path.write_bytes(change(edit(cut)).pack())
    said = refused(capsys, path)
    assert re.match(rf"companion: {path}: {line}", said), said


def test_the_set_points_of_v1_11_serve_as_well(cut: Cut, whole: dict[str, Identification], tmp_path: Path) -> None:
    path = tmp_path / "log.ulg"
    path.write_bytes(of_v1_11(edit(cut)).pack())
    as_whole(identify_log([path]), whole[ULOG], 1e-9)


# --- tunings ----------------------------------------------------------------------------------------------------------


def test_the_gain_in_force_at_the_doublets_counts(cut: Cut, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from companion.commands import design  # noqa: PLC0415
    from companion.config import load_config  # noqa: PLC0415

    path = tmp_path / "log.ulg"
    path.write_bytes(edit(cut).parameter("MC_ROLL_P", 6.5, 0.002).parameter("MC_PITCH_P", 9.0, 0.999).pack())
    with pytest.raises(SystemExit) as ended:
        main(["identify", str(path), "--json"])
    assert ended.value.code == 0
    gains = json.loads(capsys.readouterr().out)["gains"]
    assert (gains["MC_ROLL_P"], gains["MC_PITCH_P"]) == (6.5, 4.0)
    template = Path(__file__).resolve().parents[3] / "config" / "px4_quadrotor.yaml"
    arguments = design.Arguments([path], template, tmp_path / "out.yaml", 0.1, False, 0.0, False, False, True)
    text = design._with_response(template.read_text(), load_config(template), identify_log([path]), arguments)
    assert re.search(r"MC_ROLL_P: 6\.5\b", text)


def test_a_gain_changed_between_doublets_is_named_with_its_time(
    cut: Cut, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "log.ulg"
    path.write_bytes(edit(cut).parameter("MC_ROLL_P", 6.5, 0.55).pack())
    time_s = read_log(path).tuning[-1].time_s
    line = (
        rf"MC_ROLL_P was changed from 4\.0 to 6\.5 at {time_s:.2f} s \(vehicle's clock\), among the manoeuvres in roll"
    )
    assert re.match(rf"companion: {path}: {line}", said := refused(capsys, path)), said
    assert 18.0 + 0.5 * 44.0 < time_s < 18.0 + 0.6 * 44.0
    path.write_bytes(edit(cut).parameter("MC_ROLL_P", 4.0, 0.55).pack())  # written again as it was
    assert identify_log([path]).gains["MC_ROLL_P"] == 4.0


def told(name: str, value: float, at_s: float, start_us: int, message: str = "value") -> tuple[int, bytes]:
    from pymavlink.dialects.v20 import development as mavlink  # noqa: PLC0415

    real32 = mavlink.MAV_PARAM_TYPE_REAL32
    if message == "set":
        made: Any = mavlink.MAVLink_param_set_message(1, 1, name.encode(), value, real32)
        sender = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
    else:
        made = mavlink.MAVLink_param_value_message(name.encode(), value, real32, 900, 7)
        sender = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    return start_us + round(1e6 * at_s), bytes(made.pack(sender))


def test_a_tlog_tells_the_gains_it_carries(cut: Cut, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    flown = records(cut(TLOG).read_bytes())
    start_us = flown[0][0]

    def log(*more: tuple[int, bytes]) -> Path:
        path = tmp_path / "log.tlog"
        path.write_bytes(packed(sorted([*flown, *more])))
        return path

    late = log(told("MC_ROLL_P", 3.0, 40.0, start_us), told("MC_ROLL_P", 3.0, 41.0, start_us))
    assert identify_log([late]).gains == {"MC_ROLL_P": 3.0}, "it was not set in between"
    before = log(told("MC_ROLL_P", 4.0, 0.1, start_us), told("MC_ROLL_P", 3.5, 0.2, start_us))
    assert identify_log([before]).gains == {"MC_ROLL_P": 3.5}
    between = log(told("MC_ROLL_P", 3.0, 0.1, start_us), told("MC_ROLL_P", 3.5, 24.0, start_us, "set"))
    line = r"MC_ROLL_P was changed from 3\.0 to 3\.5 at 24\.0\d s \(our clock, from the first record\)"
    assert re.match(rf"companion: {between}: {line}", said := refused(capsys, between)), said


# --- tlogs ------------------------------------------------------------------------------------------------------------

YEAR_S = 365 * 86400.0
STEPS = (2.0, 3600.0, 10 * 86400.0, YEAR_S, -2.0, -YEAR_S)


@pytest.mark.parametrize("seconds", STEPS)
def test_a_clock_that_was_set_in_flight_is_undone(
    seconds: float, cut: Cut, whole: dict[str, Identification], tmp_path: Path
) -> None:
    path = tmp_path / "log.tlog"
    path.write_bytes(packed(stepped(records(cut(TLOG).read_bytes()), 0.55, seconds)))
    found = identify_log([path])
    as_whole(found, whole[TLOG], 0.25)
    way = "forward" if seconds > 0 else "back"
    (note,) = found.notes
    assert re.match(rf"{path}: our clock was set {way} by {abs(seconds):.0f}\.0\d s at 2\d\.\d\d s", note), note


def test_a_gap_of_a_year_is_no_work(cut: Cut, tmp_path: Path) -> None:
    """Both clocks jump: the flight is in two parts, and nothing is as long as the time between them."""
    flown = records(cut(TLOG).read_bytes())
    middle = len(flown) // 2
    later = [
        repacked(frame, time_boot_ms=(parsed(frame) + 4_000_000_000) % (1 << 32))
        if number(frame) in {31, 83}
        else frame
        for _, frame in flown[middle:]
    ]
    path = tmp_path / "log.tlog"
    times = [t for t, _ in stepped(flown, 0.5, 4_000_000.0)[middle:]]
    path.write_bytes(packed(flown[:middle] + list(zip(times, later, strict=True))))
    recording = read_log(path)
    assert len(recording.following) == 2
    assert (recording.following[:, 1] - recording.following[:, 0]).max() < 60.0
    assert recording.following[1, 0] > 3_999_000.0


def parsed(frame: bytes) -> int:
    return int(struct.unpack_from("<I", frame, 10)[0])


READ_TLOG: dict[str, tuple[Callable[[bytes], bytes], str]] = {
    "cut": (lambda data: data[:-7], r"the end is cut at byte \d+ of \d+ \(its last record is cut short\)"),
    "zeros": (lambda data: data + bytes(4096), r"the end is cut at byte \d+ of \d+ \(4096 zeros\)"),
    "hole": (with_hole, r"damaged at byte \d+ of \d+: \d+ bytes passed over|damaged: 1 frames with a wrong checksum"),
    "twice": (
        lambda data: packed([each for t, frame in records(data) for each in ((t, frame), (t + 300, frame))]),
        r"\d+ frames are in it twice: each counts once",
    ),
    "MAVLink 1": (lambda data: packed(first_version(records(data))), ""),
    "one stamp": (
        lambda data: packed([(t + (10**12 if i == 900 else 0), f) for i, (t, f) in enumerate(records(data))]),
        r"1 of \d+ records dropped: their time is not that of those around them",
    ),
}


@pytest.mark.parametrize("name", READ_TLOG)
def test_a_tlog_is_read_around_what_is_wrong_with_it(
    name: str, cut: Cut, whole: dict[str, Identification], tmp_path: Path
) -> None:
    change, line = READ_TLOG[name]
    path = tmp_path / "log.tlog"
    path.write_bytes(change(cut(TLOG).read_bytes()))
    found = identify_log([path])
    as_whole(found, whole[TLOG])
    assert bool(found.notes) is bool(line), found.notes
    assert not line or re.match(rf"{path}: ({line})", found.notes[0]), found.notes
    assert all(axis.delay is not None for axis in found.axes.values()), "the link's share is told all the same"


TYPES = {1: "MAV_TYPE_FIXED_WING", 10: "MAV_TYPE_GROUND_ROVER", 22: r"MAV_TYPE_VTOL_\w+ and EXTENDED_SYS_STATE.vtol_s"}


@pytest.mark.parametrize("kind", TYPES)
def test_a_tlog_of_another_kind_of_vehicle(
    kind: int, cut: Cut, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    flown = [
        (t, repacked(frame, type=kind) if number(frame) == 0 and frame[6] == 1 else frame)
        for t, frame in records(cut(TLOG).read_bytes())
    ]
    path = tmp_path / "log.tlog"
    path.write_bytes(packed(flown))
    assert re.match(rf"companion: {path}: HEARTBEAT.type is {TYPES[kind]}", said := refused(capsys, path)), said


def test_an_ardupilot_is_named(cut: Cut, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    flown = [
        (t, repacked(frame, autopilot=3) if number(frame) == 0 and frame[6] == 1 else frame)
        for t, frame in records(cut(TLOG).read_bytes())
    ]
    path = tmp_path / "log.tlog"
    path.write_bytes(packed(flown))
    assert "not a PX4: HEARTBEAT.autopilot is MAV_AUTOPILOT_ARDUPILOTMEGA" in refused(capsys, path)


# --- the container ----------------------------------------------------------------------------------------------------


def test_the_reader_agrees_with_the_library_on_a_whole_log(cut: Cut) -> None:
    from pyulog import ULog  # noqa: PLC0415

    from companion.identify.reading import ulog_file  # noqa: PLC0415

    ours = ulog_file.read(cut(ULOG).read_bytes(), frozenset(ulog.TOPICS))
    library = ULog(str(cut(ULOG)), list(ulog.TOPICS))
    assert {topic.name for topic in library.data_list} == set(ours.topics)
    for topic in library.data_list:
        for field, values in topic.data.items():
            name, _, index = field.rstrip("]").partition("[")
            column = ours.topics[topic.name][name]
            assert (column[:, int(index)] if index else column).tobytes() == values.tobytes(), (topic.name, field)
    assert {p.name: p.value for p in ours.parameters} == library.initial_parameters
    assert (ours.holes, ours.tail, ours.end) == ([], "", ours.size)


# --- whose set-points, over time --------------------------------------------------------------------------------------


def with_landed(log: UlogEdit, until: float) -> UlogEdit:
    """The log with a land detector whose word is that the vehicle stood on the ground for a share of the time."""
    log.define("vehicle_land_detected", "uint64_t timestamp;bool landed;", 900)
    places = log.at(STATUS)
    for n, place in reversed(list(enumerate(places))):
        stamp = log.messages[place][1][2:10]
        body = bytearray(struct.pack("<H", 900) + stamp + bytes([n < until * len(places)]))
        log.messages.insert(place, (ord("D"), body))
    return log


def test_modes_tell_whose_set_points_they_are(cut: Cut, tmp_path: Path) -> None:
    """A third in Stabilized, a third in Position, a third in OFFBOARD; a sixth of all on the ground."""
    log = edit(cut)
    count, flags = len(log.at(STATUS)), len(log.at(CONTROL))
    third, of_flags = count // 3, flags // 3
    log.set(STATUS, "nav_state", "B", 15, which=slice(0, third))
    log.set(STATUS, "nav_state", "B", 2, which=slice(third, 2 * third))
    for field in ("flag_control_position_enabled", "flag_control_velocity_enabled"):
        log.set(CONTROL, field, "B", 1, which=slice(of_flags, 2 * of_flags))
    path = tmp_path / "log.ulg"
    path.write_bytes(with_landed(log, 1 / 6).pack())
    recording = read_log(path)
    start_s, end_s = recording.track.attitude_time_s[[0, -1]]
    shares = (recording.following - start_s) / (end_s - start_s)
    assert shares.tolist() == [pytest.approx([2 / 3, 1], abs=0.03)], "sticks are no stream: they serve in flight"
    assert recording.in_flight is not None
    begun, ended = (recording.in_flight - start_s).ravel()[[0, -1]] / (end_s - start_s)
    assert (begun, ended) == (pytest.approx(1 / 6 + 2.0 / 44.0, abs=0.03), pytest.approx(1.0 - 2.0 / 44.0, abs=0.03))
    inside = sum(stop - start for start, stop in recording.in_flight) / (end_s - start_s)
    assert inside == pytest.approx(ended - begun, abs=0.02), "Position flight is in the air too"
