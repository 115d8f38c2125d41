"""What an estimator makes of the truth, pure: noise on a pose, and a pose between two. For CPython and numba both."""

from __future__ import annotations

from math import sqrt

from sitl.vehicles.rotation import Quaternion, euler, quaternion

Vector = tuple[float, float, float]
Pose = tuple[Vector, Vector, Quaternion]
"""Position and velocity, local NED; attitude, body FRD to NED."""


def noisy(pose: Pose, position_m: Vector, velocity_m_s: Vector, angles_rad: Vector) -> Pose:
    """A pose with errors of position, velocity and roll, pitch, yaw."""
    (x, y, z), (vx, vy, vz), (qw, qx, qy, qz) = pose
    ex, ey, ez = position_m
    evx, evy, evz = velocity_m_s
    of_roll, of_pitch, of_yaw = angles_rad
    roll, pitch, yaw = euler(qw, qx, qy, qz)
    return (
        (x + ex, y + ey, z + ez),
        (vx + evx, vy + evy, vz + evz),
        quaternion(roll + of_roll, pitch + of_pitch, yaw + of_yaw),
    )


def _mixed(a: Vector, b: Vector, share: float) -> Vector:
    return a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]), a[2] + share * (b[2] - a[2])


def between(a: Pose, b: Pose, share: float) -> Pose:
    """So much of the way from one pose to another."""
    place_a, velocity_a, (aw, ax, ay, az) = a
    place_b, velocity_b, (bw, bx, by, bz) = b
    w, x, y, z = aw + share * (bw - aw), ax + share * (bx - ax), ay + share * (by - ay), az + share * (bz - az)
    norm = sqrt(w * w + x * x + y * y + z * z)
    return (
        _mixed(place_a, place_b, share),
        _mixed(velocity_a, velocity_b, share),
        (w / norm, x / norm, y / norm, z / norm),
    )
