"""A tlog: both ends of the link in our clock, and, where the vehicle tells, in its own.

Set-points are the SET_ATTITUDE_TARGET sent to the vehicle, attitude its ODOMETRY (or ATTITUDE_QUATERNION, where that is
faster), armed and mode its HEARTBEAT and CURRENT_MODE. ATTITUDE_TARGET says when the vehicle had a set-point in force,
PARAM_VALUE with which gains.

Source: https://mavlink.io/en/messages/common.html
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt
from pymavlink.dialects.v20 import development as mavlink

from companion.identify import clock
from companion.identify.reading import samples, steps, tlog_file, tlog_state, tuning
from companion.identify.reading.tlog_file import Messages, TlogFile
from companion.identify.series import (
    GAINS,
    OURS,
    ClockMap,
    Estimate,
    Floats,
    LogError,
    ParameterValue,
    Recording,
    Track,
    angles,
    covered,
    intersect,
    ordered,
)

looks_like = tlog_file.looks_like

_WANTED: Final = (
    "SET_ATTITUDE_TARGET", "ODOMETRY", "ATTITUDE_QUATERNION", "HEARTBEAT", "CURRENT_MODE", "ATTITUDE_TARGET",
    "EXTENDED_SYS_STATE", "PARAM_VALUE", "PARAM_SET",
)  # fmt: skip
_AUTOPILOT: Final = 1  # component id
_ATTITUDE_IGNORED: Final = 0x80  # ATTITUDE_TARGET_TYPEMASK
_THRUST_LIMITS: Final = (0.02, 0.98)
_CLOCK_TOLERANCE_S: Final = 0.1  # datagrams overtake each other
_FASTER: Final = 1.3


class _Attitude(NamedTuple):
    """The attitude of the vehicle, as received: messages, quaternions of shape (n, 4), and the vehicle's time in s."""

    messages: Messages
    q: Floats
    stamps_s: Floats
    name: str


def read(path: Path, system_id: int | None = None) -> Recording:
    """Read a tlog to the end of what is whole. `system_id` is the vehicle's, where it is known. Raises `LogError`."""
    file = tlog_file.read(path.read_bytes(), _WANTED)
    notes = _whole(path, file)
    said = {
        name: each if name.startswith(("SET_", "PARAM_SET")) else each.only(each.component_id == _AUTOPILOT)
        for name, each in file.messages.items()
    }
    vehicle = _vehicle(path, said, system_id, file)
    wanted = _setpoints(said["SET_ATTITUDE_TARGET"], vehicle)
    if not len(wanted.rows):
        raise LogError(
            f"{path}: no set-points: no SET_ATTITUDE_TARGET to vehicle {vehicle} in it: fly doublets in OFFBOARD and "
            "record both directions"
        )
    said = {name: each if name == "PARAM_SET" else each.only(each.system_id == vehicle) for name, each in said.items()}
    attitude = _attitude(said)
    since_first_s = (file.time_us - file.time_us[0]) * 1e-6
    time_s, good = steps.undone(since_first_s, attitude.messages.records, attitude.stamps_s, notes)
    time_s -= time_s[good][0]

    def timed(each: Messages) -> tuple[Floats, Messages]:
        each = each.only(good[each.records])
        return time_s[each.records], each

    received_s, q, stamps_s = _received(path, attitude, time_s, good, notes)
    sent_s, wanted = timed(wanted)
    kept = ordered(path, sent_s, "our time of sending", notes, tolerance_s=_CLOCK_TOLERANCE_S)
    kept = kept[_rotations(wanted.rows["q"][kept], "SET_ATTITUDE_TARGET.q", notes)]
    sent_s, wanted = sent_s[kept], wanted.only(kept)
    if not len(sent_s):
        raise LogError(f"{path}: no set-points: not one SET_ATTITUDE_TARGET.q is a rotation")
    setpoint_q, thrust = np.ascontiguousarray(wanted.rows["q"]), wanted.rows["thrust"]
    limited = (thrust < _THRUST_LIMITS[0]) | (thrust > _THRUST_LIMITS[1])
    heard = {name: timed(each) for name, each in said.items()}
    following = tlog_state.followed(path, vehicle, heard, float(received_s[-1]))
    following = intersect(following, intersect(covered(sent_s), covered(received_s)))
    changes = _tuning(vehicle, heard["PARAM_VALUE"], heard["PARAM_SET"])
    return Recording(
        path,
        "tlog",
        vehicle,
        Track(OURS, sent_s, angles(setpoint_q), received_s, angles(q)),
        following,
        setpoint_q,
        0.0,
        sent_s[limited],
        stamps_s,
        _applied(sent_s, setpoint_q, said["ATTITUDE_TARGET"].rows),
        tuning.at(changes, float(following[0, 0]) if len(following) else np.inf),
        _estimate(said["ODOMETRY"].rows),
        tuning=changes,
        notes=tuple(notes),
    )


def _whole(path: Path, file: TlogFile) -> list[str]:
    """A line for whatever of the file is not read. Raises `LogError` where nothing is left."""
    if not file.versions:
        raise LogError(f"{path}: truncated: no whole record in its {file.size} bytes: copy it again")
    notes = []
    if file.holes:
        lost = sum(hole.stop - hole.start for hole in file.holes if hole.stop > hole.start)
        notes.append(f"damaged at byte {file.holes[0].start} of {file.size}: {lost} bytes passed over")
    if file.bad_checksums:
        notes.append(f"damaged: {file.bad_checksums} frames with a wrong checksum left out")
    if file.tail == "damaged":
        notes.append(f"damaged from byte {file.end} of {file.size} to its end: read up to there")
    elif file.tail:
        what = "its last record is cut short" if file.tail == "cut" else f"{file.size - file.end} zeros"
        notes.append(f"the end is cut at byte {file.end} of {file.size} ({what}): read up to there")
    if file.twice:
        notes.append(f"{file.twice} frames are in it twice: each counts once")
    return notes


def _vehicle(path: Path, said: dict[str, Messages], system_id: int | None, file: TlogFile) -> int:
    """Whose attitude this log is about."""
    heard = Counter(np.concatenate([said[name].system_id for name in ("ODOMETRY", "ATTITUDE_QUATERNION")]).tolist())
    if not heard:
        old = " (it is MAVLink 1, which has no ODOMETRY)" if set(file.versions) == {tlog_file.V1} else ""
        raise LogError(
            f"{path}: no attitude: no ODOMETRY or ATTITUDE_QUATERNION of an autopilot{old}: ask for one at 50 Hz"
        )
    others = ", ".join(str(n) for n in sorted(heard))
    if system_id is not None:
        if system_id not in heard:
            raise LogError(f"{path}: wrong vehicle: attitude of system {others} in it, of {system_id} none")
        return system_id
    commanded = Counter(said["SET_ATTITUDE_TARGET"].rows["target_system"].tolist())
    commanded.pop(0, None)
    wanted: int = (commanded or heard).most_common(1)[0][0]
    if wanted not in heard:
        raise LogError(f"{path}: wrong vehicle: set-points go to system {wanted}, attitude comes from {others}")
    return wanted


def _setpoints(sent: Messages, vehicle: int) -> Messages:
    """Those for the vehicle that have an attitude."""
    meant = np.isin(sent.rows["target_system"], (0, vehicle)) & (sent.rows["type_mask"] & _ATTITUDE_IGNORED == 0)
    return sent.only(meant & (sent.system_id != 0))


def _attitude(said: dict[str, Messages]) -> _Attitude:
    """The faster of ODOMETRY, on which control runs, and ATTITUDE_QUATERNION."""
    odometry, quaternion = said["ODOMETRY"], said["ATTITUDE_QUATERNION"]
    if len(quaternion.rows) > _FASTER * len(odometry.rows):
        rows = quaternion.rows
        q = np.stack([rows[f"q{i}"] for i in (1, 2, 3, 4)], axis=1).astype(np.float64)
        return _Attitude(quaternion, q, rows["time_boot_ms"] * 1e-3, "ATTITUDE_QUATERNION")
    return _Attitude(odometry, odometry.rows["q"].astype(np.float64), odometry.rows["time_usec"] * 1e-6, "ODOMETRY")


def _received(
    path: Path, attitude: _Attitude, time_s: Floats, good: npt.NDArray[np.bool_], notes: list[str]
) -> tuple[Floats, Floats, Floats]:
    """Time of reception, quaternion and the vehicle's time of every attitude that can be believed."""
    keep = np.flatnonzero(good[attitude.messages.records])
    keep = keep[_rotations(attitude.q[keep], f"the quaternion of {attitude.name}", notes)]
    stamp = f"the vehicle's time in {attitude.name}"
    keep = keep[ordered(path, attitude.stamps_s[keep], stamp, notes, tolerance_s=_CLOCK_TOLERANCE_S)]
    received_s = time_s[attitude.messages.records[keep]]
    kept = ordered(path, received_s, "our time of reception", notes, tolerance_s=_CLOCK_TOLERANCE_S)
    keep = keep[kept]
    if not len(keep):
        raise LogError(f"{path}: no attitude: not one quaternion of {attitude.name} is a rotation")
    return received_s[kept], attitude.q[keep], attitude.stamps_s[keep]


def _rotations(q: npt.NDArray[Any], what: str, notes: list[str]) -> npt.NDArray[np.bool_]:
    good = samples.rotations(q)
    if not good.all():
        notes.append(f"{(~good).sum()} of {len(q)} samples dropped: {what} is not a number or no rotation")
    return good


def _applied(sent_s: Floats, setpoint_q: npt.NDArray[np.float32], targets: npt.NDArray[Any]) -> ClockMap | None:
    return clock.match(sent_s, setpoint_q, targets["time_boot_ms"] * 1e-3, np.ascontiguousarray(targets["q"]))


def _estimate(odometry: npt.NDArray[Any]) -> Estimate | None:
    """What ODOMETRY says of position and velocity where both are in local NED; None where it does not."""
    ned = mavlink.MAV_FRAME_LOCAL_NED
    local = odometry[(odometry["frame_id"] == ned) & (odometry["child_frame_id"] == ned)]
    time_s = local["time_usec"] * 1e-6
    state = np.stack([local[field] for field in ("x", "y", "vx", "vy")], axis=1).astype(np.float64)
    keep = samples.in_order(time_s)
    keep = keep[samples.rising(time_s[keep])]
    keep = keep[np.isfinite(state[keep]).all(axis=1)]
    time_s = time_s[keep]
    reset = np.flatnonzero(np.diff(local["reset_counter"][keep])) + 1
    return Estimate(time_s, state[keep, :2], state[keep, 2:], time_s[reset]) if len(keep) else None


def _tuning(vehicle: int, told: tuple[Floats, Messages], asked: tuple[Floats, Messages]) -> tuple[ParameterValue, ...]:
    """The gains over time, as the vehicle told them and as they were set; the first told was so before."""
    values = []
    for first, (time_s, each) in ((True, told), (False, asked)):
        for at_s, row in zip(time_s.tolist(), each.rows, strict=True):
            name, value = bytes(row["param_id"]).decode("ascii", "replace"), float(row["param_value"])
            mine = first or int(row["target_system"]) in {0, vehicle}
            if name in GAINS and mine and np.isfinite(value):
                values.append((at_s, first, name, value))
    seen: set[str] = set()
    changes = []
    for at_s, said_so, name, value in sorted(values):
        changes.append(ParameterValue(-np.inf if said_so and name not in seen else at_s, name, value))
        seen.add(name)
    return tuple(changes)
