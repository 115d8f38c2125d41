"""The guards' limits, and when one of them has been past its limit for long enough. Pure.

Two kinds. A few stand where it happens, each a compare: what is stale, invalid or jumps must not reach the controller.
All others are watched together, 50 times a second: one number a guard, in the order of their rows, not a number where
it cannot be seen. A guard ends control when its number has been past its limit for its timeout, less the time in which
it was not.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from operator import gt
from typing import Final, NamedTuple

from companion.config.guards.rows import GUARDS, Reason
from companion.config.schema import Config
from companion.control.types import AttitudeSetpoint, Odometry
from companion.flight.guards.measures import MEASURES

_QUATERNION_TOLERANCE: Final = 0.02
_ROUNDING_S: Final = 1e-6  # of a timeout that is a sum of steps
_STILL_M_S: Final = 0.05
_AT_REST_M_S: Final = 1e-4  # slower and nearer than any real estimate is, and an ideal plant at rest is for ever: there
_AT_REST_M: Final = 1e-3  # float32 has no room for a difference between two samples

_MEASURED: Final = frozenset(reason for reason, measured in MEASURES.items() if measured.measure is not None)
WATCHED: Final = tuple(reason for reason in GUARDS if reason in _MEASURED)  # together, in this order
CLEAR: Final = (0.0,) * len(WATCHED)  # for how long each has been past its limit: none is

Limits = Mapping[Reason, float]  # past these control ends, in our units; infinite where a guard is off


class WatchLimits(NamedTuple):
    """Of the guards that are watched together; past is above, so a least value stands here with its sign changed."""

    limits: tuple[float, ...]
    timeouts_s: tuple[float, ...]


def limits(config: Config) -> Limits:
    """The config's guards as plain numbers, which cost a tick less than a validated model.

    The timeout of a guard that is not watched together is in its limit already: it is an age, or zero.
    """
    found: dict[Reason, float] = {}
    for reason, (key, _, row) in GUARDS.items():
        section = getattr(config.guards, key)
        derived = MEASURES[reason].limit if reason in MEASURES else None
        if not section.enabled:
            found[reason] = -math.inf if row.least else math.inf
        elif derived is not None:
            found[reason] = derived(config)
        else:
            found[reason] = row.scale * section.limit + (0.0 if reason in _MEASURED else section.timeout_s)
    return found


def watch_limits(config: Config, of: Limits) -> WatchLimits:
    """Of the guards that are watched together."""
    return WatchLimits(
        tuple(-of[reason] if GUARDS[reason].row.least else of[reason] for reason in WATCHED),
        tuple(getattr(config.guards, GUARDS[reason].key).timeout_s for reason in WATCHED),
    )


def stale(limits: Limits, pose_age_s: float, heartbeat_age_s: float) -> Reason | None:
    """What has not been heard for too long, or None."""
    if pose_age_s > limits[Reason.POSE_STALE]:
        return Reason.POSE_STALE
    if heartbeat_age_s > limits[Reason.HEARTBEAT_LOST]:
        return Reason.HEARTBEAT_LOST
    return None


def watch(
    limits: WatchLimits, past_s: tuple[float, ...], watched: tuple[float, ...], dt_s: float
) -> tuple[tuple[float, ...], Reason | None]:
    """(for how long each guard has been past its limit, the first one whose time is up or None).

    The time drains as fast as it fills, so that a calm look takes back no more than itself; what cannot be seen takes
    nothing back. `dt_s` since the last look.
    """
    if past_s is CLEAR and not any(map(gt, watched, limits.limits)):  # not a number is above nothing
        return CLEAR, None
    past_s = tuple(
        had_s + dt_s if value > limit else max(had_s - dt_s, 0.0) if value <= limit else had_s
        for value, limit, had_s in zip(watched, limits.limits, past_s, strict=True)
    )
    for had_s, timeout_s, value, limit, reason in zip(
        past_s, limits.timeouts_s, watched, limits.limits, WATCHED, strict=True
    ):
        if value > limit and had_s >= timeout_s - _ROUNDING_S:
            return past_s, reason
    return past_s if any(past_s) else CLEAR, None


def repeats(before: Odometry, sample: Odometry) -> bool:
    """Whether an estimate has stopped: a vehicle that says it moves cannot be where it was, to the last bit."""
    return (
        sample.x_m == before.x_m
        and sample.y_m == before.y_m
        and sample.z_m == before.z_m
        and sample.vx_m_s**2 + sample.vy_m_s**2 + sample.vz_m_s**2 > _STILL_M_S**2
    )


def frozen(before: Odometry, sample: Odometry, error_m: float) -> bool:
    """Whether an estimate has stopped in control, at whatever speed: it is the same to the last bit, time aside.

    `error_m`: distance from the reference. Only what is at rest exactly where it is wanted may stay as it is.
    """
    return before[1:] == sample[1:] and (
        error_m > _AT_REST_M or sample.vx_m_s**2 + sample.vy_m_s**2 + sample.vz_m_s**2 > _AT_REST_M_S**2
    )


def all_finite(values: Odometry | AttitudeSetpoint) -> bool:
    """Whether every number is finite: one sum tells, since neither NaN nor an infinity can be added away."""
    return math.isfinite(sum(values))


def valid_pose(sample: Odometry) -> bool:
    """Finite numbers, and a quaternion of length one; an all-zero payload has none."""
    _, _, _, _, _, _, _, qw, qx, qy, qz = sample
    return math.isfinite(sum(sample)) and abs(qw * qw + qx * qx + qy * qy + qz * qz - 1.0) < _QUATERNION_TOLERANCE
