"""The estimator between truth and autopilot in the compiled loop: `sitl.world.estimator` without faults."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from sitl.campaign.mersenne import Floats, Words, normal, uniform
from sitl.world import navigation_error
from sitl.world.estimator import LONGEST_DELAY_S, LONGEST_STEP_S
from sitl.world.navigation_error import AxisError, ErrorState
from sitl.world.sensing import Pose, between, noisy

_PAST: Final = (
    2048  # reports kept at most: two seconds of one each millisecond, more than are asked for in the longest delay
)

Times = npt.NDArray[np.int64]


class Sensors(NamedTuple):
    """What is wrong with the report; each part only where it is switched on."""

    used: bool  # or else the report is the truth
    noise: bool
    position_m: float
    velocity_m_s: float
    attitude_rad: float
    correlation_s: float
    lag: bool
    delay_s: float
    jitter_s: float
    error: bool
    north: AxisError
    east: AxisError
    down: AxisError


class Memory(NamedTuple):
    """What is left from one report to the next, changed in place.

    `markov` (9,) errors of position, velocity, angles; `errors` (3, 4) an `ErrorState` a row; `past_us` (n,) and `past`
    (n, 10) the poses that a delay looks back to, from `marks[1]` on, `marks[2]` of them; `marks[0]`, when it was asked
    last; `words`, `kept` the generator.
    """

    markov: Floats
    errors: Floats
    past_us: Times
    past: Floats
    marks: Times
    words: Words
    kept: Floats


def empty_past() -> tuple[Times, Floats]:
    """Room for the past."""
    return np.zeros(_PAST, dtype=np.int64), np.zeros((_PAST, 10))


def report(sensors: Sensors, memory: Memory, truth: Pose, now_us: int) -> Pose:
    """What is reported at a time, which must be later than the last."""
    markov, errors, past_us, past, marks, words, kept = memory
    dt_s = max(1e-6 * (now_us - marks[0]), 0.0)
    marks[0] = now_us
    if sensors.error and dt_s > 0.0:
        steps = math.ceil(dt_s / LONGEST_STEP_S)
        for _ in range(steps):
            _move(sensors.north, errors[0], dt_s / steps, words, kept)
            _move(sensors.east, errors[1], dt_s / steps, words, kept)
            _move(sensors.down, errors[2], dt_s / steps, words, kept)
    pose = truth
    if sensors.lag:
        pose = _late(sensors, past_us, past, marks, words, truth, now_us)
    if sensors.error:
        (x, y, z), (vx, vy, vz), attitude = pose
        pose = (
            (x + errors[0, 0], y + errors[1, 0], z + errors[2, 0]),
            (vx + errors[0, 1], vy + errors[1, 1], vz + errors[2, 1]),
            attitude,
        )
    if sensors.noise:
        decay = math.exp(-dt_s / sensors.correlation_s)
        drive = math.sqrt(1.0 - decay * decay)
        for place in range(9):
            deviation = sensors.position_m if place < 3 else sensors.velocity_m_s if place < 6 else sensors.attitude_rad
            markov[place] = decay * markov[place] + deviation * drive * normal(words, kept)
        pose = noisy(
            pose,
            (markov[0], markov[1], markov[2]),
            (markov[3], markov[4], markov[5]),
            (markov[6], markov[7], markov[8]),
        )
    return pose


def _move(params: AxisError, state: Floats, dt_s: float, words: Words, kept: Floats) -> None:
    n1 = normal(words, kept)
    n2 = normal(words, kept)
    n3 = normal(words, kept)
    moved = navigation_error.step(params, ErrorState(state[0], state[1], state[2], state[3]), dt_s, n1, n2, n3)
    state[0], state[1], state[2], state[3] = moved


def _at(past: Floats, place: int) -> Pose:
    row = past[place % _PAST]
    return (row[0], row[1], row[2]), (row[3], row[4], row[5]), (row[6], row[7], row[8], row[9])


def remember(past_us: Times, past: Floats, marks: Times, pose: Pose, at_us: int) -> None:
    """Put a pose to the past, and forget what no delay reaches."""
    place = (marks[1] + marks[2]) % _PAST
    past_us[place] = at_us
    (x, y, z), (vx, vy, vz), (qw, qx, qy, qz) = pose
    row = past[place]
    row[0], row[1], row[2], row[3], row[4], row[5] = x, y, z, vx, vy, vz
    row[6], row[7], row[8], row[9] = qw, qx, qy, qz
    marks[2] += 1
    while marks[2] > 2 and at_us - past_us[(marks[1] + 1) % _PAST] > 1e6 * LONGEST_DELAY_S:
        marks[1] += 1
        marks[2] -= 1


def _late(sensors: Sensors, past_us: Times, past: Floats, marks: Times, words: Words, truth: Pose, now_us: int) -> Pose:
    """The pose of a while ago, between two that were looked at."""
    remember(past_us, past, marks, truth, now_us)
    age_s = sensors.delay_s + sensors.jitter_s * uniform(words)
    wanted_us = now_us - min(age_s, LONGEST_DELAY_S) * 1e6
    newest = marks[1] + marks[2] - 1
    for later in range(newest, marks[1], -1):
        earlier_us = past_us[(later - 1) % _PAST]
        if earlier_us <= wanted_us:
            share = (wanted_us - earlier_us) / (past_us[later % _PAST] - earlier_us)
            return between(_at(past, later - 1), _at(past, later), share)
    return _at(past, marks[1])
