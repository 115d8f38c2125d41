"""What goes into and comes out of the position controller: flat records of floats, which CPython and numba both take.

Frames: local NED, body FRD, quaternion scalar first, body to NED. SI units.
"""

from __future__ import annotations

from typing import Final, NamedTuple

GRAVITY_M_S2: Final = 9.81  # of the controller, its certificate and the plant alike


class Odometry(NamedTuple):
    """Pose and velocity of the vehicle at one instant, as the autopilot estimates them."""

    time_s: float  # autopilot's clock, since its boot
    x_m: float
    y_m: float
    z_m: float  # down
    vx_m_s: float
    vy_m_s: float
    vz_m_s: float
    qw: float
    qx: float
    qy: float
    qz: float


class PositionSetpoint(NamedTuple):
    """Where to go, in local NED."""

    x_m: float
    y_m: float
    z_m: float
    yaw_rad: float


class Reference(NamedTuple):
    """One instant of a trajectory in local NED: position and its first four derivatives, and the heading."""

    x_m: float
    y_m: float
    z_m: float
    vx_m_s: float
    vy_m_s: float
    vz_m_s: float
    ax_m_s2: float
    ay_m_s2: float
    az_m_s2: float
    jx_m_s3: float
    jy_m_s3: float
    jz_m_s3: float
    sx_m_s4: float
    sy_m_s4: float
    sz_m_s4: float
    yaw_rad: float


class Jump(NamedTuple):
    """A step of the estimate itself: what it says now minus what it was expected to say. The vehicle did not move."""

    x_m: float
    y_m: float
    z_m: float
    vx_m_s: float
    vy_m_s: float
    vz_m_s: float
    yaw_rad: float


class Horizontal(NamedTuple):
    """One instant in the control frame: position, velocity and actuator output (specific force over g) of both axes.

    On a trajectory all three are less the trajectory's own.
    """

    x_m: float
    vx_m_s: float
    wx: float
    y_m: float
    vy_m_s: float
    wy: float


class AttitudeSetpoint(NamedTuple):
    """Desired attitude (body to NED) and normalised collective thrust, 0 to 1."""

    qw: float
    qx: float
    qy: float
    qz: float
    thrust: float
