"""The models: unit-gain linear responses to a set-point held between its samples, exactly, with a fractional delay.

For set-point steps du_k at t_k and a pole l, the response is ``u(t - T) - exp(l (t - T)) sum_k du_k exp(-l t_k)`` over
the steps that have arrived after the delay T, so one cumulative sum gives every sample and T need be no multiple of any
sampling period.
"""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from companion.identify.series import Floats

_NEARLY_EQUAL: Final = 1e-6  # of damping² from one: the two poles are then told apart by hand
_LARGEST_EXPONENT: Final = 600.0


class Model(NamedTuple):
    """A model's name in the machine-readable output, its parameters, and between what and from where they are sought.

    Units: rad/s, none, s, as the names say.
    """

    name: str
    title: str
    parameters: tuple[str, ...]
    start: tuple[float, ...]
    lower: tuple[float, ...]
    upper: tuple[float, ...]


FIRST_ORDER: Final = Model("first_order", "first order", ("bandwidth_rad_s",), (5.0,), (0.2,), (80.0,))
FIRST_ORDER_DELAY: Final = Model(
    "first_order_delay",
    "first order + delay",
    ("bandwidth_rad_s", "delay_s"),
    (6.0, 0.05),
    (0.2, 0.0),
    (80.0, 0.5),
)
SECOND_ORDER_DELAY: Final = Model(
    "second_order_delay",
    "second order + delay",
    ("natural_frequency_rad_s", "damping_ratio", "delay_s"),
    (9.0, 1.0, 0.03),
    (0.5, 0.15, 0.0),
    (120.0, 4.0, 0.5),
)
MODELS: Final = (FIRST_ORDER, FIRST_ORDER_DELAY, SECOND_ORDER_DELAY)  # from the simplest


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
    parameters = np.asarray(values, dtype=np.float64)
    delay_s = float(parameters[-1]) if model.parameters[-1] == "delay_s" else 0.0
    late = time_s - delay_s
    arrived = np.maximum(np.searchsorted(setpoint_time_s, late, side="right") - 1, 0)
    steps = np.zeros_like(setpoint_rad)
    steps[1:] = setpoint_rad[1:] - setpoint_rad[:-1]
    wanted: Floats = setpoint_rad[arrived]
    if model.parameters[0] == "bandwidth_rad_s":
        return np.asarray(wanted - _transient(-float(parameters[0]), steps, setpoint_time_s, late, arrived))
    frequency, damping = float(parameters[0]), float(parameters[1])
    apart = damping * damping - 1.0
    if apart < _NEARLY_EQUAL:  # a conjugate pair: the imaginary part of one says both
        pole = frequency * complex(-damping, math.sqrt(max(-apart, _NEARLY_EQUAL)))
        of_pole = _transient(pole, steps, setpoint_time_s, late, arrived)
        return np.asarray(wanted + (of_pole * pole.conjugate()).imag / pole.imag)
    root = math.sqrt(apart)
    fast, slow = frequency * (-damping - root), frequency * (-damping + root)
    of_slow = _transient(slow, steps, setpoint_time_s, late, arrived)
    of_fast = _transient(fast, steps, setpoint_time_s, late, arrived)
    return np.asarray(wanted - (of_slow * fast - of_fast * slow) / (fast - slow))


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
