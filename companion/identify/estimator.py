"""How wrong an estimated velocity is, from a log alone: by how much the slope of the position differs from it.

Where the position is aided, the slow part of that difference is the error of the velocity with the other sign
(`docs/estimator.md`): e_p' = e_v - k1 e_p + n, and e_p hardly grows over times far above 1/k1. In the plant's models,
over 8 min, its deviation is 0.91 to 0.96 of the velocity error's, and its time constant 1.1 to 1.2 of it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from companion.config.estimator import VelocityError
from companion.control import estimate_correction
from companion.control.types import Odometry
from companion.identify.manoeuvres import intervals_inside
from companion.identify.series import OURS, Estimate, Floats, Recording, intersect

SHORTEST_S: Final = 20.0  # in control; the error's time constant is seconds
LEAST_M_S: Final = 0.005  # below it nothing aids the position, or the estimate is the truth: it tells nothing
_FILTER: Final = estimate_correction.CorrectionParams(0.3, 0.0, 1.0, 2.0)
_SETTLE_S: Final = 2.0
_GRID_S: Final = 0.05


def velocity_error(recordings: Sequence[Recording]) -> VelocityError | None:
    """Of the longest log that has it, both axes together; None where none has, or nothing aids the position."""
    found = [differences for recording in recordings for differences in _differences(recording)]
    longest = max(found, key=len, default=np.empty((0, 2)))
    if len(longest) * _GRID_S < SHORTEST_S:
        return None
    centred = longest - longest.mean(axis=0)
    deviation = float(np.sqrt(np.mean(centred**2)))
    return VelocityError(deviation, _time_s(centred)) if deviation >= LEAST_M_S else None


def _differences(recording: Recording) -> list[Floats]:
    """Low-passed slope less velocity, m/s, shape (n, 2) each, on an even grid: of each stretch in control."""
    estimate = recording.estimate
    if estimate is None or len(estimate.time_s) < 2:
        return []
    spans = recording.following
    if not len(spans) and recording.in_flight is not None:
        spans = recording.in_flight
    if recording.track.clock == OURS:  # the estimate's clock is the vehicle's: by the stamps of the attitude
        spans = np.interp(spans, recording.track.attitude_time_s, recording.stamps_s)
    resets_s = estimate.resets_s  # a jump of the position is no error of the velocity
    between = np.stack([np.append(-np.inf, resets_s), np.append(np.nextafter(resets_s, -np.inf), np.inf)], axis=1)
    spans = intersect(spans, between)
    stretches = intervals_inside(spans, float(estimate.time_s[0]), float(estimate.time_s[-1]))
    return [_difference(estimate, start_s, stop_s) for start_s, stop_s in stretches]


def _difference(estimate: Estimate, start_s: float, stop_s: float) -> Floats:
    inside = (estimate.time_s >= start_s) & (estimate.time_s <= stop_s)
    rows = np.column_stack([estimate.time_s, estimate.position_m, estimate.velocity_m_s])[inside].tolist()
    state: estimate_correction.CorrectionState | None = None
    last_s, said = 0.0, list[tuple[float, float, float]]()
    for time_s, x, y, vx, vy in rows:
        sample = Odometry(time_s, x, y, 0.0, vx, vy, 0.0, 1.0, 0.0, 0.0, 0.0)
        state = state or estimate_correction.start(sample)
        state, corrected = estimate_correction.step(_FILTER, state, sample, max(time_s - last_s, 0.0) if said else 0.0)
        said.append((time_s, corrected.vx_m_s - vx, corrected.vy_m_s - vy))
        last_s = time_s
    if not said or said[-1][0] - said[0][0] < _SETTLE_S:
        return np.empty((0, 2))
    series = np.array(said)
    grid = np.arange(series[0, 0] + _SETTLE_S, series[-1, 0], _GRID_S)
    return np.column_stack([np.interp(grid, series[:, 0], series[:, n]) for n in (1, 2)])


def _time_s(centred: Floats) -> float:
    """When the autocorrelation, of both columns together, falls to 1/e."""
    n = len(centred)
    spectrum = np.abs(np.fft.rfft(centred, 2 * n, axis=0)) ** 2
    correlation = np.fft.irfft(spectrum.sum(axis=1))[:n]
    below = np.flatnonzero(correlation < math.exp(-1.0) * correlation[0])
    return max(float(below[0]) * _GRID_S, _GRID_S) if len(below) else n * _GRID_S
