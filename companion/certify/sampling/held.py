"""The loop as it is sampled and held, flown at the slowest tick with weights that stand still.

The proof is about the loop in continuous time. What flies is sampled, and its command held over a tick: with a slow
tick it may grow although the proof is right. Two loops are flown, with the exact step of the attitude response and its
true delay, the command held; what grows is refused:

- the vehicle itself, under the nominal weights of Assumption 1, where nothing adapts;
- the loop of the theorem, the hedged reference model (20) with e = 0 and the hedge's mean of two samples, at the four
  corners of the weight bounds. (The vehicle at such a corner may grow: there the adaptation must move the weights.)

It is a necessary condition, no proof: weights that move are not flown, and the hold drives the error e, which the
theorem takes for bounded by the adaptation in continuous time. A transfer function has no step and is not flown.

Standard library only, in floating point: `companion run` checks it too."""

from __future__ import annotations

import itertools
import math
from collections import deque
from collections.abc import Callable, Iterator
from typing import Final

from companion.attitude_response.exact import ends
from companion.attitude_response.kind import ParametricKind
from companion.certify.problem import AxisProblem, Sampling, nominal_weights
from companion.control.reference_model import Transition, transition

_PERIODS: Final = 3  # of the reference model, in each of three windows: what grows shows in the last
_PIECE_S: Final = 0.005  # of a tick, over which the vehicle's force is taken for a line
_STILL: Final = 1e-9  # of the start: what has died out


def grows(problem: AxisProblem, sampling: Sampling) -> tuple[float, float] | None:
    """(position, velocity) weight in rad/m and rad s/m at which a held loop grows; None if all die out.

    Parameters
    ----------
    problem
        Axis, with its delay and every corner of its response.
    sampling
        Only its tick rate is used.
    """
    dynamics = problem.response.dynamics
    if not isinstance(dynamics, ParametricKind):
        return None
    dt_s = 1 / float(sampling.tick_rate_hz)
    wn, g = float(problem.natural_frequency_rad_s), float(problem.gravity_m_s2)
    over = transition(wn, float(problem.damping_ratio), dt_s)
    ticks = math.ceil(_PERIODS * 2 * math.pi / wn / dt_s)
    responses = list(itertools.product(*map(ends, dynamics.intervals())))
    corners = itertools.product(*zip(problem.weights_lower, problem.weights_upper, strict=True))
    reference = sorted({(float(p), float(v)) for p, v in corners})
    nominal = tuple(map(float, nominal_weights(problem)))
    for response, delay in itertools.product(responses, ends(problem.response.delay_s)):
        loop = _Loop(dynamics, tuple(map(float, response)), float(delay), dt_s)
        if _rises(_vehicle(loop, (g * nominal[0], g * nominal[1])), ticks):
            return nominal[0], nominal[1]
        for position, velocity in reference:
            if _rises(_reference(loop, over, (g * position, g * velocity)), ticks):
                return position, velocity
    return None


class _Loop:
    """An attitude response behind its delay, the set-point held over each tick; specific force, m/s^2."""

    def __init__(self, dynamics: ParametricKind, values: tuple[float, ...], delay_s: float, dt_s: float) -> None:
        ticks, late_s = divmod(delay_s, dt_s)
        self._ticks, self.dt_s = int(ticks), dt_s
        self._dynamics, self._values = dynamics, values
        self._start = (0.0, 0.0, *(0.0,) * dynamics.further)
        self._pieces = [(late_s, 0), (dt_s - late_s, 1)]  # length, and which of the two oldest set-points acts

    def begin(self, pieces_of_s: float) -> Callable[[float], list[tuple[float, float, float]]]:
        """From the set-point of a tick to (length, force at the begin, at the end) of the pieces of that tick."""
        plan = []
        for length_s, which in self._pieces:
            if length_s > 0:
                count = math.ceil(length_s / pieces_of_s)
                plan.append((count, length_s / count, self._dynamics.step(self._values, length_s / count), which))
        waiting = deque([0.0] * (self._ticks + 1))
        state = self._start

        def tick(setpoint: float) -> list[tuple[float, float, float]]:
            nonlocal state
            waiting.append(setpoint)
            acting, flown = (waiting.popleft(), waiting[0]), []
            for count, length_s, step, which in plan:
                for _ in range(count):
                    after = step(state, acting[which])
                    flown.append((length_s, state[0], after[0]))
                    state = after
            return flown

        return tick


def _vehicle(loop: _Loop, weights: tuple[float, float]) -> Iterator[float]:
    """Position at each tick of the double integrator under weights times g."""
    tick, p, v = loop.begin(_PIECE_S), 1.0, 0.0
    while True:
        yield p
        for length_s, begin, end in tick(-weights[0] * p - weights[1] * v):  # the force is a line over so short a piece
            p += length_s * (v + length_s * (begin / 3 + end / 6))
            v += length_s * (begin + end) / 2


def _reference(loop: _Loop, over: Transition, weights: tuple[float, float]) -> Iterator[float]:
    """Position at each tick of the hedged reference model under weights times g."""
    f11, f12, f21, f22, g1, g2 = over
    tick, p, v, w = loop.begin(loop.dt_s), 1.0, 0.0, 0.0
    while True:
        yield p
        u = -weights[0] * p - weights[1] * v
        before, w = w, tick(u)[-1][2]
        drive = 0.5 * (before + w) - u
        p, v = f11 * p + f12 * v + g1 * drive, f21 * p + f22 * v + g2 * drive


def _rises(positions: Iterator[float], ticks: int) -> bool:
    """Whether position is larger in the last of three windows than in the one before."""
    peaks = [max(abs(position) for position in itertools.islice(positions, ticks)) for _ in range(3)]
    return not peaks[2] < max(peaks[1], _STILL)
