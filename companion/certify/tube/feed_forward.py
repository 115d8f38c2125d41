"""What a trajectory's own force leaves undone: a disturbance that it brings with it, m/s^2."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Final, NamedTuple

import numpy as np
from scipy.linalg import expm

from companion.attitude_response.exact import ends
from companion.certify.piecewise.inequalities import Floats
from companion.certify.problem import AxisProblem

STEP_S: Final = 0.01


class Asked(NamedTuple):
    """One axis at one instant, every `STEP_S`: what the trajectory accelerates by, and what is fed forward for it."""

    acceleration_m_s2: float
    fed_m_s2: float


def left_over(axis: AxisProblem, asked: Iterable[Asked]) -> float:
    """The largest |g w - r''| where w follows what is fed forward, over the corners of the response and its delay.

    By simulation, each sample held over its step: no proof. The trajectory begins at rest.
    """
    accelerations, fed = (np.array(values, dtype=float) for values in zip(*asked, strict=True))
    worst = 0.0
    for response in axis.response.dynamics.corners():
        a, b, c = (np.array(part, dtype=float) for part in (response.a, response.b, response.c))
        block = np.zeros((len(a) + 1, len(a) + 1))
        block[:-1, :-1], block[:-1, -1] = a, b
        over = expm(STEP_S * block)
        flown = _response(over[:-1, :-1], over[:-1, -1], c, fed)
        for delay in ends(axis.response.delay_s):
            late = float(delay) / STEP_S
            times = np.arange(len(flown)) - late
            shifted = np.interp(times, np.arange(len(flown)), flown, left=0.0)
            worst = max(worst, float(np.abs(shifted - accelerations).max(initial=0.0)))
    return worst if math.isfinite(worst) else math.inf


def _response(over: Floats, inlet: Floats, output: Floats, fed: Floats) -> Floats:
    x = np.zeros(len(inlet))
    result = np.empty(len(fed))
    for k, value in enumerate(fed):
        result[k] = output @ x
        x = over @ x + inlet * value
    return result
