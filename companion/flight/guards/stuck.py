"""Whether each quantity of the estimate still changes: a number that is the same to the last bit has stopped.

No estimate of a vehicle in the air stays the same: in recordings of PX4 none does for more than two samples. One that
is at rest in the plant may, so only what should move is missed: a position whose own velocity is not zero, a velocity
that its position does not follow, an attitude whose set-point turns. What has stopped drains as slowly as it has
filled, so that one new value among many old ones wipes nothing out. Pure.
"""

from __future__ import annotations

from typing import Final, NamedTuple

from companion.config.base import Vector
from companion.control.types import Odometry

NAMES: Final = ("x", "y", "z", "vx", "vy", "vz", "attitude")

_MOVES_M_S: Final = 1e-4  # slower than any real estimate says, and an ideal plant at rest is for ever
_FOLLOWS_M: Final = 2e-3  # within which a velocity that stays the same may be right
_TURNS: Final = 0.01  # of a unit vector: what the set-point turns by, and the attitude follows
_STILL: Final = (0.0, 0.0, 0.0)
_NEVER: Final = (0.0,) * len(NAMES)


class Stopped(NamedTuple):
    """What one look leaves to the next.

    `for_s` in the order of `NAMES`; `strayed_ned_m`, what position has moved otherwise than a velocity said that has
    stayed the same since; `wanted_ned`, the direction of the thrust that was wanted when the attitude last changed.
    """

    last: Odometry
    for_s: tuple[float, ...]
    strayed_ned_m: Vector
    wanted_ned: Vector


def start(sample: Odometry, wanted_ned: Vector) -> Stopped:
    """Nothing has stopped yet."""
    return Stopped(sample, _NEVER, _STILL, wanted_ned)


def step(state: Stopped, sample: Odometry, wanted_ned: Vector, *, reset: bool = False) -> Stopped:
    """The next look, with the direction of the thrust that is wanted now; `reset`, whether one was counted since."""
    if reset:
        return Stopped(sample, state.for_s, _STILL, wanted_ned)
    last, for_s, strayed, wanted_before = state
    t0, x0, y0, z0, vx0, vy0, vz0, w0, qx0, qy0, qz0 = last
    t1, x1, y1, z1, vx1, vy1, vz1, w1, qx1, qy1, qz1 = sample
    turned = w1 != w0 or qx1 != qx0 or qy1 != qy0 or qz1 != qz0
    moved = x1 != x0 and y1 != y0 and z1 != z0 and vx1 != vx0 and vy1 != vy0 and vz1 != vz0
    if turned and moved and not any(for_s):
        return Stopped(sample, _NEVER, _STILL, wanted_ned)
    dt = t1 - t0
    sx, sy, sz = strayed
    sx = sx + x1 - x0 - dt * vx1 if vx1 == vx0 else 0.0
    sy = sy + y1 - y0 - dt * vy1 if vy1 == vy0 else 0.0
    sz = sz + z1 - z0 - dt * vz1 if vz1 == vz0 else 0.0
    (north, east, down), (north0, east0, down0) = wanted_ned, wanted_before
    stopped = (
        x1 == x0 and abs(vx1) > _MOVES_M_S,
        y1 == y0 and abs(vy1) > _MOVES_M_S,
        z1 == z0 and abs(vz1) > _MOVES_M_S,
        abs(sx) > _FOLLOWS_M,
        abs(sy) > _FOLLOWS_M,
        abs(sz) > _FOLLOWS_M,
        not turned and max(abs(north - north0), abs(east - east0), abs(down - down0)) > _TURNS,
    )
    filled = tuple([had + dt if is_so else max(had - dt, 0.0) for had, is_so in zip(for_s, stopped, strict=True)])
    return Stopped(sample, filled, (sx, sy, sz), wanted_ned if turned else wanted_before)
