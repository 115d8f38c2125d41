"""Does the attitude loop answer as certified? The certified responses are flown beside the real one.

Every end of the intervals in the `attitude` section, delay included, is a linear model from the set-point's thrust
direction to the measured one, per axis of the control frame: x is pitch, y is roll. The models span a band; how far the
measured direction lies outside of it is what the guard compares. The delay of the link both ways is within what is
compared, as it is within what the certificate assumes.

First and second order are watched. A transfer function is not: it has as many ends as coefficients.
"""

from __future__ import annotations

import math
from collections import deque
from itertools import product
from typing import Final, NamedTuple

from companion.config.attitude import ResponseSection

_MOST: Final = 128  # set-points kept: two and a half seconds of them, and kinds of intervals between samples


class Model(NamedTuple):
    """First order (`damping_ratio` zero) or second order, behind a delay."""

    rate_rad_s: float  # bandwidth or natural frequency
    damping_ratio: float
    delay_s: float


class Step(NamedTuple):
    """One step of a model with its input held: (p, v)' = A (p - u, v) + (u, 0)."""

    pp: float
    pv: float
    vp: float
    vv: float


def ends(section: ResponseSection | None) -> tuple[Model, ...]:
    """The corners of a response's intervals; none for a transfer function, or for no axis."""
    if section is None or section.numerator is not None:
        return ()
    rates = section.bandwidth_rad_s or section.natural_frequency_rad_s
    ratios = section.damping_ratio or 0.0
    axes = [sorted(set(value)) if isinstance(value, tuple) else [value] for value in (rates, ratios, section.delay_s)]
    return tuple(Model(*corner) for corner in product(*axes))  # type: ignore[arg-type]


def step(model: Model, dt_s: float) -> Step:
    """The model's exact step: the exponential of its matrix, by its series after halving it until it is small."""
    rate, ratio, _ = model
    if ratio == 0.0:
        return Step(math.exp(-rate * dt_s), 0.0, 0.0, 0.0)
    halvings = max(0, math.ceil(math.log2(max(rate * dt_s * (1.0 + 2.0 * ratio), 1e-9))) + 4)
    h = dt_s / 2**halvings
    a = ((0.0, h), (-rate * rate * h, -2.0 * ratio * rate * h))
    total = term = ((1.0, 0.0), (0.0, 1.0))
    for n in range(1, 9):
        term = _product(term, a, 1.0 / n)
        total = tuple(tuple(s + t for s, t in zip(*rows, strict=True)) for rows in zip(total, term, strict=True))  # type: ignore[assignment]
    for _ in range(halvings):
        total = _product(total, total, 1.0)
    return Step(total[0][0], total[0][1], total[1][0], total[1][1])


_Matrix = tuple[tuple[float, float], tuple[float, float]]


def _product(a: _Matrix, b: _Matrix, scale: float) -> _Matrix:
    (a11, a12), (a21, a22) = a
    (b11, b12), (b21, b22) = b
    return (
        (scale * (a11 * b11 + a12 * b21), scale * (a11 * b12 + a12 * b22)),
        (scale * (a21 * b11 + a22 * b21), scale * (a21 * b12 + a22 * b22)),
    )


class Axis:
    """The models of one axis. Their states are horizontal vectors, so that a turn of the axis changes none of them."""

    def __init__(self, models: tuple[Model, ...]) -> None:
        self._models = models
        self._delays_s = [model.delay_s for model in models]
        self._states = [(0.0, 0.0, 0.0, 0.0)] * len(models)
        self._steps: dict[int, list[Step]] = {}

    def begin(self, north: float, east: float) -> None:
        """Every model where the vehicle is, at rest."""
        self._states = [(north, 0.0, east, 0.0)] * len(self._models)

    def advance(self, dt_s: float, time_s: float, past: Past) -> None:
        """A step of `dt_s` to `time_s`."""
        key = round(dt_s * 1e4)  # samples come at a handful of intervals
        steps = self._steps.get(key)
        if steps is None:
            if len(self._steps) > _MOST:
                self._steps.clear()
            steps = self._steps[key] = [step(model, key * 1e-4) for model in self._models]
        inputs = {delay_s: past.at(time_s - 0.5 * dt_s - delay_s) for delay_s in set(self._delays_s)}  # amid the step
        states = []
        for delay_s, (pp, pv, vp, vv), (p_n, v_n, p_e, v_e) in zip(self._delays_s, steps, self._states, strict=True):
            _, u_n, u_e = inputs[delay_s]
            d_n, d_e = p_n - u_n, p_e - u_e
            states.append(
                (u_n + pp * d_n + pv * v_n, vp * d_n + vv * v_n, u_e + pp * d_e + pv * v_e, vp * d_e + vv * v_e)
            )
        self._states = states

    def outside(self, along_n: float, along_e: float, measured: float) -> float:
        """How far `measured`, along this axis, lies outside the band of the models."""
        answers = [along_n * p_n + along_e * p_e for p_n, _, p_e, _ in self._states]
        return max(min(answers) - measured, measured - max(answers), 0.0)


class Past:
    """The set-points of the last second: north and east of their thrust directions."""

    def __init__(self, time_s: float, north: float, east: float) -> None:
        self._points = deque([(time_s, north, east)], maxlen=_MOST)

    def add(self, time_s: float, north: float, east: float) -> None:
        self._points.append((time_s, north, east))

    def at(self, time_s: float) -> tuple[float, float, float]:
        """What was in force at a time: (since when, north, east)."""
        for point in reversed(self._points):
            if point[0] <= time_s:
                return point
        return self._points[0]


class Response:
    """Both axes in the control frame. Without a model on either there is nothing to see: not a number.

    Attribute: `watched`, the axes that are.
    """

    def __init__(self, x: ResponseSection, y: ResponseSection | None) -> None:
        self._axes = [(Axis(models) if (models := ends(section)) else None) for section in (x, y)]
        self.watched = [name for name, axis in zip("xy", self._axes, strict=True) if axis is not None]
        self._past: Past | None = None
        self._time_s = 0.0

    def advance(
        self, time_s: float, heading_rad: float, measured: tuple[float, float], commanded: tuple[float, float]
    ) -> float:
        """How far the response is outside the certified band, rad.

        `measured` and `commanded` (in force from now on) are north and east of the thrust direction; `heading_rad` is
        the control frame's.
        """
        if not self.watched:
            return math.nan
        begins = self._past is None
        past = self._past = self._past or Past(time_s, *measured)
        c, s = math.cos(heading_rad), math.sin(heading_rad)
        worst = 0.0
        for axis, along_n, along_e in zip(self._axes, (c, -s), (s, c), strict=True):
            if axis is None:
                continue
            if begins:
                axis.begin(*measured)
            else:
                axis.advance(time_s - self._time_s, time_s, past)
            worst = max(worst, axis.outside(along_n, along_e, along_n * measured[0] + along_e * measured[1]))
        past.add(time_s, *commanded)
        self._time_s = time_s
        return worst
