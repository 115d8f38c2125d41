"""What the ticks do not hold, from `traffic.tlog`: what the estimator says of itself, and how late the link is.

A walk over the records by their lengths: the file is our own writer's, and half an hour of it is a million frames.
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pymavlink.dialects.v20 import development as mavlink

from companion.mavlink.codec import INCOMPAT_SIGNED, MAGIC_V2, Layout
from companion.report.model import Array

_AUTOPILOT = 1  # component id
_MOST = 20_000  # odometry messages unpacked for their variances
_ODOMETRY, _TIMESYNC, _STATUS, _TEXT = (
    mavlink.MAVLINK_MSG_ID_ODOMETRY,
    mavlink.MAVLINK_MSG_ID_TIMESYNC,
    mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS,
    mavlink.MAVLINK_MSG_ID_STATUSTEXT,
)
_WANTED = frozenset((_ODOMETRY, _TIMESYNC, _STATUS, _TEXT))
_VARIANCES = (0, 6, 11)  # of x, y and z in the upper triangle of a 6 x 6 covariance


class Traffic(NamedTuple):
    """Times are our clock's, s. Variances of north, east and down, m²; lateness over the least, s; (n,) each."""

    variance_s: Array
    variance_m2: Array
    arrival_s: Array
    lateness_s: Array
    trip_at_s: Array
    trip_s: Array
    status_s: Array
    ratios: Array  # velocity, horizontal and vertical position, (n, 3)
    texts: list[tuple[float, str]]


def read(path: Path, system_id: int) -> Traffic:
    """Read to the first record that is not whole. Raises `OSError`."""
    said: dict[int, list[tuple[float, bytes]]] = {number: [] for number in _WANTED}
    data = path.read_bytes()
    at, end, unpack_time = 0, len(data), struct.Struct(">Q").unpack_from
    while at + 20 <= end and data[at + 8] == MAGIC_V2:
        length = data[at + 9]
        number = data[at + 15] | data[at + 16] << 8 | data[at + 17] << 16
        if number in _WANTED and data[at + 13] == system_id and data[at + 14] == _AUTOPILOT:
            (time_us,) = unpack_time(data, at)
            said[number].append((time_us * 1e-6, data[at + 18 : at + 18 + length]))
        at += length + (33 if data[at + 10] & INCOMPAT_SIGNED else 20)
    layout = Layout("ODOMETRY")
    stamp, place = layout.index("time_usec"), layout.place("pose_covariance")
    assert isinstance(place, slice)
    poses = [(heard_s, layout.unpack(payload)) for heard_s, payload in said[_ODOMETRY][:: _every(said[_ODOMETRY])]]
    arrival = np.array([heard_s for heard_s, _ in poses])
    lag = arrival - np.array([values[stamp] for _, values in poses]) * 1e-6
    variance = [max(values[place.start + i] for i in _VARIANCES) for _, values in poses]
    trips = _trips(said[_TIMESYNC])
    ratios, status_s = _ratios(said[_STATUS])
    return Traffic(
        arrival, np.array(variance), arrival, lag - (lag.min() if len(lag) else 0.0), trips[:, 0], trips[:, 1],
        status_s, ratios, _texts(said[_TEXT]),
    )  # fmt: skip


def _every(messages: list[Any]) -> int:
    return max(1, len(messages) // _MOST)


def _trips(messages: list[tuple[float, bytes]]) -> Array:
    """(when answered, round trip): answers carry our time in `ts1`; times far from ours are requests of the vehicle."""
    layout = Layout("TIMESYNC")
    theirs, ours = layout.index("tc1"), layout.index("ts1")
    unpacked = [(heard_s, layout.unpack(payload)) for heard_s, payload in messages]
    answers = np.array([(heard_s, values[ours] * 1e-9) for heard_s, values in unpacked if values[theirs]])
    if not len(answers):
        return np.empty((0, 2))
    trips = answers[:, 0] - answers[:, 1]  # our clocks differ by a constant: wall time here, monotonic there
    return np.stack([answers[:, 0], trips - trips.min()], axis=1)


def _ratios(messages: list[tuple[float, bytes]]) -> tuple[Array, Array]:
    layout = Layout("ESTIMATOR_STATUS")
    places = [layout.index(f"{name}_ratio") for name in ("vel", "pos_horiz", "pos_vert")]
    unpacked = [layout.unpack(payload) for _, payload in messages]
    values = np.array([[said[place] for place in places] for said in unpacked]).reshape(-1, 3)
    return values, np.array([heard_s for heard_s, _ in messages])


def _texts(messages: list[tuple[float, bytes]]) -> list[tuple[float, str]]:
    return [
        (heard_s, payload[1:51].split(b"\0")[0].decode("utf-8", "replace")) for heard_s, payload in messages if payload
    ]
