"""What a plain PX4 ULog holds: position, attitude and their set-points, the estimator's ratios, modes.

Source: PX4 `msg/` (VehicleLocalPosition, VehicleLocalPositionSetpoint, VehicleAttitude, VehicleAttitudeSetpoint,
EstimatorStatus, VehicleStatus).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from companion.errors import CompanionError
from companion.identify.reading import ulog_file
from companion.identify.reading.ulog_topics import UlogTopics
from companion.report.guards import directions
from companion.report.model import MEASURED, REFERENCE, WANTED, Array, Happened, Limit, Panel, Path3, Report, Series

_LOCAL, _WANTED_AT, _ATTITUDE = "vehicle_local_position", "vehicle_local_position_setpoint", "vehicle_attitude"
_SETPOINT, _ESTIMATOR, _STATUS = "vehicle_attitude_setpoint", "estimator_status", "vehicle_status"
_TOPICS = frozenset((_LOCAL, _WANTED_AT, _ATTITUDE, _SETPOINT, _ESTIMATOR, _STATUS))
_RATIOS = (("vel_test_ratio", MEASURED), ("pos_test_ratio", WANTED), ("hgt_test_ratio", REFERENCE))
_MODES = {
    0: "Manual", 1: "Altitude", 2: "Position", 3: "Mission", 4: "Hold", 5: "Return", 10: "Acro", 12: "Descend",
    13: "Termination", 14: "Offboard", 15: "Stabilized", 17: "Takeoff", 18: "Land", 22: "VTOL take-off",
}  # fmt: skip
_OURS = "a PX4 log holds nothing of our controller: no reference, weights, hedge deficit, guards or link"


class UnreadableError(CompanionError):
    """No ULog, or one with nothing to draw."""


def read(path: Path) -> Report:
    """Report on a ULog. Raises `CompanionError` with one line."""
    try:
        file = ulog_file.read(path.read_bytes(), _TOPICS)
    except OSError as error:
        raise UnreadableError(f"{path}: {error.strerror}") from None
    except ulog_file.UlogError as error:
        raise UnreadableError(f"{path}: not a readable ULog: {error}") from None
    missing = [_OURS]
    log = UlogTopics(path, file, missing)
    missing += [f"not logged: {topic}" for topic in sorted(_TOPICS) if topic not in log]
    if _LOCAL not in log and _ATTITUDE not in log:
        raise UnreadableError(f"{path}: neither {_LOCAL} nor {_ATTITUDE} in it: nothing to draw")
    zero_s = float(log.times(_ATTITUDE if _ATTITUDE in log else _LOCAL)[0])
    panels, path3 = list[Panel](), None
    if log.has(_LOCAL, "x", "y", "z"):
        t, at = log.times(_LOCAL) - zero_s, _vector(log, _LOCAL, "xyz")
        wanted = _wanted(log, zero_s, t)
        for axis, (key, title, sign) in enumerate((("north", "North", 1), ("east", "East", 1), ("up", "Height", -1))):
            lines = [Series("measured", MEASURED, sign * at[:, axis])]
            if np.isfinite(wanted[:, axis]).any():
                lines.append(Series("set-point of PX4's position control", WANTED, sign * wanted[:, axis]))
            panels.append(Panel(f"position-{key}", f"{title}: position and set-point", "m", t, tuple(lines)))
        path3 = _path(log, zero_s, t, at, wanted)
    panels += _attitude(log, zero_s)
    if log.has(_ESTIMATOR, *(name for name, _ in _RATIOS)):
        lines = [Series(name, role, log.column(_ESTIMATOR, name)) for name, role in _RATIOS]
        title = "Estimator: innovation test ratios (above 1 it refuses the sensor)"
        limit = (Limit("refused", 1.0),)
        panels.append(Panel("ratios", title, "1", log.times(_ESTIMATOR) - zero_s, tuple(lines), limit))
    events = _events(log, zero_s)
    last_s = max(float(panel.time_s[-1]) for panel in panels if len(panel.time_s))
    verdict = (
        ("Why it ended", ("A PX4 log does not say why our control ended; its changes of mode are in the table.",)),
        ("What to look at", tuple(f"{e.time_s:.1f} s: {e.detail}" for e in events[-5:]) or ("No change of mode.",)),
        ("Missing", tuple(missing)),
    )
    facts = (("length of the log", last_s, "s"),)
    return Report(
        path.name, "PX4 ULog", verdict, facts, tuple(panels), path3, events, (), tuple(missing), "the log's beginning"
    )


def _vector(log: UlogTopics, topic: str, fields: str) -> Array:
    return np.stack([log.column(topic, field).astype(float) for field in fields], axis=1)


def _wanted(log: UlogTopics, zero_s: float, t: Array) -> Array:
    """Position set-points, held, at the times of the measured position; NaN where there is none."""
    if not log.has(_WANTED_AT, "x", "y", "z"):
        return np.full((len(t), 3), np.nan)
    given_s, given = log.times(_WANTED_AT) - zero_s, _vector(log, _WANTED_AT, "xyz")
    at = np.searchsorted(given_s, t, side="right") - 1
    stale = (at < 0) | (t - given_s[np.maximum(at, 0)] > 1.0)
    return np.where(stale[:, None], np.nan, given[np.maximum(at, 0)])


def _path(log: UlogTopics, zero_s: float, t: Array, at: Array, wanted: Array) -> Path3:
    keep = np.unique(np.linspace(0, len(t) - 1, 1500).astype(int))
    up = np.tile([0.0, 0.0, -1.0], (len(keep), 1))
    if log.has(_ATTITUDE, "q"):
        q_s, q, _ = log.rotations(_ATTITUDE, "q")
        up = directions(q[np.clip(np.searchsorted(q_s - zero_s, t[keep]), 0, len(q) - 1)])
    return Path3(t[keep], at[keep], wanted[keep], up)


def _attitude(log: UlogTopics, zero_s: float) -> list[Panel]:
    """Roll, pitch and yaw, measured and wanted."""
    if not log.has(_ATTITUDE, "q"):
        return []
    q_s, q, _ = log.rotations(_ATTITUDE, "q")
    angles = _euler_deg(q.astype(float))
    wanted = np.full((len(q_s), 3), np.nan)
    if log.has(_SETPOINT, "q_d"):
        set_s, set_q, _ = log.rotations(_SETPOINT, "q_d")
        if len(set_s):
            at = np.searchsorted(set_s, q_s, side="right") - 1
            held = _euler_deg(set_q.astype(float))[np.maximum(at, 0)]
            wanted = np.where((at < 0)[:, None] | (q_s - set_s[np.maximum(at, 0)] > 1.0)[:, None], np.nan, held)
    found = []
    for axis, (key, title) in enumerate((("y", "Roll"), ("x", "Pitch"), ("yaw", "Yaw"))):
        lines = (Series("measured", MEASURED, angles[:, axis]), Series("set-point", WANTED, wanted[:, axis]))
        found.append(Panel(f"attitude-{key}", f"{title}: attitude and set-point", "°", q_s - zero_s, lines))
    return found


def _euler_deg(q: Array) -> Array:
    w, x, y, z = q.T
    roll = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2 * (w * y - z * x), -1, 1))
    yaw = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    angles_deg: Array = np.degrees(np.stack([roll, pitch, yaw], axis=1))
    return angles_deg


def _events(log: UlogTopics, zero_s: float) -> tuple[Happened, ...]:
    if not log.has(_STATUS, "nav_state", "arming_state"):
        return ()
    t, mode, armed = log.times(_STATUS) - zero_s, log.column(_STATUS, "nav_state"), log.column(_STATUS, "arming_state")
    found = []
    for i in range(len(t)):
        if i == 0 or mode[i] != mode[i - 1]:
            found.append(Happened(float(t[i]), "mode", f"mode {_MODES.get(int(mode[i]), int(mode[i]))}"))
        if i and armed[i] != armed[i - 1]:
            found.append(Happened(float(t[i]), "arming", "armed" if armed[i] == 2 else "disarmed"))
    return tuple(found)
