"""The vehicle's motion once more, from what is flown, beside what the estimator says of it. Pure.

Two differences are followed, axis by axis in local NED. What position moved less what velocity says it did: where it is
not zero, one of the two is wrong. And what velocity changed less what attitude and thrust make of it,

    v' = g (thrust / hover thrust) d + (0, 0, g) + b

with the direction d of the thrust as measured, which has the attitude's response in it, and b, all that is not modelled
and changes slowly: steady wind, payload. Each difference is summed with a leak, so that what is small and lasts counts
as what is large and short does, and nothing that looks right for a moment wipes it out.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from companion.config.base import Vector
from companion.control.types import GRAVITY_M_S2, Jump, Odometry

_DRIFT_S: Final = 0.5  # leaks of position against velocity
_SHORT_S: Final = 2.0
LONG_S: Final = 10.0
_HORIZONTAL_SHARE: Final = 3.2  # what an estimator with position aiding is wrong by with the second over the first
_VERTICAL_SHARE: Final = 2.0
_VELOCITY_S: Final = 1.0  # leak of velocity against thrust
_BIAS_S: Final = 5.0  # in which what is not modelled is learnt
_STEP_M: Final = 0.2  # what position may move against velocity from one look to the next
_STEP_M_S: Final = 1.0  # and more, the longer that takes
_new: Final = tuple.__new__  # a third of what the class itself costs


class Propagation(NamedTuple):
    """What one look leaves to the next. Flat, and local NED each: an axis a field costs half of what a vector does."""

    last: Odometry
    acceleration_ned_m_s2: Vector  # by attitude and thrust
    bias_n_m_s2: float
    bias_e_m_s2: float
    bias_d_m_s2: float
    drift_n_m: float = 0.0  # position against velocity: half a second, 2 s, 10 s
    drift_e_m: float = 0.0
    drift_d_m: float = 0.0
    slide_n_m: float = 0.0
    slide_e_m: float = 0.0
    slide_d_m: float = 0.0
    long_slide_n_m: float = 0.0
    long_slide_e_m: float = 0.0
    long_slide_d_m: float = 0.0
    unexplained_n_m_s: float = 0.0  # velocity against thrust
    unexplained_e_m_s: float = 0.0
    unexplained_d_m_s: float = 0.0


class Disagreement(NamedTuple):
    """How far what the estimator says and what is flown are apart."""

    drift_m: float = 0.0  # position against velocity in the last half second, in space
    slide_m: float = 0.0  # north or east, the worse of both leaks
    height_slide_m: float = 0.0  # down
    unexplained_m_s: float = 0.0  # velocity against thrust in the last second, the worst axis
    step_m: float = 0.0  # what position stepped since the last look; 0 for what may be noise


def acceleration(thrust_ned: Vector, thrust: float, hover_thrust: float) -> Vector:
    """Of a thrust along a unit vector, NED, m/s²."""
    north, east, down = thrust_ned
    size = GRAVITY_M_S2 * thrust / hover_thrust
    return size * north, size * east, size * down + GRAVITY_M_S2


def start(sample: Odometry, acceleration_ned_m_s2: Vector) -> Propagation:
    """Where control begins, the vehicle keeps its velocity: what the thrust does beyond that is the wind's."""
    north, east, down = acceleration_ned_m_s2
    return Propagation(sample, acceleration_ned_m_s2, -north, -east, -down)


def step(
    state: Propagation, sample: Odometry, acceleration_ned_m_s2: Vector, counted: Jump | None = None
) -> tuple[Propagation, Disagreement]:
    """(state, what disagrees) at the next look. `counted`: what the resets counted since the last one have done."""
    last, (an0, ae0, ad0), bn, be, bd, dx, dy, dz, sx, sy, sz, lx, ly, lz, un, ue, ud = state
    t0, x0, y0, z0, vx0, vy0, vz0, _, _, _, _ = last
    t1, x1, y1, z1, vx1, vy1, vz1, _, _, _, _ = sample
    an1, ae1, ad1 = acceleration_ned_m_s2
    dt = t1 - t0
    if dt <= 0.0:
        return state, Disagreement()
    if counted is not None:  # as if the last sample had been in the new coordinates
        jx, jy, jz, jvx, jvy, jvz, _ = counted
        x0, y0, z0, vx0, vy0, vz0 = x0 + jx, y0 + jy, z0 + jz, vx0 + jvx, vy0 + jvy, vz0 + jvz
    half = 0.5 * dt
    ix, iy, iz = x1 - x0 - half * (vx0 + vx1), y1 - y0 - half * (vy0 + vy1), z1 - z0 - half * (vz0 + vz1)
    keep = _DRIFT_S / (_DRIFT_S + dt)
    dx, dy, dz = keep * (dx + ix), keep * (dy + iy), keep * (dz + iz)
    keep = _SHORT_S / (_SHORT_S + dt)
    sx, sy, sz = keep * (sx + ix), keep * (sy + iy), keep * (sz + iz)
    keep = LONG_S / (LONG_S + dt)
    lx, ly, lz = keep * (lx + ix), keep * (ly + iy), keep * (lz + iz)
    keep, learn = _VELOCITY_S / (_VELOCITY_S + dt), 1.0 / (_BIAS_S + dt)
    rn = vx1 - vx0 - half * (an0 + an1) - dt * bn
    re = vy1 - vy0 - half * (ae0 + ae1) - dt * be
    rd = vz1 - vz0 - half * (ad0 + ad1) - dt * bd
    un, ue, ud = keep * (un + rn), keep * (ue + re), keep * (ud + rd)
    moved2, least = ix * ix + iy * iy + iz * iz, _STEP_M + _STEP_M_S * (dt - 0.02)
    short, long = max(sx, sy, -sx, -sy), max(lx, ly, -lx, -ly)
    return (
        _new(
            Propagation,
            (
                sample, acceleration_ned_m_s2, bn + learn * rn, be + learn * re, bd + learn * rd,
                dx, dy, dz, sx, sy, sz, lx, ly, lz, un, ue, ud,
            ),
        ),
        _new(
            Disagreement,
            (
                math.sqrt(dx * dx + dy * dy + dz * dz),
                max(long, _HORIZONTAL_SHARE * short),
                max(lz, -lz, _VERTICAL_SHARE * sz, -_VERTICAL_SHARE * sz),
                max(un, ue, ud, -un, -ue, -ud),
                math.sqrt(moved2) if moved2 > least * least else 0.0,
            ),
        ),
    )  # fmt: skip
