"""Two identifications of a vehicle, before and after a change: which axis is faster, at 95 %.

Compared is the bandwidth, the frequency at which the response falls to -3 dB: it is known far better than natural
frequency and damping each, which make up for each other. Its logarithm is taken as normal, with the variance that the
parameters' covariance gives it (delta method) and Student's t. All axes hold together (Bonferroni): of 100 pairs of
equal vehicles 5 at most have an axis that is called different.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from scipy.stats import t as student

from companion.attitude_response.kinds import MODELS, SecondOrder
from companion.identify.fit import CONFIDENCE, ModelFit
from companion.identify.identification import Identification
from companion.identify.series import AXES, Floats, LogError

FASTER: Final = "faster"
SLOWER: Final = "slower"
EQUAL: Final = "not distinguishable"
_STEP: Final = 1e-4


class Bandwidth(NamedTuple):
    """Of one response: value and the standard error of its logarithm, which is known with so many degrees of freedom.

    `interval_rad_s` belongs to this one alone, at the confidence of the comparison.
    """

    bandwidth_rad_s: float
    log_error: float
    freedom: float
    interval_rad_s: tuple[float, float]


class AxisComparison(NamedTuple):
    """One axis: both bandwidths, their ratio after over before with its interval, and the verdict."""

    model: str
    before: Bandwidth
    after: Bandwidth
    ratio: float
    ratio_95: tuple[float, float]
    verdict: str


class Comparison(NamedTuple):
    """By axis; and why an axis is missing."""

    axes: dict[str, AxisComparison]
    missing: dict[str, str]


def compare(before: Identification, after: Identification) -> Comparison:
    """What changed from one log to the other. Raises `LogError` where no axis is in both."""
    missing = {
        axis: reason
        for axis in AXES
        for reason in (before.refused.get(axis), after.refused.get(axis))
        if reason is not None
    }
    both: list[str] = [axis for axis in AXES if axis in before.axes and axis in after.axes]
    if not both:
        raise LogError(f"nothing to compare, no axis is identified from both logs: {next(iter(missing.values()))}")
    compared: dict[str, AxisComparison] = {}
    for axis in both:
        chosen = [found.axes[axis].chosen.model.name for found in (before, after)]
        model = [m.name for m in MODELS if m.name in chosen][-1]  # the richer one: alike in both
        compared[axis] = _axis(before.axes[axis].models[model], after.axes[axis].models[model], len(both))
    return Comparison(compared, missing)


def bandwidth_rad_s(fit: ModelFit, values: Sequence[float] | Floats) -> float:
    """Frequency of -3 dB of a model with other values; a delay has no part in it."""
    if fit.model.kind is not SecondOrder:
        return float(values[0])
    frequency, damping = values[:2]
    middle = 1.0 - 2.0 * damping * damping
    return float(frequency) * math.sqrt(middle + math.sqrt(1.0 + middle * middle))


def _axis(before: ModelFit, after: ModelFit, axes: int) -> AxisComparison:
    share = 1.0 - 0.5 * (1.0 - CONFIDENCE) / axes
    one, other = _bandwidth(before, share), _bandwidth(after, share)
    error = math.hypot(one.log_error, other.log_error)
    freedom = error**4 / (one.log_error**4 / one.freedom + other.log_error**4 / other.freedom)  # Welch, Satterthwaite
    half = float(student.ppf(share, freedom)) * error
    ratio = other.bandwidth_rad_s / one.bandwidth_rad_s
    ends = ratio * math.exp(-half), ratio * math.exp(half)
    verdict = FASTER if ends[0] > 1.0 else SLOWER if ends[1] < 1.0 else EQUAL
    return AxisComparison(before.model.name, one, other, ratio, ends, verdict)


def _bandwidth(fit: ModelFit, share: float) -> Bandwidth:
    values = np.array(fit.values)
    middle = bandwidth_rad_s(fit, fit.values)
    slope = np.zeros(len(values))
    for k, step in enumerate(_STEP * values):
        if step > 0.0:
            up, down = values.copy(), values.copy()
            up[k] += step
            down[k] -= step
            slope[k] = math.log(bandwidth_rad_s(fit, up) / bandwidth_rad_s(fit, down)) / (2.0 * step)
    error = max(math.sqrt(float(slope @ fit.covariance @ slope)), 1e-9)
    half = float(student.ppf(share, fit.freedom)) * error
    return Bandwidth(middle, error, fit.freedom, (middle * math.exp(-half), middle * math.exp(half)))


def to_json(comparison: Comparison, before: Identification, after: Identification) -> dict[str, Any]:
    """The object that `--compare --json` prints; SI."""
    return {
        "axes": {
            name: {
                "verdict": axis.verdict,
                "model": axis.model,
                "bandwidth_ratio": axis.ratio,
                "bandwidth_ratio_95": list(axis.ratio_95),
                **{
                    when: {"bandwidth_rad_s": b.bandwidth_rad_s, "interval_95": list(b.interval_rad_s)}
                    for when, b in (("before", axis.before), ("after", axis.after))
                },
            }
            for name, axis in comparison.axes.items()
        },
        "missing": comparison.missing,
        "before": [str(path) for path in before.paths],
        "after": [str(path) for path in after.paths],
    }


def sentences(comparison: Comparison) -> list[str]:
    """One line an axis."""
    said = []
    for name, axis in comparison.axes.items():
        low, high = (100.0 * (end - 1.0) for end in axis.ratio_95)
        said.append(
            f"{name}: {axis.verdict}: bandwidth {axis.before.bandwidth_rad_s:.2f} rad/s before, "
            f"{axis.after.bandwidth_rad_s:.2f} after, {100.0 * (axis.ratio - 1.0):+.1f} % ({low:+.1f} to {high:+.1f} %)"
        )
    return said
