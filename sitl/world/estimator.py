"""The estimator between the truth and everybody: noise, delay, drift, resets, freezes, and numbers that are none.

Without it the autopilot believes the truth. With it, autopilot and companion alike see what it says.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable
from itertools import pairwise
from random import Random
from typing import Final, NamedTuple

from sitl.vehicles.rotation import Quaternion, turned
from sitl.vehicles.vehicle import Vector, VehicleState
from sitl.world.lies import Liar
from sitl.world.navigation_error import ErrorState, NavigationError, settled
from sitl.world.navigation_error import step as step_error
from sitl.world.sensing import between, noisy

_STILL: Final = (0.0, 0.0, 0.0)
_FORGET_S: Final = 1.0  # time in which a jump of the velocity estimate converges back to the truth
LONGEST_DELAY_S: Final = 1.0
LONGEST_STEP_S: Final = 0.02  # of the errors


class Noise(NamedTuple):
    """Standard deviations per axis, first-order Markov with one correlation time."""

    position_m: float = 0.0
    velocity_m_s: float = 0.0
    attitude_rad: float = 0.0
    correlation_s: float = 0.5


class Lag(NamedTuple):
    """How old a state is reported as the present one: a delay, and a uniform random part on top of it."""

    delay_s: float = 0.0
    jitter_s: float = 0.0


class Estimator:
    """Reports the state of a vehicle, wrongly. Call it for the estimate now; the same instant gives the same answer.

    Args: `truth` of now, `now_us` simulated time, `random` of its own; `noise`, `lag` and `error` of what it reports,
    where there are any.
    Attributes: `frozen` repeats the last report; `not_a_number` puts NaN into the position; `drift_ned_m_s` moves the
    reported position without touching the velocity; `yaw_offset_rad` and `offset_ned_m` of the report from the truth;
    `lies` told of single quantities, one after the other; `renewed_hz`, at which the report changes, 0 for each.
    """

    def __init__(
        self,
        truth: Callable[[], VehicleState],
        now_us: Callable[[], int],
        random: Random,
        noise: Noise | None = None,
        lag: Lag | None = None,
        error: NavigationError | None = None,
    ) -> None:
        self._truth = truth
        self._now_us = now_us
        self._random = random
        self._past: deque[tuple[int, VehicleState]] = deque()
        self._at_us = now_us()
        self._report: VehicleState | None = None
        self._noise_state = [0.0] * 9
        self._velocity_offset = _STILL
        self.noise = noise or Noise()
        self.lag = lag or Lag()
        self._error = error
        self._errors: list[ErrorState] = [settled(axis, self._normal) for axis in error or ()]
        self.offset_ned_m: Vector = _STILL
        self.drift_ned_m_s: Vector = _STILL
        self.yaw_offset_rad = 0.0
        self.frozen = False
        self.not_a_number = False
        self.lies: list[Liar] = []
        self.renewed_hz = 0.0

    def jump(self, position_ned_m: Vector, velocity_ned_m_s: Vector = _STILL, yaw_rad: float = 0.0) -> None:
        """The report moves at once; whoever calls also steps the reset counter, or does not."""
        self.offset_ned_m = _add(self.offset_ned_m, position_ned_m)
        self._velocity_offset = _add(self._velocity_offset, velocity_ned_m_s)
        self.yaw_offset_rad += yaw_rad
        self._report = None

    def __call__(self) -> VehicleState:
        now_us = self._now_us()
        if self._report is not None and (self.frozen or now_us == self._at_us or self._keeps(now_us)):
            return self._report
        dt_s = max(1e-6 * (now_us - self._at_us), 0.0)
        self._at_us = now_us
        self._move(dt_s)
        self._step_errors(dt_s)
        report = self._reported(self._delayed(now_us), dt_s)
        for lie in self.lies:
            report = lie(report, 1e-6 * now_us)
        self._report = report
        return report

    def _keeps(self, now_us: int) -> bool:
        return self.renewed_hz > 0.0 and (now_us - self._at_us) * self.renewed_hz < 1e6

    def _normal(self) -> float:
        return self._random.gauss(0.0, 1.0)

    def _step_errors(self, dt_s: float) -> None:
        if self._error is None or dt_s <= 0.0:
            return
        steps = math.ceil(dt_s / LONGEST_STEP_S)
        for _ in range(steps):
            self._errors = [
                step_error(axis, state, dt_s / steps, self._normal(), self._normal(), self._normal())
                for axis, state in zip(self._error, self._errors, strict=True)
            ]

    def _move(self, dt_s: float) -> None:
        if self.drift_ned_m_s != _STILL:
            self.offset_ned_m = _add(self.offset_ned_m, _scaled(self.drift_ned_m_s, dt_s))
        if self._velocity_offset != _STILL:
            self._velocity_offset = _scaled(self._velocity_offset, math.exp(-dt_s / _FORGET_S))

    def _delayed(self, now_us: int) -> VehicleState:
        truth = self._truth()
        if self.lag == Lag():
            return truth
        past = self._past
        past.append((now_us, truth))
        while len(past) > 2 and now_us - past[1][0] > 1e6 * LONGEST_DELAY_S:
            past.popleft()
        age_s = self.lag.delay_s + self.lag.jitter_s * self._random.random()
        wanted_us = now_us - min(age_s, LONGEST_DELAY_S) * 1e6
        for (later_us, later), (earlier_us, earlier) in pairwise(reversed(past)):
            if earlier_us <= wanted_us:
                return _between(earlier, later, (wanted_us - earlier_us) / (later_us - earlier_us))
        return past[0][1]

    def _reported(self, state: VehicleState, dt_s: float) -> VehicleState:
        position, velocity, q_wxyz, rates, force = state
        position = _add(position, self.offset_ned_m)
        velocity = _add(velocity, self._velocity_offset)
        if self._errors:
            position = _add(position, _vector(error.position_m for error in self._errors))
            velocity = _add(velocity, _vector(error.velocity_m_s for error in self._errors))
        if self.yaw_offset_rad:
            q_wxyz = turned(q_wxyz, self.yaw_offset_rad)
        if self.noise[:3] != _STILL:
            position, velocity, q_wxyz = self._noisy(position, velocity, q_wxyz, dt_s)
        if self.not_a_number:
            position = (math.nan, math.nan, math.nan)
        return VehicleState(position, velocity, q_wxyz, rates, force)

    def _noisy(
        self, position: Vector, velocity: Vector, q_wxyz: Quaternion, dt_s: float
    ) -> tuple[Vector, Vector, Quaternion]:
        noise, state, normal = self.noise, self._noise_state, self._random.gauss
        decay = math.exp(-dt_s / noise.correlation_s)
        drive = math.sqrt(1.0 - decay * decay)
        for place, deviation in enumerate(
            (*(noise.position_m,) * 3, *(noise.velocity_m_s,) * 3, *(noise.attitude_rad,) * 3)
        ):
            state[place] = decay * state[place] + deviation * drive * normal(0.0, 1.0)
        ex, ey, ez, evx, evy, evz, roll, pitch, yaw = state
        return noisy((position, velocity, q_wxyz), (ex, ey, ez), (evx, evy, evz), (roll, pitch, yaw))


def _between(a: VehicleState, b: VehicleState, share: float) -> VehicleState:
    position, velocity, q_wxyz = between(a[:3], b[:3], share)
    px, py, pz = a.rates_frd_rad_s
    qx, qy, qz = b.rates_frd_rad_s
    rates = (px + share * (qx - px), py + share * (qy - py), pz + share * (qz - pz))
    return VehicleState(position, velocity, q_wxyz, rates, b.specific_force_frd_m_s2)


def _vector(values: Iterable[float]) -> Vector:
    x, y, z = values
    return x, y, z


def _add(a: Vector, b: Vector) -> Vector:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def _scaled(a: Vector, factor: float) -> Vector:
    return factor * a[0], factor * a[1], factor * a[2]
