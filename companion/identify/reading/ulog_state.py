"""What a PX4 was doing over time, from its ULog: when a hovering multicopter followed attitude set-points, and whose.

Source: PX4 `msg/` of v1.11 to v1.18 and `src/modules/commander/ModeUtil/control_mode.cpp`.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from companion.identify.reading.ulog_topics import UlogTopics
from companion.identify.series import Floats, LogError, angles, intersect, outside, spans

Flags = npt.NDArray[np.bool_]

TOPICS: Final = (
    "vehicle_status",
    "vehicle_control_mode",
    "offboard_control_mode",
    "failsafe_flags",
    "vehicle_land_detected",
    "autotune_attitude_control_status",
)
_ARMED: Final = 2  # VehicleStatus.ARMING_STATE_ARMED
_OFFBOARD: Final = 14  # VehicleStatus.NAVIGATION_STATE_*
_MANUAL: Final = 0  # where PX4 stabilises a multicopter all the same
_STICKS: Final = (1, 8, 15)  # Altitude, Altitude Cruise, Stabilized
_OWN: Final = (2, 3, 4, 5, 6, 17, 19, 20, 21)  # Position, Mission, Hold, Return, Position Slow, Takeoff, Follow, ...
_ROTARY_WING: Final = 1  # VehicleStatus.VEHICLE_TYPE_*
_TYPES: Final = {0: "a vehicle of unknown type", 2: "a fixed wing", 3: "a rover", 4: "an airship"}
_FIRST_S: Final = 0.5  # by how much PX4's logger takes up a topic late that was published for the first time
_RESET_RAD: Final = np.radians(0.5)  # a reset of the attitude that turns it about the vertical alone is none
_TOPIC, _CONTROL, _ASKED = "vehicle_status", "vehicle_control_mode", "offboard_control_mode"
_LANDED, _ATTITUDE, _AUTOTUNE = "vehicle_land_detected", "vehicle_attitude", "autotune_attitude_control_status"
_TOUCHING: Final = ("landed", "maybe_landed", "ground_contact")
_NEAR_GROUND_S: Final = 2.0
_ENABLED: Final = tuple(f"flag_control_{what}_enabled" for what in ("attitude", "position", "velocity", "acceleration"))
_WANTED: Final = ("attitude", "position", "velocity", "acceleration")
_IGNORED: Final = ("ignore_attitude", "ignore_position", "ignore_velocity", "ignore_acceleration_force")  # v1.11


class Followed(NamedTuple):
    """When attitude set-points were followed, each of shape (k, 2), in s.

    Attributes
    ----------
    streamed
        They came over the link.
    in_flight
        Off the ground, whoever made them, the vehicle's own position controller too; not while PX4 tunes itself, which
        adds rates to what the attitude loop wants. Empty where the log does not tell what is on the ground.
    """

    streamed: Floats
    in_flight: Floats


class _Source(NamedTuple):
    """What one topic says of who makes the set-points: times, and at each whether from outside or by position."""

    time_s: Floats
    by_attitude: Flags
    by_position: Flags


def followed(path: Path, log: UlogTopics, end_s: float) -> Followed:
    """When a hovering multicopter followed attitude set-points. Raises `LogError` where that cannot be told."""
    time_s, nav_state = log.times(_TOPIC), log.column(_TOPIC, "nav_state")
    control, asked = _control(log), _asked(log)
    manual = (_MANUAL,) if control is not None else ()  # that it stabilises is told by the flags alone
    armed = log.column(_TOPIC, "arming_state") == _ARMED
    offboard, sticks, own = (
        spans(time_s, armed & np.isin(nav_state, states), end_s) for states in ((_OFFBOARD,), (*_STICKS, *manual), _OWN)
    )
    flown = armed & np.isin(nav_state, (_OFFBOARD, *_STICKS, *manual, *_OWN))
    healthy = intersect(_hovering(path, log, flown, end_s), _healthy(log, end_s))
    if len(offboard) and control is None and asked is None:
        raise LogError(
            f"{path}: neither {_ASKED}.attitude and .position nor {_CONTROL}.flag_control_position_enabled in it: "
            "whose the set-points were cannot be told without: log one of them"
        )
    by_attitude, said = offboard, [source for source in (control, asked) if source is not None]
    for source in said:
        by_attitude = intersect(by_attitude, spans(source.time_s, source.by_attitude, end_s))
    by_position = [intersect(offboard, spans(source.time_s, source.by_position, end_s)) for source in said]
    if not len(by_attitude) and not len(sticks) and _total(own) < max(map(_total, by_position), default=0.0):
        raise LogError(
            f"{path}: PX4's own position control made the set-points (OFFBOARD by position, velocity or acceleration), "
            "none came from outside: fly doublets with attitude set-points"
        )
    if control is not None:
        sticks = intersect(sticks, spans(control.time_s, control.by_attitude, end_s))
        own = intersect(own, spans(control.time_s, control.by_position, end_s))
    every = _union((by_attitude, sticks, own), healthy)
    return Followed(intersect(by_attitude, healthy), intersect(every, _off_ground(log, end_s)))


def _off_ground(log: UlogTopics, end_s: float) -> Floats:
    """When the vehicle was well off the ground and did not tune itself."""
    if not log.has(_LANDED, "landed"):
        return np.empty((0, 2))
    time_s = log.times(_LANDED)
    touching = np.zeros(len(time_s), bool)
    for field in _TOUCHING:
        if log.has(_LANDED, field):
            touching |= log.column(_LANDED, field).astype(bool)
    up = spans(time_s, ~touching, end_s)
    off = np.stack([up[:, 0] + _NEAR_GROUND_S, up[:, 1] - _NEAR_GROUND_S], axis=1)
    off = off[off[:, 1] > off[:, 0]]
    if log.has(_AUTOTUNE, "state"):
        off = intersect(off, outside(spans(log.times(_AUTOTUNE), log.column(_AUTOTUNE, "state") != 0, end_s)))
    return off


def _hovering(path: Path, log: UlogTopics, flown: Flags, end_s: float) -> Floats:
    """When the vehicle was a multicopter, or a VTOL that flew as one. Raises `LogError` when it never was in flight."""
    time_s = log.times(_TOPIC)
    if log.has(_TOPIC, "is_rotary_wing") and not log.has(_TOPIC, "vehicle_type"):  # up to v1.8
        kind = np.where(log.column(_TOPIC, "is_rotary_wing"), _ROTARY_WING, 2)
    else:
        kind = log.column(_TOPIC, "vehicle_type")
    if log.has(_TOPIC, "is_vtol") and not log.column(_TOPIC, "is_vtol").any():
        turning = np.zeros(len(time_s), bool)
    else:
        turning = log.column(_TOPIC, "in_transition_mode").astype(bool)
    hovering = (kind == _ROTARY_WING) & ~turning
    if flown.any() and not (flown & hovering).any():
        others = kind[flown & (kind != _ROTARY_WING)]
        what = _TYPES.get(int(others[0]), f"vehicle type {others[0]}") if len(others) else "a VTOL in transition"
        field = "vehicle_type" if len(others) else "in_transition_mode"
        raise LogError(f"{path}: {what} flew ({_TOPIC}.{field}): the response of a hovering multicopter is wanted")
    return spans(time_s, hovering, end_s)


def _control(log: UlogTopics) -> _Source | None:
    """By what was controlled; None where the topic does not tell."""
    if not log.has(_CONTROL, *_ENABLED):
        return None
    attitude, *higher = (log.column(_CONTROL, field).astype(bool) for field in _ENABLED)
    by_position = np.logical_or.reduce(higher)
    return _Source(_since(log.times(_CONTROL)), attitude & ~by_position, by_position)


def _asked(log: UlogTopics) -> _Source | None:
    """By what was asked for in OFFBOARD, in the words of today or of v1.11; None where the topic does not tell."""
    if log.has(_ASKED, *_WANTED):
        attitude, *higher = (log.column(_ASKED, field).astype(bool) for field in _WANTED)
    elif log.has(_ASKED, *_IGNORED):
        attitude, *higher = (~log.column(_ASKED, field).astype(bool) for field in _IGNORED)
    else:
        return None
    by_position = np.logical_or.reduce(higher)
    return _Source(_since(log.times(_ASKED)), attitude & ~by_position, by_position)


def _union(of: Sequence[Floats], within: Floats) -> Floats:
    """Spans that do not overlap, in order and joined where they meet, as far as they are within others."""
    joined = np.concatenate(of)
    joined = joined[np.argsort(joined[:, 0])]
    apart = joined[1:, 0] > joined[:-1, 1]
    starts, ends = joined[np.append(True, apart)[: len(joined)], 0], joined[np.append(apart, True)[: len(joined)], 1]
    return intersect(np.stack([starts, ends], axis=1), within)


def _since(time_s: Floats) -> Floats:
    return np.concatenate([time_s[:1] - _FIRST_S, time_s[1:]])


def _total(spans_s: Floats) -> float:
    return float((spans_s[:, 1] - spans_s[:, 0]).sum())


def _healthy(log: UlogTopics, end_s: float) -> Floats:
    """When nothing says that the estimated attitude is wrong, nor that it has just been corrected by a jump."""
    healthy = np.array([[-np.inf, np.inf]])
    if log.has("failsafe_flags", "attitude_invalid"):
        invalid = log.column("failsafe_flags", "attitude_invalid").astype(bool)
        healthy = outside(spans(log.times("failsafe_flags"), invalid, end_s))
    if log.has(_ATTITUDE, "quat_reset_counter"):
        time_s, count = log.times(_ATTITUDE), log.column(_ATTITUDE, "quat_reset_counter").astype(int)
        jumps = np.flatnonzero(np.diff(count)) + 1
        if log.has(_ATTITUDE, "delta_q_reset"):
            tilt = np.abs(angles(log.column(_ATTITUDE, "delta_q_reset", 4)[jumps])).max(axis=1, initial=0.0)
            jumps = jumps[~(tilt < _RESET_RAD)]
        healthy = intersect(healthy, outside(np.stack([time_s[jumps - 1], time_s[jumps]], axis=1)))
    return healthy
