"""Read a log of any kind: PX4 ULog, tlog, or one of our own flight folders."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from companion.identify import traffic, ulog
from companion.identify.reading.samples import rotations
from companion.identify.series import (
    VEHICLE,
    LogError,
    Recording,
    Track,
    angles,
    covered,
    intersect,
    ordered,
    spans,
)
from companion.mavlink.logs.ulog import MAGIC
from companion.record.reader import read_flight

_KINDS: Final = "a ULog (.ulg), a tlog or a flight folder"


def read_log(path: Path, system_id: int | None = None) -> Recording:
    """Read one log, its kind told by its first bytes.

    Parameters
    ----------
    path
        File or flight folder.
    system_id
        The vehicle's MAVLink system id, where it is known.

    Raises
    ------
    LogError
        One line, for a log that nothing can be identified from.
    """
    try:
        if path.is_dir():
            return _read_folder(path, system_id)
        with path.open("rb") as stream:
            head = stream.read(16)
        recording = _read_file(path, head, system_id)
    except FileNotFoundError:
        raise LogError(f"{path}: no such file") from None
    except OSError as error:
        raise LogError(f"{path}: {error.strerror}") from None
    return _checked(recording, system_id)


def _read_file(path: Path, head: bytes, system_id: int | None) -> Recording:
    if not head:
        raise LogError(f"{path}: empty: {_KINDS} is wanted")
    if head.startswith(MAGIC):
        return ulog.read(path)
    if traffic.looks_like(head):
        return traffic.read(path, system_id)
    raise LogError(f"{path}: not a log: {_KINDS} is wanted")


def _read_folder(folder: Path, system_id: int | None) -> Recording:
    """The folder's traffic, which has both ends of the link; without it or with nothing in it, its flight record."""
    tlog, record = folder / "traffic.tlog", folder / "flight.mcap"
    if tlog.exists() and (tlog.stat().st_size or not record.exists()):
        recording = _read_file(tlog, tlog.read_bytes()[:16], system_id)
        return _checked(recording, system_id)
    if record.exists():
        return _checked(_read_record(folder, system_id), system_id)
    raise LogError(f"{folder}: not a flight folder: neither traffic.tlog nor flight.mcap in it")


def _read_record(folder: Path, system_id: int | None) -> Recording:
    """`flight.mcap`: one row a tick, attitude and the set-point that answered it, in the vehicle's clock."""
    path = folder / "flight.mcap"
    try:
        flight = read_flight(folder)
    except ValueError as error:
        raise LogError(str(error)) from None
    if not len(flight.ticks):
        raise LogError(f"{path}: empty: no tick was recorded: fly with companion run")
    notes = list(flight.notes)
    time_s = flight.ticks["time_s"].astype(float)
    keep = ordered(path, time_s, "time_s", notes)
    ticks, time_s = flight.ticks[keep], time_s[keep]
    known = rotations(ticks["attitude_q_wxyz"])
    sent = rotations(ticks["setpoint_q_wxyz"])
    if not (known & sent).any():
        raise LogError(f"{path}: no set-points in it: fly doublets in OFFBOARD")
    q = ticks["setpoint_q_wxyz"][sent].astype(np.float32)
    stamps_s = time_s[known]
    track = Track(
        VEHICLE,
        time_s[sent] + np.nan_to_num(ticks["latency_s"][sent]),
        angles(q),
        stamps_s,
        angles(ticks["attitude_q_wxyz"][known]),
    )
    # in control is where the reference model runs; NaN elsewhere
    following = spans(time_s, np.isfinite(ticks["ideal_position_m"][:, 0]), time_s[-1])
    following = intersect(following, intersect(covered(track.setpoint_time_s), covered(stamps_s)))
    return Recording(
        path, "flight record", system_id or 1, track, following, q, 0.0, np.empty(0), stamps_s, None, {},
        notes=tuple(notes),
    )  # fmt: skip


def _checked(recording: Recording, system_id: int | None) -> Recording:
    """Refuse what no format forbids: another vehicle, or one that never followed."""
    path, track = recording.path, recording.track
    if system_id is not None and recording.system_id != system_id:
        raise LogError(f"{path}: wrong vehicle: a log of system {recording.system_id}, wanted is {system_id}")
    if len(track.setpoint_time_s) < 2 or len(track.attitude_time_s) < 2:
        raise LogError(f"{path}: no set-points or no attitude to speak of: fly doublets in OFFBOARD")
    if not len(recording.following) and (recording.in_flight is None or not len(recording.in_flight)):
        raise LogError(
            f"{path}: the vehicle was never armed in a mode that follows attitude set-points: fly doublets in OFFBOARD"
        )
    return recording
