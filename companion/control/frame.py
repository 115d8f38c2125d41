"""What is measured, in the control frame; and the frame turns, and what is remembered in it turns along.

References, commands, actuator outputs and the bias weight turn as vectors (a steady wind is fixed in NED). The weights
of position and velocity stay with their axes: they belong to pitch and roll.
"""

from __future__ import annotations

import math

from companion.control import attitude
from companion.control.mrac import AxisState
from companion.control.types import Horizontal, Odometry


def in_control_frame(
    odometry: Odometry, anchor_x_m: float, anchor_y_m: float, c: float, s: float, thrust_ratio: float
) -> Horizontal:
    """Measured position, velocity and w of (15): the thrust direction scaled by the thrust commanded.

    `c` and `s` are cosine and sine of the frame's yaw; `thrust_ratio` is over hover thrust.
    """
    _, x, y, _, vx, vy, _, qw, qx, qy, qz = odometry
    north, east = x - anchor_x_m, y - anchor_y_m
    fx, fy, _ = attitude.thrust_direction(qw, qx, qy, qz)
    return Horizontal(
        c * north + s * east,
        c * vx + s * vy,
        thrust_ratio * (c * fx + s * fy),
        c * east - s * north,
        c * vy - s * vx,
        thrust_ratio * (c * fy - s * fx),
    )


def turn(x: AxisState, y: AxisState, by_rad: float) -> tuple[AxisState, AxisState]:
    """The same memory seen from a frame turned by `by_rad` about its anchor."""
    x, y = turn_references(x, y, by_rad)
    c, s = math.cos(by_rad), math.sin(by_rad)
    ideal1, ideal2, reference1, reference2, weight1, weight2, command, control, actuator, bias = x
    ideal3, ideal4, reference3, reference4, weight3, weight4, across, control_y, actuator_y, bias_y = y
    return (
        AxisState(
            ideal1, ideal2, reference1, reference2, weight1, weight2, command,
            c * control + s * control_y, c * actuator + s * actuator_y, c * bias + s * bias_y,
        ),
        AxisState(
            ideal3, ideal4, reference3, reference4, weight3, weight4, across,
            c * control_y - s * control, c * actuator_y - s * actuator, c * bias_y - s * bias,
        ),
    )  # fmt: skip


def turn_references(x: AxisState, y: AxisState, by_rad: float) -> tuple[AxisState, AxisState]:
    """Positions and velocities alone: for a heading that was wrong, while the tilt of the vehicle is what it was."""
    c, s = math.cos(by_rad), math.sin(by_rad)
    ideal1, ideal2, reference1, reference2, weight1, weight2, command, control, actuator, bias = x
    ideal3, ideal4, reference3, reference4, weight3, weight4, across, control_y, actuator_y, bias_y = y
    return (
        AxisState(
            c * ideal1 + s * ideal3, c * ideal2 + s * ideal4,
            c * reference1 + s * reference3, c * reference2 + s * reference4,
            weight1, weight2, c * command + s * across, control, actuator, bias,
        ),
        AxisState(
            c * ideal3 - s * ideal1, c * ideal4 - s * ideal2,
            c * reference3 - s * reference1, c * reference4 - s * reference2,
            weight3, weight4, c * across - s * command, control_y, actuator_y, bias_y,
        ),
    )  # fmt: skip


def push(axis: AxisState, by_m_s: float) -> AxisState:
    """Both references faster by `by_m_s`."""
    ideal1, ideal2, reference1, reference2, weight1, weight2, command, control, actuator, bias = axis
    return AxisState(
        ideal1, ideal2 + by_m_s, reference1, reference2 + by_m_s, weight1, weight2, command, control, actuator, bias
    )


def turn_force(force: tuple[float, float, float], by_rad: float) -> tuple[float, float, float]:
    """A force (x, y, up) in a frame turned by `by_rad`."""
    c, s = math.cos(by_rad), math.sin(by_rad)
    return c * force[0] + s * force[1], c * force[1] - s * force[0], force[2]
