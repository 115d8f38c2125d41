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

DRIFT_S: Final = 0.5  # leaks of position against velocity
SLIDE_S: Final = (2.0, 10.0)
HORIZONTAL_SHARE: Final = 3.2  # what an estimator with position aiding is wrong by with the second over the first
_VERTICAL_SHARE: Final = 2.0
_VELOCITY_S: Final = 1.0  # leak of velocity against thrust
_BIAS_S: Final = 5.0  # in which what is not modelled is learnt
_STEP_M: Final = 0.2  # what position may move against velocity from one look to the next
_STEP_M_S: Final = 1.0  # and more, the longer that takes
_STILL: Final = (0.0, 0.0, 0.0)


class Propagation(NamedTuple):
    """What one look leaves to the next."""

    last: Odometry
    acceleration_ned_m_s2: Vector  # by attitude and thrust
    bias_ned_m_s2: Vector
    drift_ned_m: Vector = _STILL  # position against velocity: half a second, 2 s, 10 s
    slide_ned_m: Vector = _STILL
    long_slide_ned_m: Vector = _STILL
    unexplained_ned_m_s: Vector = _STILL  # velocity against thrust


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
    return Propagation(sample, acceleration_ned_m_s2, (-north, -east, -down))


def step(
    state: Propagation, sample: Odometry, acceleration_ned_m_s2: Vector, counted: Jump | None = None
) -> tuple[Propagation, Disagreement]:
    """(state, what disagrees) at the next look. `counted`: what the resets counted since the last one have done."""
    last, (an0, ae0, ad0), (bn, be, bd), (dx, dy, dz), (sx, sy, sz), (lx, ly, lz), (un, ue, ud) = state
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
    keep, keep_s, keep_l = 1.0 / (1.0 + dt / DRIFT_S), 1.0 / (1.0 + dt / SLIDE_S[0]), 1.0 / (1.0 + dt / SLIDE_S[1])
    dx, dy, dz = keep * (dx + ix), keep * (dy + iy), keep * (dz + iz)
    sx, sy, sz = keep_s * (sx + ix), keep_s * (sy + iy), keep_s * (sz + iz)
    lx, ly, lz = keep_l * (lx + ix), keep_l * (ly + iy), keep_l * (lz + iz)
    rn, re, rd = vx1 - vx0 - half * (an0 + an1), vy1 - vy0 - half * (ae0 + ae1), vz1 - vz0 - half * (ad0 + ad1)
    keep_v, learn = 1.0 / (1.0 + dt / _VELOCITY_S), 1.0 / (dt + _BIAS_S)
    un, ue, ud = keep_v * (un + rn - dt * bn), keep_v * (ue + re - dt * be), keep_v * (ud + rd - dt * bd)
    bn, be, bd = bn + learn * (rn - dt * bn), be + learn * (re - dt * be), bd + learn * (rd - dt * bd)
    moved = math.sqrt(ix * ix + iy * iy + iz * iz)
    return (
        Propagation(
            sample, acceleration_ned_m_s2, (bn, be, bd), (dx, dy, dz), (sx, sy, sz), (lx, ly, lz), (un, ue, ud)
        ),
        Disagreement(
            math.sqrt(dx * dx + dy * dy + dz * dz),
            max(abs(lx), abs(ly), HORIZONTAL_SHARE * abs(sx), HORIZONTAL_SHARE * abs(sy)),
            max(abs(lz), _VERTICAL_SHARE * abs(sz)),
            max(abs(un), abs(ue), abs(ud)),
            moved if moved > _STEP_M + _STEP_M_S * (dt - 0.02) else 0.0,
        ),
    )
