"""Does the attitude loop answer as certified? The certified responses are flown beside the real one.

Every end of the intervals in the `attitude` section, delay included, is a linear response from the set-point's thrust
direction to the measured one, per axis of the control frame: x is pitch, y is roll. They span a band; how far the
measured direction lies outside of it is what the guard compares. The delay of the link both ways is within what is
compared, as it is within what the certificate assumes.

A transfer function is not watched: it has as many ends as coefficients.
"""

from __future__ import annotations

import math
from collections import deque
from itertools import product
from typing import Final

from companion.attitude_response.discrete import at_rest, step
from companion.attitude_response.kind import LinearResponse, ParametricKind, State, Step
from companion.config.attitude import ResponseSection

_MOST: Final = 128  # set-points kept: two and a half seconds of them, and kinds of intervals between samples


def ends(section: ResponseSection | None) -> tuple[LinearResponse, ...]:
    """The corners of a response's intervals; none for a transfer function, or for no axis."""
    if section is None or not issubclass(kind := section.kind, ParametricKind):
        return ()
    axes = [sorted(set(v)) if isinstance(v, tuple) else [v] for v in (*section.values, section.delay_s)]
    return tuple(LinearResponse(kind, corner[:-1], corner[-1]) for corner in product(*axes))


class Axis:
    """The responses of one axis, each in two directions: so a turn of the axis changes none of them."""

    def __init__(self, responses: tuple[LinearResponse, ...]) -> None:
        self._responses = responses
        self._delays_s = [response.delay_s for response in responses]
        self._north: list[State] = [at_rest(response, 0.0) for response in responses]
        self._east = self._north
        self._steps: dict[int, list[Step]] = {}

    def begin(self, north: float, east: float) -> None:
        """Every response where the vehicle is, at rest."""
        self._north = [at_rest(response, north) for response in self._responses]
        self._east = [at_rest(response, east) for response in self._responses]

    def advance(self, dt_s: float, time_s: float, past: Past) -> None:
        """A step of `dt_s` to `time_s`."""
        key = round(dt_s * 1e4)  # samples come at a handful of intervals
        steps = self._steps.get(key)
        if steps is None:
            if len(self._steps) > _MOST:
                self._steps.clear()
            steps = self._steps[key] = [step(response, key * 1e-4) for response in self._responses]
        inputs = {delay_s: past.at(time_s - 0.5 * dt_s - delay_s) for delay_s in set(self._delays_s)}  # amid the step
        wanted = [inputs[delay_s] for delay_s in self._delays_s]
        self._north = [move(at, u) for move, at, (_, u, _) in zip(steps, self._north, wanted, strict=True)]
        self._east = [move(at, u) for move, at, (_, _, u) in zip(steps, self._east, wanted, strict=True)]

    def outside(self, along_n: float, along_e: float, measured: float) -> float:
        """How far `measured`, along this axis, lies outside the band of the responses."""
        states = zip(self._north, self._east, strict=True)
        answers = [along_n * at_north[0] + along_e * at_east[0] for at_north, at_east in states]
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


class ResponseBand:
    """Both axes in the control frame. Without a response on either there is nothing to see: not a number.

    Attribute: `watched`, the axes that are.
    """

    def __init__(self, x: ResponseSection, y: ResponseSection | None) -> None:
        self._axes = [(Axis(responses) if (responses := ends(section)) else None) for section in (x, y)]
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
