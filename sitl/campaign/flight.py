"""One compiled flight."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from sitl.campaign import free_vehicle, guided_vehicle, loop
from sitl.campaign.compiled import compiled
from sitl.campaign.loop import Outcome
from sitl.campaign.mersenne import Floats
from sitl.campaign.takeover import TakeOver

TRACE_COLUMNS = 9


@cache
def _engine(one_axis: bool) -> Callable[..., Any]:
    return compiled(loop.fly, vehicle=guided_vehicle if one_axis else free_vehicle)


def fly(start: TakeOver, ticks: int = 0) -> tuple[Outcome, Floats]:
    """The flight from where control began; the first `ticks` of it as rows of `loop.fly`'s trace.

    `start` is used up: it is changed in place. Raises `MissingNumbaError`.
    """
    trace = np.zeros((ticks, TRACE_COLUMNS))
    outcome = _engine(isinstance(start.constants, guided_vehicle.Constants))(*start, trace)
    return Outcome(*outcome), trace[: outcome[1]]
