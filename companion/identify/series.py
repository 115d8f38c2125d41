"""What a log says about attitude, whatever its format: set-points and attitude as roll and pitch over time."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from companion.errors import CompanionError

Floats = npt.NDArray[np.float64]

AXES: Final = ("roll", "pitch")  # columns of every angle array here
VEHICLE: Final = "vehicle"
OURS: Final = "ours"


class LogError(CompanionError):
    """A log that no response can be identified from; the message is one line that says what to do."""


class Track(NamedTuple):
    """Set-points and attitude in one clock.

    Attributes
    ----------
    clock
        `OURS`: a set-point counts from when it was sent and an attitude from when it was received, so the link is in
        between. `VEHICLE`: both as the autopilot stamped them.
    setpoint_time_s, setpoint_rad
        Shape (n,) and (n, 2): a set-point holds from its time to the next one's.
    attitude_time_s, attitude_rad
        Shape (m,) and (m, 2).
    """

    clock: str
    setpoint_time_s: Floats
    setpoint_rad: Floats
    attitude_time_s: Floats
    attitude_rad: Floats


class Estimate(NamedTuple):
    """What the estimator said of the horizontal state, in its own clock.

    Attributes
    ----------
    time_s
        Shape (n,), rising.
    position_m, velocity_m_s
        Shape (n, 2), north and east.
    """

    time_s: Floats
    position_m: Floats
    velocity_m_s: Floats


class ClockMap(NamedTuple):
    """Our clock to the vehicle's by matched set-points: sent then, in force then. Knots, shape (k,) each."""

    ours_s: Floats
    vehicle_s: Floats


class Recording(NamedTuple):
    """One log.

    Attributes
    ----------
    path, kind, system_id
        File, "ULog", "tlog" or "flight record", and the vehicle's MAVLink system id.
    track
        Set-points and attitude in the log's first clock: ours where it has it, else the vehicle's.
    following
        Shape (k, 2): from when to when the vehicle was armed and followed a stream of attitude set-points (OFFBOARD), s
        in the track's clock.
    setpoint_q
        Shape (n, 4), float32: the set-points as quaternions, by which the same flight is recognised in another log.
    lateness_s
        How much earlier than logged a set-point may have been in force: the period of a log that keeps only every
        so-manieth; zero where all are there.
    saturated_s
        Shape (j,): times at which an actuator or the thrust was at its limit.
    stamps_s
        Shape (m,): the vehicle's time of each attitude of the track.
    applied
        Our clock to the vehicle's, where the log carries the set-points that the vehicle had in force.
    gains
        Parameters of the attitude loop as logged.
    estimate
        None where the log does not have it.
    px4_version
        The vehicle's, as "1.17"; None where the log does not tell.
    in_flight
        Shape (k, 2): from when to when the vehicle was in the air and followed attitude set-points, whoever made them:
        a companion, sticks, or its own position controller. None where `following` is all that the log tells.
    """

    path: Path
    kind: str
    system_id: int
    track: Track
    following: Floats
    setpoint_q: npt.NDArray[np.float32]
    lateness_s: float
    saturated_s: Floats
    stamps_s: Floats
    applied: ClockMap | None
    gains: dict[str, float]
    estimate: Estimate | None = None
    px4_version: str | None = None
    in_flight: Floats | None = None


def angles(q_wxyz: npt.NDArray[Any]) -> Floats:
    """Roll and pitch in rad, shape (n, 2), of quaternions body to NED, shape (n, 4)."""
    w, x, y, z = q_wxyz.astype(np.float64).T
    roll = np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0))
    return np.stack([roll, pitch], axis=1)


def ordered(path: Path, time_s: Floats, what: str, tolerance_s: float) -> npt.NDArray[np.intp]:
    """Indices that leave a rising time; samples late by less than the tolerance are dropped.

    Raises `LogError` for a clock that goes back by more.
    """
    highest = np.maximum.accumulate(time_s)
    back = highest - time_s
    if back.size and back.max() > tolerance_s:
        at = int(np.argmax(back > tolerance_s))
        raise LogError(
            f"{path}: the clock goes backwards: {what} falls by {back[at]:.3g} s after {highest[at]:.3f} s "
            "(a reboot or a stepped clock): fly again without one"
        )
    return np.flatnonzero(np.diff(highest, prepend=-np.inf) > 0.0)


def spans(time_s: Floats, holds: npt.NDArray[np.bool_], end_s: float) -> Floats:
    """From when to when a reported condition held, shape (k, 2): from its first report to the first that denies it."""
    edges = np.flatnonzero(np.diff(holds.astype(np.int8), prepend=0, append=0))
    after = np.append(time_s, end_s)
    return np.array([[time_s[a], after[b]] for a, b in zip(edges[::2], edges[1::2], strict=True)]).reshape(-1, 2)


def intersect(left: Floats, right: Floats) -> Floats:
    """What two sets of spans have in common, shape (k, 2)."""
    common = [(max(a, c), min(b, d)) for a, b in left for c, d in right if min(b, d) > max(a, c)]
    return np.array(common).reshape(-1, 2)
