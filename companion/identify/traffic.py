"""A tlog: both ends of the link in our clock, and, where the vehicle tells, in its own.

Set-points are the SET_ATTITUDE_TARGET sent to the vehicle, attitude its ODOMETRY (or ATTITUDE_QUATERNION, where that is
faster), armed and mode its HEARTBEAT and CURRENT_MODE. ATTITUDE_TARGET says when the vehicle had a set-point in force.

Source: https://mavlink.io/en/messages/common.html; a tlog is records of an 8-byte big-endian time in microseconds and
one frame (pymavlink `mavutil.mavlogfile`).
"""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from pymavlink.dialects.v20 import development as mavlink

from companion.identify import clock
from companion.identify.series import (
    OURS,
    Estimate,
    Floats,
    LogError,
    Recording,
    Track,
    angles,
    intersect,
    ordered,
    spans,
)
from companion.mavlink.codec import FrameParser, Layout
from companion.mavlink.px4 import Mode

_TIME: Final = struct.Struct(">Q")
_V1: Final = 0xFE
_V2: Final = 0xFD
_SIGNED: Final = 0x01
_NEWEST_US: Final = 1 << 55  # a time above this is none
_AUTOPILOT: Final = 1  # component id
_ATTITUDE_IGNORED: Final = 0x80  # ATTITUDE_TARGET_TYPEMASK
_THRUST_LIMITS: Final = (0.02, 0.98)
_CLOCK_TOLERANCE_S: Final = 0.1  # datagrams overtake each other
_FASTER: Final = 1.3

_SETPOINT = Layout("SET_ATTITUDE_TARGET")
_ODOMETRY = Layout("ODOMETRY")
_FRAME, _CHILD_FRAME = _ODOMETRY.index("frame_id"), _ODOMETRY.index("child_frame_id")
_QUATERNION = Layout("ATTITUDE_QUATERNION")
_HEARTBEAT = Layout("HEARTBEAT")
_CURRENT_MODE = Layout("CURRENT_MODE")
_TARGET = Layout("ATTITUDE_TARGET")
_LAYOUTS: Final = {
    layout.message_id: layout for layout in (_SETPOINT, _ODOMETRY, _QUATERNION, _HEARTBEAT, _CURRENT_MODE, _TARGET)
}

Row = tuple[
    float, int, tuple[Any, ...]
]  # our time since the first record in s, system id of the sender, values in wire order
Rows = dict[str, list[Row]]


def looks_like(data: bytes) -> bool:
    """Whether a file begins as a tlog does."""
    return len(data) > _TIME.size and data[_TIME.size] in {_V1, _V2} and _TIME.unpack_from(data)[0] < _NEWEST_US


def read(path: Path, system_id: int | None = None) -> Recording:
    """Read a tlog. `system_id` is the vehicle's, where it is known. Raises `LogError`."""
    rows = _rows(path)
    vehicle = _vehicle(path, rows, system_id)
    setpoints = [row for row in rows["SET_ATTITUDE_TARGET"] if _is_for(row, vehicle)]
    if not setpoints:
        raise LogError(
            f"{path}: no set-points: no SET_ATTITUDE_TARGET to vehicle {vehicle} in it: fly doublets in OFFBOARD and "
            "record both directions"
        )
    sent_s, kept = _times(path, setpoints, "our time of sending")
    q = _columns(setpoints, kept, _SETPOINT, "q").astype(np.float32)
    attitude, layout, stamp, unit = _attitude(rows, vehicle)
    received_s, keep = _times(path, attitude, "our time of reception")
    stamps_s = _columns(attitude, keep, layout, stamp)[:, 0] * unit
    ordered(path, stamps_s, f"the vehicle's time in {layout.name}", _CLOCK_TOLERANCE_S)
    measured = ("q",) if layout is _ODOMETRY else ("q1", "q2", "q3", "q4")
    track = Track(OURS, sent_s, angles(q), received_s, angles(_columns(attitude, keep, layout, *measured)))
    thrust = _columns(setpoints, kept, _SETPOINT, "thrust")[:, 0]
    limited = (thrust < _THRUST_LIMITS[0]) | (thrust > _THRUST_LIMITS[1])
    targets = [row for row in rows["ATTITUDE_TARGET"] if row[1] == vehicle]
    applied = None
    if targets:
        every = np.arange(len(targets))
        in_force_s = _columns(targets, every, _TARGET, "time_boot_ms")[:, 0] * 1e-3
        applied = clock.match(sent_s, q, in_force_s, _columns(targets, every, _TARGET, "q").astype(np.float32))
    return Recording(
        path,
        "tlog",
        vehicle,
        track,
        _following(rows, vehicle, received_s[-1]),
        q,
        0.0,
        sent_s[limited],
        stamps_s,
        applied,
        {},
        _estimate([row for row in rows["ODOMETRY"] if row[1] == vehicle]),
    )


def _records(path: Path) -> Iterator[tuple[int, bytes]]:
    """(time in microseconds, frame) of every record. Raises `LogError` for a file that breaks off or is none."""
    data = path.read_bytes()
    at, total = 0, len(data)
    while at < total:
        head = at + _TIME.size
        if head + 3 > total:
            raise LogError(f"{path}: truncated: it ends inside a record, at byte {total}: copy it again")
        if data[head] == _V2:
            end = head + 12 + data[head + 1] + (13 if data[head + 2] & _SIGNED else 0)
        elif data[head] == _V1:
            end = head + 8 + data[head + 1]
        else:
            raise LogError(f"{path}: damaged: no MAVLink frame at byte {head}: copy it again")
        if end > total:
            raise LogError(f"{path}: truncated: it ends inside a record, at byte {total}: copy it again")
        yield _TIME.unpack_from(data, at)[0], data[head:end]
        at = end


def _rows(path: Path) -> Rows:
    """The messages that matter, by name."""
    rows: Rows = {layout.name: [] for layout in _LAYOUTS.values()}
    parser = FrameParser()
    first_us: int | None = None
    for time_us, raw in _records(path):
        first_us = time_us if first_us is None else first_us
        if raw[0] != _V2 or (raw[7] | raw[8] << 8 | raw[9] << 16) not in _LAYOUTS:
            continue
        for frame in parser.feed(raw):
            if len(frame.raw) < len(raw):
                continue  # what stands inside a damaged one
            layout = _LAYOUTS[frame.message_id]
            if layout is _SETPOINT or frame.component_id == _AUTOPILOT:
                rows[layout.name].append(((time_us - first_us) * 1e-6, frame.system_id, layout.unpack(frame.payload)))
    return rows


def _vehicle(path: Path, rows: Rows, system_id: int | None) -> int:
    """Whose attitude this log is about."""
    heard = Counter(row[1] for name in ("ODOMETRY", "ATTITUDE_QUATERNION") for row in rows[name])
    if not heard:
        raise LogError(f"{path}: no attitude: no ODOMETRY or ATTITUDE_QUATERNION of an autopilot: ask for one at 50 Hz")
    others = ", ".join(str(n) for n in sorted(heard))
    if system_id is not None:
        if system_id not in heard:
            raise LogError(f"{path}: wrong vehicle: attitude of system {others} in it, of {system_id} none")
        return system_id
    place = _SETPOINT.index("target_system")
    commanded = Counter(row[2][place] for row in rows["SET_ATTITUDE_TARGET"] if row[2][place])
    wanted: int = commanded.most_common(1)[0][0] if commanded else heard.most_common(1)[0][0]
    if wanted not in heard:
        raise LogError(f"{path}: wrong vehicle: set-points go to system {wanted}, attitude comes from {others}")
    return wanted


def _is_for(row: Row, vehicle: int) -> bool:
    values = row[2]
    attitude_wanted = not int(values[_SETPOINT.index("type_mask")]) & _ATTITUDE_IGNORED
    return values[_SETPOINT.index("target_system")] in {0, vehicle} and row[1] != 0 and attitude_wanted


def _attitude(rows: Rows, vehicle: int) -> tuple[list[Row], Layout, str, float]:
    """The faster of ODOMETRY, on which control runs, and ATTITUDE_QUATERNION; its stamp's field and unit."""
    odometry = [row for row in rows["ODOMETRY"] if row[1] == vehicle]
    quaternion = [row for row in rows["ATTITUDE_QUATERNION"] if row[1] == vehicle]
    if len(quaternion) > _FASTER * len(odometry):
        return quaternion, _QUATERNION, "time_boot_ms", 1e-3
    return odometry, _ODOMETRY, "time_usec", 1e-6


def _estimate(odometry: list[Row]) -> Estimate | None:
    """What ODOMETRY says of position and velocity where both are in local NED; None where it does not."""
    local = [row for row in odometry if row[2][_FRAME] == row[2][_CHILD_FRAME] == mavlink.MAV_FRAME_LOCAL_NED]
    if not local:
        return None
    every = np.arange(len(local))
    time_s = _columns(local, every, _ODOMETRY, "time_usec")[:, 0] * 1e-6
    keep = np.flatnonzero(np.diff(np.maximum.accumulate(time_s), prepend=-np.inf) > 0.0)
    return Estimate(
        time_s[keep], _columns(local, keep, _ODOMETRY, "x", "y"), _columns(local, keep, _ODOMETRY, "vx", "vy")
    )


def _times(path: Path, rows: list[Row], what: str) -> tuple[Floats, npt.NDArray[np.intp]]:
    time_s = np.array([row[0] for row in rows])
    keep = ordered(path, time_s, what, _CLOCK_TOLERANCE_S)
    return time_s[keep], keep


def _columns(rows: list[Row], keep: npt.NDArray[np.intp], layout: Layout, *fields: str) -> Floats:
    """Fields side by side, shape (n, k); an array takes as many columns as it has elements."""
    places = [layout.place(field) for field in fields]
    values = [
        [v for place in places for v in (rows[i][2][place] if isinstance(place, slice) else (rows[i][2][place],))]
        for i in keep
    ]
    return np.array(values, dtype=np.float64)


def _following(rows: Rows, vehicle: int, end_s: float) -> Floats:
    """When the vehicle said it was armed and in OFFBOARD."""
    mode_at, base_at = _HEARTBEAT.index("custom_mode"), _HEARTBEAT.index("base_mode")
    beats = [row for row in rows["HEARTBEAT"] if row[1] == vehicle]
    armed_s = np.array([row[0] for row in beats])
    armed = np.array([bool(row[2][base_at] & mavlink.MAV_MODE_FLAG_SAFETY_ARMED) for row in beats], dtype=bool)
    at = _CURRENT_MODE.index("custom_mode")
    modes = [(row[0], row[2][at]) for row in rows["CURRENT_MODE"] if row[1] == vehicle]
    modes = modes or [(row[0], row[2][mode_at]) for row in beats]
    mode_s = np.array([time_s for time_s, _ in modes])
    offboard = np.array([mode == Mode.OFFBOARD for _, mode in modes], dtype=bool)
    return intersect(spans(armed_s, armed, end_s), spans(mode_s, offboard, end_s))
