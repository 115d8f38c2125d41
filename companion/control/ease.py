"""A difference in the commanded force, washed out: what the law wants at once is reached over a second.

At engagement the vehicle leans as its autopilot had it; when the estimate jumps, the law wants another force though the
vehicle did not move. The difference is added to the law's force and runs out linearly. It is no part of u, so the
hedge sees it like a saturation and the weights do not learn from it.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

DURATION_S: Final = 1.0


class EaseState(NamedTuple):
    """What is added (specific force over g, control frame) and for how long; `due`: to be found at the next tick."""

    x: float
    y: float
    up: float
    left_s: float
    due: bool


def step(
    state: EaseState,
    wanted: tuple[float, float, float],
    flown: tuple[float, float, float],
    dt_s: float,
) -> tuple[EaseState, float, float, float]:
    """One tick: the force to fly for the one wanted, where `flown` is that of the last tick; each (x, y, up)."""
    offset_x, offset_y, offset_up, left, due = state
    x, y, up = wanted
    if due:
        offset_x, offset_y, offset_up, left = flown[0] - x, flown[1] - y, flown[2] - up, DURATION_S
    else:
        left = left - dt_s if left > dt_s else 0.0
    share = left / DURATION_S
    return (
        EaseState(offset_x, offset_y, offset_up, left, False),
        x + share * offset_x,
        y + share * offset_y,
        up + share * offset_up,
    )


def turn(state: EaseState, by_rad: float) -> EaseState:
    """The same in a control frame turned by `by_rad`."""
    c, s = math.cos(by_rad), math.sin(by_rad)
    x, y, up, left, due = state
    return EaseState(c * x + s * y, c * y - s * x, up, left, due)
