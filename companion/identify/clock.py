"""Our clock against the vehicle's, from set-points that are in both logs, bit for bit.

A set-point's quaternion crosses the link unchanged (PX4 `mavlink_receiver.cpp` copies it to vehicle_attitude_setpoint,
`streams/ATTITUDE_TARGET.hpp` copies it back), so one that was sent once and reported in force once pairs both clocks,
the way up included.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import numpy.typing as npt

from companion.identify.series import VEHICLE, ClockMap, Floats, Recording, Track

FEWEST_MATCHES: Final = 30
_BIN_S: Final = 5.0
_OUTLIER_S: Final = 0.05


def match(
    sent_s: Floats, sent_q: npt.NDArray[np.float32], applied_s: Floats, applied_q: npt.NDArray[np.float32]
) -> ClockMap | None:
    """The map from when a set-point was sent to when it was in force, or None where too few can be told apart.

    Parameters
    ----------
    sent_s, sent_q
        Shape (n,) and (n, 4): our clock and the quaternions sent.
    applied_s, applied_q
        Shape (m,) and (m, 4): the vehicle's clock and the quaternions in force.
    """
    sent_at, applied_at = _once(sent_q), _once(applied_q)
    pairs = np.array([(sent_s[i], applied_s[applied_at[key]]) for key, i in sent_at.items() if key in applied_at])
    if len(pairs) < FEWEST_MATCHES:
        return None
    ours, vehicle = pairs[np.argsort(pairs[:, 0])].T
    line = np.polyfit(ours - ours[0], vehicle, 1)
    rest = vehicle - np.polyval(line, ours - ours[0])
    keep = np.abs(rest - np.median(rest)) < _OUTLIER_S
    if keep.sum() < FEWEST_MATCHES:
        return None
    line = np.polyfit(ours[keep] - ours[0], vehicle[keep], 1)
    rest = vehicle[keep] - np.polyval(line, ours[keep] - ours[0])
    number = ((ours[keep] - ours[0]) / _BIN_S).astype(int)
    knots = np.array([(ours[keep][number == k].mean(), rest[number == k].mean()) for k in np.unique(number)])
    ends = np.array([[knots[0, 0] - _FAR_S, knots[0, 1]], [knots[-1, 0] + _FAR_S, knots[-1, 1]]])
    at, correction = np.concatenate([ends[:1], knots, ends[1:]]).T
    return ClockMap(at, np.polyval(line, at - ours[0]) + correction)


_FAR_S: Final = 1e4


def _once(q: npt.NDArray[np.float32]) -> dict[Any, int]:
    """Bytes of each quaternion that occurs once, and where."""
    seen: dict[Any, int] = {}
    more: set[Any] = set()
    for i, row in enumerate(np.ascontiguousarray(q)):
        key = row.tobytes()
        if key in seen:
            more.add(key)
        seen[key] = i
    return {key: i for key, i in seen.items() if key not in more}


def to_vehicle(applied: ClockMap, ours_s: Floats) -> Floats:
    """When what was sent at these times was in force, in the vehicle's clock."""
    return np.interp(ours_s, applied.ours_s, applied.vehicle_s)


def vehicle_track(recording: Recording, applied: ClockMap, attitude: Recording | None = None) -> Track:
    """The vehicle's own view of a tlog: set-points from when they were in force, attitude as it stamped it.

    `attitude` is a ULog of the same flight, whose attitude is taken instead.
    """
    track = recording.track
    if attitude is None:
        time_s, keep = np.unique(recording.stamps_s, return_index=True)
        angles_rad = track.attitude_rad[keep]
    else:
        time_s, angles_rad = attitude.track.attitude_time_s, attitude.track.attitude_rad
    return Track(VEHICLE, to_vehicle(applied, track.setpoint_time_s), track.setpoint_rad, time_s, angles_rad)
