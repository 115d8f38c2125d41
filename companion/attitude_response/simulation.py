"""A response to a whole log's set-points at once, each held until the next, exactly, with a fractional delay.

For set-point steps du_k at t_k and a pole p, what is still missing is a combination of ``sum_k du_k exp(p (t - t_k))``
over the steps that have arrived after the delay (`ParametricKind.lag`), so one cumulative sum gives every sample and
the delay need be no multiple of any sampling period. The one module here that needs numpy: flight loads it not.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import numpy.typing as npt

from companion.attitude_response.kinds import Model

Floats = npt.NDArray[np.float64]

_LARGEST_EXPONENT: Final = 600.0


def respond(
    model: Model, values: npt.ArrayLike, setpoint_time_s: Floats, setpoint_rad: Floats, time_s: Floats
) -> Floats:
    """The model's angle at `time_s`, at rest on the first set-point before the second.

    Parameters
    ----------
    model, values
        Which one, and its parameters in order.
    setpoint_time_s, setpoint_rad
        Shape (n,), rising: each set-point holds until the next.
    time_s
        Shape (m,): when the angle is asked for.

    Returns
    -------
    ndarray
        Angle in rad, shape (m,).
    """
    parameters = [float(value) for value in np.asarray(values, dtype=np.float64)]
    late = time_s - (parameters.pop() if model.delayed else 0.0)
    arrived = np.maximum(np.searchsorted(setpoint_time_s, late, side="right") - 1, 0)
    steps = np.zeros_like(setpoint_rad)
    steps[1:] = setpoint_rad[1:] - setpoint_rad[:-1]

    def transient(pole: float | complex) -> Any:
        return _transient(pole, steps, setpoint_time_s, late, arrived)

    return np.asarray(setpoint_rad[arrived] - model.kind.lag(parameters, transient))


def _transient(
    pole: float | complex, steps: Floats, step_time_s: Floats, late: Floats, arrived: npt.NDArray[np.intp]
) -> Any:
    """``sum_k du_k exp(pole (t - t_k))`` over the steps arrived, shape of `late`.

    A cumulative sum over a stretch short enough for its exponentials; the next stretch begins with what is left of it.
    """
    total = np.empty(len(late), dtype=type(pole))
    left = type(pole)(0.0)
    origin, end = float(step_time_s[0]), float(late[-1])
    span = max(_LARGEST_EXPONENT / max(-pole.real, 1e-9), 1e-3)
    while True:
        if origin + span >= end:  # nearly always: the whole at once
            first, last = np.searchsorted(step_time_s, [origin, np.nextafter(end, np.inf)])
            a, b = int(np.searchsorted(late, origin)), len(late)
        else:
            first, last = np.searchsorted(step_time_s, [origin, origin + span])
            a, b = np.searchsorted(late, [origin, origin + span])
        grown = np.cumsum(steps[first:last] * np.exp(pole * (origin - step_time_s[first:last])))
        sums = np.concatenate([[left], left + grown])
        total[a:b] = sums[arrived[a:b] - first + 1] * np.exp(pole * (late[a:b] - origin))
        if b == len(late):
            total[: np.searchsorted(late, step_time_s[0])] = 0.0
            return total
        left = sums[-1] * np.exp(pole * span)
        origin += span
        following = min(late[b], step_time_s[last] if last < len(step_time_s) else np.inf)
        if following > origin + span:  # nothing happens for long and nothing is left: work is bounded by samples
            left, origin = type(pole)(0.0), float(following)
