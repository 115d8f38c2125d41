"""Rotations: unit quaternions, scalar first, body to NED, and the angles roll, pitch, yaw (Z-Y-X)."""

from __future__ import annotations

from math import asin, atan2, cos, nan, sin, sqrt
from typing import Final

Quaternion = tuple[float, float, float, float]

UNCONTROLLED: Final[Quaternion] = (nan, nan, nan, nan)
"""An attitude set-point that is none: nothing turns the vehicle, nothing stops it from turning."""


def euler(qw: float, qx: float, qy: float, qz: float) -> tuple[float, float, float]:
    """Roll, pitch, yaw (Z-Y-X) of a unit quaternion."""
    sine = 2.0 * (qw * qy - qz * qx)
    sine = 1.0 if sine > 1.0 else -1.0 if sine < -1.0 else sine
    return (
        atan2(2.0 * (qw * qx + qy * qz), 1.0 - 2.0 * (qx * qx + qy * qy)),
        asin(sine),
        atan2(2.0 * (qw * qz + qx * qy), 1.0 - 2.0 * (qy * qy + qz * qz)),
    )


def quaternion(roll: float, pitch: float, yaw: float) -> tuple[float, float, float, float]:
    """Unit quaternion of roll, pitch, yaw (Z-Y-X)."""
    cr, sr = cos(0.5 * roll), sin(0.5 * roll)
    cp, sp = cos(0.5 * pitch), sin(0.5 * pitch)
    cy, sy = cos(0.5 * yaw), sin(0.5 * yaw)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def turned(q_wxyz: Quaternion, yaw_rad: float) -> Quaternion:
    """An attitude turned about the vertical."""
    c, s = cos(0.5 * yaw_rad), sin(0.5 * yaw_rad)
    w, x, y, z = q_wxyz
    return c * w - s * z, c * x - s * y, c * y + s * x, c * z + s * w


def multiply(a_wxyz: Quaternion, b_wxyz: Quaternion) -> Quaternion:
    """The Hamilton product: `a` turned further by `b` in its own frame."""
    aw, ax, ay, az = a_wxyz
    bw, bx, by, bz = b_wxyz
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


def rotation(x_rad: float, y_rad: float, z_rad: float) -> Quaternion:
    """Unit quaternion of a rotation vector."""
    angle = sqrt(x_rad * x_rad + y_rad * y_rad + z_rad * z_rad)
    share = sin(0.5 * angle) / angle if angle > 0.0 else 0.5
    return cos(0.5 * angle), share * x_rad, share * y_rad, share * z_rad
