"""Attitude extraction (5)-(6): the attitude and the thrust that make a wanted force, and the way back.

The paper's thrust points along +b3 with z up. In NED/FRD it points along -b3, so b3 is minus the direction of the
force. Forces are specific forces over g in local NED.
"""

from __future__ import annotations

import math


def orient(
    force_x: float, force_y: float, force_z: float, hx: float, hy: float
) -> tuple[float, float, float, float, float]:
    """Attitude of (6) for a force, and the force's magnitude, 1 at hover; the heading by its cosine and sine.

    Plain numbers, quaternion first: the tick makes a set-point of them. The force must not vanish nor lie along the
    heading: the caller limits tilt well below 90 degrees.
    """
    magnitude = math.sqrt(force_x * force_x + force_y * force_y + force_z * force_z)
    zx, zy, zz = -force_x / magnitude, -force_y / magnitude, -force_z / magnitude
    yx, yy, yz = -zz * hy, zz * hx, zx * hy - zy * hx  # b3 x heading
    norm = math.sqrt(yx * yx + yy * yy + yz * yz)
    yx, yy, yz = yx / norm, yy / norm, yz / norm
    xx, xy, xz = yy * zz - yz * zy, yz * zx - yx * zz, yx * zy - yy * zx  # b2 x b3
    # Columns are the body axes, R = [x y z]. The largest of the four squares decides: no division by a small number.
    trace = xx + yy + zz
    if trace > 0.0:
        s = 2.0 * math.sqrt(1.0 + trace)
        return 0.25 * s, (yz - zy) / s, (zx - xz) / s, (xy - yx) / s, magnitude
    if xx >= yy and xx >= zz:
        s = 2.0 * math.sqrt(1.0 + xx - yy - zz)
        return (yz - zy) / s, 0.25 * s, (yx + xy) / s, (zx + xz) / s, magnitude
    if yy >= zz:
        s = 2.0 * math.sqrt(1.0 + yy - xx - zz)
        return (zx - xz) / s, (yx + xy) / s, 0.25 * s, (zy + yz) / s, magnitude
    s = 2.0 * math.sqrt(1.0 + zz - xx - yy)
    return (xy - yx) / s, (zx + xz) / s, (zy + yz) / s, 0.25 * s, magnitude


def thrust_direction(qw: float, qx: float, qy: float, qz: float) -> tuple[float, float, float]:
    """Unit vector of the thrust in local NED, ``-R e3 = (-R13, -R23, -R33)``."""
    return -2.0 * (qx * qz + qw * qy), -2.0 * (qy * qz - qw * qx), -(1.0 - 2.0 * (qx * qx + qy * qy))


def yaw(qw: float, qx: float, qy: float, qz: float) -> float:
    """Heading of the body's x axis, radians from north."""
    return math.atan2(2.0 * (qw * qz + qx * qy), 1.0 - 2.0 * (qy * qy + qz * qz))
