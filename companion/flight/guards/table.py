"""What ends control by itself. Pure: what was measured in, the first guard that has had enough out.

Two kinds. A few stand on the tick, each a compare: what is invalid or jumps must not reach the controller. All others
are watched together after the set-point has gone, 50 times a second: `Watched` holds one number a guard, larger is
worse, not a number where it cannot be seen; a guard ends control when its number has been above its limit for its
timeout without a break.
"""

from __future__ import annotations

import math
from operator import gt
from typing import Final, NamedTuple

from companion.config.guards import link_share_s
from companion.config.schema import Config
from companion.control.types import AttitudeSetpoint, Odometry
from companion.flight.authority.reasons import Reason

_QUATERNION_TOLERANCE: Final = 0.02
_STILL_M_S: Final = 0.05
_AT_REST_M_S: Final = 1e-4  # slower and nearer than any real estimate is, and an ideal plant at rest is for ever: there
_AT_REST_M: Final = 1e-3  # float32 has no room for a difference between two samples


class Watched(NamedTuple):
    """One number a guard, in the order in which they are heard."""

    position_variance_m2: float = math.nan
    estimator_flags: float = math.nan  # needed ones that are missing
    velocity_consistency_m: float = math.nan
    fence: float = math.nan  # 1 outside, 0 inside
    tilt_rad: float = math.nan
    attitude_response_rad: float = math.nan  # outside the band of the certified responses
    tilt_error_rad: float = math.nan
    hover_thrust: float = math.nan  # how far the thrust flown is from the one believed to hover, over it
    thrust_saturation: float = math.nan  # share of the ticks
    weights_on_bound: float = math.nan
    tracking_error_m: float = math.nan
    envelope: float = math.nan  # largest share of it
    link_delay_s: float = math.nan
    link_jitter_s: float = math.nan
    pose_period_s: float = math.nan
    flight_time_s: float = math.nan


# In the order of `Watched`: the reason, the guard's key in the config, and its unit there in ours.
GUARDS: Final = (
    (Reason.POSITION_VARIANCE, "position_variance_m2", 1.0),
    (Reason.ESTIMATOR_FLAGS, "estimator_flags", 1.0),
    (Reason.VELOCITY_CONSISTENCY, "velocity_consistency_m", 1.0),
    (Reason.FENCE, "fence", 1.0),
    (Reason.TILT, "tilt_deg", math.pi / 180.0),
    (Reason.ATTITUDE_RESPONSE, "attitude_response_deg", math.pi / 180.0),
    (Reason.TILT_ERROR, "tilt_error_deg", math.pi / 180.0),
    (Reason.HOVER_THRUST, "hover_thrust", 1.0),
    (Reason.THRUST_SATURATION, "thrust_saturation", 1.0),
    (Reason.WEIGHTS_ON_BOUND, "weights_on_bound", 1.0),
    (Reason.TRACKING_ERROR, "tracking_error_m", 1.0),
    (Reason.ENVELOPE, "envelope", 1.0),
    (Reason.LINK_DELAY, "link_delay_s", 1.0),
    (Reason.LINK_JITTER, "link_jitter_s", 1.0),
    (Reason.POSE_RATE, "pose_rate_hz", 1.0),
    (Reason.FLIGHT_TIME, "flight_time_s", 1.0),
)
CLEAR: Final = (math.inf,) * len(GUARDS)  # since when each has been above its limit: none is


class Limits(NamedTuple):
    """Past these control ends; infinite where a guard is off."""

    pose_age_s: float  # the timeouts of the ages are in them already
    heartbeat_age_s: float
    clock_jump_s: float
    estimator_jump_m: float
    tick_overrun_s: float
    watched: Watched
    timeouts_s: tuple[float, ...]


def limits(config: Config) -> Limits:
    """The config's guards as plain numbers, which cost a tick less than a validated model."""
    guards = config.guards
    ages = guards.pose_age_s, guards.heartbeat_age_s
    pose_age_s, heartbeat_age_s = (g.limit + g.timeout_s if g.enabled else math.inf for g in ages)
    measuring = config.mission.identification is not None  # a response that nobody has certified yet
    given = {
        "attitude_response_deg": math.inf if measuring else guards.attitude_response_deg.limit,
        "fence": 0.5,  # inside or outside
        "envelope": 1.0,  # of it
        "link_delay_s": guards.link_delay_s.limit or link_share_s(config.attitude) or math.inf,
        "pose_rate_hz": 1.01
        / (guards.pose_rate_hz.limit or config.tick.floor_hz),  # a period, and how well it is known
    }

    def limit(key: str, scale: float = 1.0) -> float:
        section = getattr(guards, key)
        return scale * given.get(key, getattr(section, "limit", 0.0)) if section.enabled else math.inf

    return Limits(
        pose_age_s,
        heartbeat_age_s,
        limit("clock_jump_s"),
        limit("estimator_jump_m"),
        limit("tick_overrun_s"),
        Watched(*(limit(key, scale) for _, key, scale in GUARDS)),
        tuple(getattr(guards, key).timeout_s for _, key, _ in GUARDS),
    )


def stale(limits: Limits, pose_age_s: float, heartbeat_age_s: float) -> Reason | None:
    """What has not been heard for too long, or None."""
    if pose_age_s > limits.pose_age_s:
        return Reason.POSE_STALE
    if heartbeat_age_s > limits.heartbeat_age_s:
        return Reason.HEARTBEAT_LOST
    return None


def watch(
    limits: Limits, since_s: tuple[float, ...], watched: Watched, now_s: float
) -> tuple[tuple[float, ...], Reason | None]:
    """(since when each guard has been above its limit without a break, the first one whose time is up or None)."""
    if not any(map(gt, watched, limits.watched)):  # not a number is above nothing
        return CLEAR, None
    since_s = tuple(
        min(began_s, now_s) if value > limit else math.inf
        for value, limit, began_s in zip(watched, limits.watched, since_s, strict=True)
    )
    for began_s, timeout_s, (reason, _, _) in zip(since_s, limits.timeouts_s, GUARDS, strict=True):
        if now_s - began_s >= timeout_s:
            return since_s, reason
    return since_s, None


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
