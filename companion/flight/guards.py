"""What ends control by itself. Pure: ages in, the first broken guard out."""

from __future__ import annotations

import math
from typing import NamedTuple

from companion.config.guards import Guards
from companion.control.types import AttitudeSetpoint, Odometry
from companion.flight.authority import Reason

_QUATERNION_TOLERANCE = 0.02


class Limits(NamedTuple):
    """Past these control ends; infinite where a guard is off."""

    pose_age_s: float
    heartbeat_age_s: float


def limits(guards: Guards) -> Limits:
    """The config's guards as plain numbers, which cost a tick less than a validated model."""
    sections = (guards.pose_age_s, guards.heartbeat_age_s)
    return Limits(*(section.limit if section.enabled else math.inf for section in sections))


def broken(limits: Limits, pose_age_s: float, heartbeat_age_s: float) -> Reason | None:
    """The first guard past its limit, or None."""
    if pose_age_s > limits.pose_age_s:
        return Reason.POSE_STALE
    if heartbeat_age_s > limits.heartbeat_age_s:
        return Reason.HEARTBEAT_LOST
    return None


def all_finite(values: Odometry | AttitudeSetpoint) -> bool:
    """Whether every number is finite: one sum tells, since neither NaN nor an infinity can be added away."""
    return math.isfinite(sum(values))


def valid_pose(sample: Odometry) -> bool:
    """Finite numbers, and a quaternion of length one; an all-zero payload has none."""
    qw, qx, qy, qz = sample[7:]
    return math.isfinite(sum(sample)) and abs(qw * qw + qx * qx + qy * qy + qz * qz - 1.0) < _QUATERNION_TOLERANCE
