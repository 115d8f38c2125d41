"""What ends control by itself. Pure: ages in, the first broken guard out."""

from __future__ import annotations

import math

from companion.config.schema import Guards
from companion.control.types import AttitudeSetpoint, Odometry
from companion.flight.authority import Reason


def broken(guards: Guards, pose_age_s: float, heartbeat_age_s: float) -> Reason | None:
    """The first guard past its limit, or None."""
    if guards.pose_age_s.enabled and pose_age_s > guards.pose_age_s.limit:
        return Reason.POSE_STALE
    if guards.heartbeat_age_s.enabled and heartbeat_age_s > guards.heartbeat_age_s.limit:
        return Reason.HEARTBEAT_LOST
    return None


def all_finite(values: Odometry | AttitudeSetpoint) -> bool:
    """Whether every number is finite: one sum tells, since neither NaN nor an infinity can be added away."""
    return math.isfinite(sum(values))
