"""PX4 ULog: what the vehicle logged about its own attitude loop, in its own clock.

What can change in flight is read over time, and what is not logged is never taken for granted: a topic or a field
without which the set-points could be anybody's, or the vehicle anything, is named and the log refused.

Source: PX4 `msg/` (VehicleStatus, VehicleControlMode, OffboardControlMode, VehicleAttitudeSetpoint, VehicleAttitude,
VehicleLocalPosition, ControlAllocatorStatus, ActuatorMotors, FailsafeFlags), v1.11 to v1.18.
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Final

import numpy as np

from companion.identify.reading import tuning, ulog_file, ulog_state
from companion.identify.reading.ulog_file import UlogError, UlogFile
from companion.identify.reading.ulog_topics import UlogTopics
from companion.identify.series import (
    GAINS,
    VEHICLE,
    Estimate,
    Floats,
    LogError,
    ParameterValue,
    Recording,
    Track,
    angles,
    covered,
    intersect,
)
from companion.mavlink.logs.ulog import HEADER_BYTES

_SETPOINT, _ATTITUDE, _LOCAL = "vehicle_attitude_setpoint", "vehicle_attitude", "vehicle_local_position"
_ALLOCATOR, _MOTORS = "control_allocator_status", "actuator_motors"
TOPICS: Final = (_SETPOINT, _ATTITUDE, _LOCAL, _ALLOCATOR, _MOTORS, *ulog_state.TOPICS)
_RELEASE: Final = "ver_sw_release"
_AT_LIMIT: Final = 0.995


def read(path: Path) -> Recording:
    """Read a ULog to the end of what is whole. Raises `LogError`."""
    try:
        file = ulog_file.read(path.read_bytes(), frozenset(TOPICS))
    except UlogError as error:
        raise LogError(f"{path}: not a readable ULog: {error}") from None
    notes = _whole(path, file)
    log = UlogTopics(path, file, notes)
    for topic, what in ((_SETPOINT, "attitude set-points"), (_ATTITUDE, "attitude")):
        if topic not in log:
            raise LogError(f"{path}: no {what} ({topic}){_damaged(file)}: log them and fly doublets")
    time_s, q, places = log.rotations(_ATTITUDE, "q")
    if not len(time_s):
        raise LogError(f"{path}: no attitude: not one {_ATTITUDE}.q is a rotation")
    log.ends(float(time_s[-1]))
    setpoint_s, setpoint_q, _ = log.rotations(_SETPOINT, "q_d")
    followed = ulog_state.followed(path, log, float(time_s[-1]))
    pauses = intersect(covered(time_s), covered(setpoint_s)) if len(setpoint_s) else np.empty((0, 2))
    streamed = intersect(followed.streamed, pauses)
    changes = _tuning(file, time_s, places)
    saturated = _saturated(log, notes)
    return Recording(
        path,
        "ULog",
        _system_id(log, file),
        Track(VEHICLE, setpoint_s, angles(setpoint_q), time_s, angles(q)),
        streamed,
        setpoint_q.astype(np.float32),
        float(np.median(np.diff(setpoint_s))) if len(setpoint_s) > 1 else 0.0,
        saturated,
        time_s,
        None,
        tuning.at(changes, float(streamed[0, 0]) if len(streamed) else np.inf),
        _estimate(log),
        _px4_version(file),
        intersect(followed.in_flight, pauses),
        changes,
        tuple(notes),
    )


def _whole(path: Path, file: UlogFile) -> list[str]:
    """A line for whatever of the file is not read. Raises `LogError` where nothing is left."""
    if file.end <= HEADER_BYTES:
        raise LogError(f"{path}: truncated: nothing whole is behind its header: download it again")
    notes = []
    if file.holes:
        lost = sum(hole.stop - hole.start for hole in file.holes)
        notes.append(
            f"damaged at byte {file.holes[0].start} of {file.size}: {lost} bytes in {len(file.holes)} "
            f"place{'s' if len(file.holes) > 1 else ''} passed over"
        )
    rest = file.size - file.end
    if file.tail == "damaged":
        notes.append(f"damaged from byte {file.end} of {file.size} to its end: read up to there")
    elif file.tail:
        what = "its last message is cut short" if file.tail == "cut" else f"{rest} zeros"
        notes.append(f"the end is cut at byte {file.end} of {file.size} ({what}): read up to there")
    return notes


def _damaged(file: UlogFile) -> str:
    at = file.holes[0].start if file.holes else file.end
    return f", the file is damaged or cut at byte {at} of {file.size}" if file.holes or file.tail else ""


def _estimate(log: UlogTopics) -> Estimate | None:
    """What the estimator said of position and velocity where it called both valid; None where it was not logged."""
    if not log.has(_LOCAL, *_HORIZONTAL):
        return None
    state = np.stack([log.column(_LOCAL, field) for field in _HORIZONTAL], axis=1).astype(np.float64)
    good = np.isfinite(state).all(axis=1)
    for field in ("xy_valid", "v_xy_valid"):
        if log.has(_LOCAL, field):
            good &= log.column(_LOCAL, field).astype(bool)
    time_s = log.times(_LOCAL)
    counts = [log.column(_LOCAL, field) for field in _RESETS if log.has(_LOCAL, field)]
    reset = np.flatnonzero(sum((np.diff(count) != 0 for count in counts), np.zeros(max(len(time_s) - 1, 0), bool))) + 1
    return Estimate(time_s[good], state[good, :2], state[good, 2:], time_s[reset])


_HORIZONTAL: Final = ("x", "y", "vx", "vy")
_RESETS: Final = ("xy_reset_counter", "vxy_reset_counter")


def _tuning(file: UlogFile, time_s: Floats, places: ulog_file.Array) -> tuple[ParameterValue, ...]:
    """The gains over time: a parameter has no time of its own, the attitude written before it has."""
    found = []
    for parameter in file.parameters:
        if parameter.name in GAINS:
            before = int(np.searchsorted(places, parameter.place)) - 1
            at_s = float(time_s[before]) if before >= 0 else -np.inf
            found.append(ParameterValue(at_s, parameter.name, parameter.value))
    return tuple(found)


def _px4_version(file: UlogFile) -> str | None:
    """Major and minor of the autopilot's software."""
    value = file.information.get(_RELEASE, b"")
    if len(value) != 4:
        return None
    (release,) = struct.unpack("<I", value)
    return f"{release >> 24}.{release >> 16 & 0xFF}" if release else None


def _system_id(log: UlogTopics, file: UlogFile) -> int:
    if log.has("vehicle_status", "system_id"):
        return int(log.column("vehicle_status", "system_id")[-1])
    return next((int(p.value) for p in reversed(file.parameters) if p.name == "MAV_SYS_ID"), 1)


def _saturated(log: UlogTopics, notes: list[str]) -> Floats:
    """Times at which the mixer could not give the torque asked for, or a motor stood at its upper limit."""
    times = [np.empty(0)]
    if log.has(_ALLOCATOR, "torque_setpoint_achieved"):
        achieved = log.column(_ALLOCATOR, "torque_setpoint_achieved").astype(bool)
        times.append(log.times(_ALLOCATOR)[~achieved])
    if log.has(_MOTORS, "control"):
        controls = log.column(_MOTORS, "control", None).reshape(len(log.times(_MOTORS)), -1)
        highest = np.where(np.isfinite(controls), controls, -1.0).max(axis=1)
        times.append(log.times(_MOTORS)[highest >= _AT_LIMIT])
    if len(times) == 1:
        notes.append(
            f"whether an actuator was at its limit is not told: no {_ALLOCATOR}.torque_setpoint_achieved and no "
            f"{_MOTORS}.control in it"
        )
    return np.sort(np.concatenate(times))
