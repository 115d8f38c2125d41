"""PX4 ULog: what the vehicle logged about its own attitude loop, in its own clock.

Source: https://docs.px4.io/main/en/dev_log/ulog_file_format and PX4 `msg/` (VehicleStatus, VehicleControlMode,
OffboardControlMode, VehicleAttitudeSetpoint, VehicleAttitude, VehicleLocalPosition, ControlAllocatorStatus,
ActuatorMotors).
"""

from __future__ import annotations

import contextlib
import io
import struct
from pathlib import Path
from typing import Any, Final

import numpy as np
from pyulog import ULog

from companion.identify.series import (
    VEHICLE,
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

MAGIC: Final = b"ULog\x01\x12\x35"
_HEADER_BYTES: Final = 16
_MESSAGE: Final = struct.Struct("<HB")
_FLAG_BITS: Final = ord("B")
_APPENDED: Final = 0x01

TOPICS: Final = (
    "vehicle_attitude_setpoint",
    "vehicle_attitude",
    "vehicle_status",
    "vehicle_control_mode",
    "offboard_control_mode",
    "control_allocator_status",
    "actuator_motors",
    "vehicle_local_position",
    "vehicle_land_detected",
    "autotune_attitude_control_status",
)
GAINS: Final = (
    "MC_ROLL_P", "MC_PITCH_P", "MC_ROLLRATE_P", "MC_PITCHRATE_P", "MC_ROLLRATE_K", "MC_PITCHRATE_K",
    "MC_REF_W_N", "MC_REF_FF", "MC_REF_FF_MAX",  # from PX4 v1.18
)  # fmt: skip
_RELEASE: Final = "ver_sw_release"
_ARMED: Final = 2  # VehicleStatus.ARMING_STATE_ARMED
_OFFBOARD: Final = 14  # VehicleStatus.NAVIGATION_STATE_OFFBOARD
_STREAMED: Final = (_OFFBOARD,)
_FLOWN: Final = (_OFFBOARD, 0, 15, 1, 2, 6, 3, 4, 5, 19, 21)
"""With Manual, Stabilized, Altitude, Position, slow Position, all by sticks; Mission, Hold, Return, Follow, Orbit."""
_NEAR_GROUND_S: Final = 2.0
_AT_LIMIT: Final = 0.995
_CLOCK_TOLERANCE_S: Final = 0.0


def read(path: Path) -> Recording:
    """Read a ULog. Raises `LogError`."""
    data = path.read_bytes()
    _check_whole(path, data)
    log = _parse(path, data)
    setpoints, attitude = _topic(log, "vehicle_attitude_setpoint"), _topic(log, "vehicle_attitude")
    if setpoints is None:
        raise LogError(f"{path}: no attitude set-points (vehicle_attitude_setpoint): log them and fly doublets")
    if attitude is None:
        raise LogError(f"{path}: no attitude (vehicle_attitude): log it and fly doublets")
    time_s, keep = _times(path, attitude, "vehicle_attitude")
    setpoint_s, kept = _times(path, setpoints, "vehicle_attitude_setpoint")
    q = _vector(setpoints, "q_d", 4)[kept].astype(np.float32)
    track = Track(VEHICLE, setpoint_s, angles(q), time_s, angles(_vector(attitude, "q", 4)[keep]))
    parameters: dict[str, Any] = log.initial_parameters
    return Recording(
        path,
        "ULog",
        _system_id(log, parameters),
        track,
        _following(path, log, time_s[-1]),
        q,
        float(np.median(np.diff(setpoint_s))) if len(setpoint_s) > 1 else 0.0,
        _saturated(log),
        time_s,
        None,
        {name: float(parameters[name]) for name in GAINS if name in parameters},
        _estimate(path, log),
        _px4_version(log),
        _in_flight(path, log, time_s[-1]),
    )


def _estimate(path: Path, log: ULog) -> Estimate | None:
    """What the estimator said of position and velocity; None where it was not logged."""
    local = _topic(log, "vehicle_local_position")
    if local is None:
        return None
    time_s, keep = _times(path, local, "vehicle_local_position")
    position, velocity = (np.stack([local[f] for f in pair], axis=1)[keep] for pair in (("x", "y"), ("vx", "vy")))
    return Estimate(time_s, position.astype(np.float64), velocity.astype(np.float64))


def _check_whole(path: Path, data: bytes) -> None:
    """Walk the message headers: the last message must end where the file does."""
    at, total = _HEADER_BYTES, len(data)
    while at + _MESSAGE.size <= total:
        size, kind = _MESSAGE.unpack_from(data, at)
        if kind == _FLAG_BITS and size > 8 and data[at + _MESSAGE.size + 8] & _APPENDED:
            return  # a crash dump was appended: what stands before it may end anywhere
        at += _MESSAGE.size + size
    if at != total or total <= _HEADER_BYTES:
        raise LogError(f"{path}: truncated: it ends inside a message, at byte {total}: download it again")


def _parse(path: Path, data: bytes) -> ULog:
    try:
        with contextlib.redirect_stdout(io.StringIO()):  # it prints what it finds corrupt
            log = ULog(io.BytesIO(data), list(TOPICS), disable_str_exceptions=True)
    except Exception as error:  # whatever a damaged file makes the parser raise
        raise LogError(f"{path}: not a readable ULog ({type(error).__name__}: {str(error)[:60]})") from None
    if log.file_corruption:
        raise LogError(f"{path}: damaged: some of its messages cannot be read: download it again")
    return log


def _topic(log: ULog, name: str) -> dict[str, Any] | None:
    """Fields of the first instance of a topic, or None where it was not logged."""
    found = [d for d in log.data_list if d.name == name and len(d.data["timestamp"])]
    return min(found, key=lambda d: d.multi_id).data if found else None


def _times(path: Path, topic: dict[str, Any], name: str) -> tuple[Floats, Any]:
    """Rising times of publication in s and the indices of the samples they belong to."""
    time_s = topic["timestamp"].astype(np.float64) * 1e-6
    keep = ordered(path, time_s, name, _CLOCK_TOLERANCE_S)
    return time_s[keep], keep


def _vector(topic: dict[str, Any], field: str, size: int) -> Floats:
    return np.stack([topic[f"{field}[{i}]"] for i in range(size)], axis=1).astype(np.float64)


def _px4_version(log: ULog) -> str | None:
    """Major and minor of the autopilot's software."""
    release = log.msg_info_dict.get(_RELEASE)
    return f"{release >> 24 & 0xFF}.{release >> 16 & 0xFF}" if isinstance(release, int) and release else None


def _system_id(log: ULog, parameters: dict[str, Any]) -> int:
    status = _topic(log, "vehicle_status")
    if status is not None and "system_id" in status:
        return int(status["system_id"][-1])
    return int(parameters.get("MAV_SYS_ID", 1))


def _following(path: Path, log: ULog, end_s: float) -> Floats:
    """When the vehicle was armed and followed a stream of attitude set-points from outside."""
    return _controlled(path, log, end_s, _STREAMED)


def _in_flight(path: Path, log: ULog, end_s: float) -> Floats:
    """When it was off the ground and controlled attitude, whoever made the set-points; nothing where it does not tell.

    While PX4 tunes itself it adds rates to what the attitude loop wants: that is no answer to the set-point.
    """
    landed, control = _topic(log, "vehicle_land_detected"), _topic(log, "vehicle_control_mode")
    if landed is None or "landed" not in landed or control is None or "flag_control_attitude_enabled" not in control:
        return np.empty((0, 2))
    time_s, keep = _times(path, landed, "vehicle_land_detected")
    touching = np.zeros(len(keep), dtype=bool)
    for field in ("landed", "maybe_landed", "ground_contact"):
        if field in landed:
            touching |= landed[field][keep].astype(bool)
    off = spans(time_s, ~touching, end_s) + np.array([_NEAR_GROUND_S, -_NEAR_GROUND_S])
    flown = intersect(_controlled(path, log, end_s, _FLOWN), off)
    tuning = _topic(log, "autotune_attitude_control_status")
    if tuning is not None and "state" in tuning:
        time_s, keep = _times(path, tuning, "autotune_attitude_control_status")
        for start, stop in spans(time_s, tuning["state"][keep] != 0, end_s):
            flown = intersect(flown, np.array([[-np.inf, start], [stop, np.inf]]))
    return flown


def _controlled(path: Path, log: ULog, end_s: float, modes: tuple[int, ...]) -> Floats:
    """When the vehicle was armed, in one of some modes, and controlled attitude; not in OFFBOARD by position."""
    status = _topic(log, "vehicle_status")
    if status is None:
        raise LogError(f"{path}: no vehicle_status: it cannot be told when the vehicle followed set-points: log it")
    time_s, keep = _times(path, status, "vehicle_status")
    armed = status["arming_state"][keep] == _ARMED
    followed = spans(time_s, armed & np.isin(status["nav_state"][keep], modes), end_s)
    control = _topic(log, "vehicle_control_mode")
    if control is not None and "flag_control_attitude_enabled" in control:
        time_s, keep = _times(path, control, "vehicle_control_mode")
        enabled = control["flag_control_attitude_enabled"][keep].astype(bool)
        followed = intersect(followed, spans(time_s, enabled, end_s))
    offboard = _topic(log, "offboard_control_mode")
    if offboard is not None and "attitude" in offboard:
        asked_s, kept = _times(path, offboard, "offboard_control_mode")
        others = spans(asked_s, ~offboard["attitude"][kept].astype(bool), end_s)
        status_s, keep = _times(path, status, "vehicle_status")
        by_others = intersect(spans(status_s, status["nav_state"][keep] == _OFFBOARD, end_s), others)
        for start, stop in by_others:  # by position or velocity: PX4's own controller makes the set-points
            outside = np.array([[-np.inf, start], [stop, np.inf]])
            followed = intersect(followed, outside)
    return followed


def _saturated(log: ULog) -> Floats:
    """Times at which the mixer could not give the torque asked for, or a motor stood at its upper limit."""
    times: list[Floats] = []
    allocator = _topic(log, "control_allocator_status")
    if allocator is not None and "torque_setpoint_achieved" in allocator:
        times.append(allocator["timestamp"][~allocator["torque_setpoint_achieved"].astype(bool)] * 1e-6)
    motors = _topic(log, "actuator_motors")
    if motors is not None:
        controls = np.stack([motors[f"control[{i}]"] for i in range(12) if f"control[{i}]" in motors], axis=1)
        highest = np.nanmax(np.where(np.isfinite(controls), controls, -1.0), axis=1)
        times.append(motors["timestamp"][highest >= _AT_LIMIT] * 1e-6)
    return np.sort(np.concatenate(times)) if times else np.empty(0)
