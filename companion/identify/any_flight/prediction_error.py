"""Fit a model to stretches in which anything may disturb the attitude: the prediction-error method.

Wind and the estimator disturb the attitude, and in Position mode or a mission the position loop answers with
set-points: set-point and disturbance are correlated, and plain least squares is biased. So the disturbance has a model
of its own, fitted together with the response (Box-Jenkins; L. Ljung, System Identification, 2nd ed., 7.3 and 13.4):

    attitude(k) = response(set-points until k) + v(k),    v(k) = a1 v(k-1) + ... + ap v(k-p) + e(k)

and what is minimised is the sum of e², the error of predicting a sample from all that was measured before it. That is
consistent in a closed loop of which nothing is known, as long as the loop has a delay (the response has: two
integrations, and PX4's control step) and the model of the disturbance is rich enough: p spans `_MEMORY_S`.

The coefficients a are eliminated at every step (variable projection; Kaufman's Jacobian), so that the curvature left is
the Fisher information of the response's parameters with those of the disturbance unknown. The interval is that of the
information, or of the scatter of the fits that leave one stretch out (a jackknife over blocks, Student's t) where that
is wider: it holds where the residual is not as white as the model wants it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares

from companion.attitude_response.kinds import Model
from companion.identify.any_flight.stretches import curves, roughened, seldom
from companion.identify.fit import ModelFit, error, half_widths, sensitivity, widened
from companion.identify.manoeuvres import Manoeuvre
from companion.identify.series import Floats

Indices = npt.NDArray[np.intp]

_MEMORY_S: Final = 0.4  # of the model of the disturbance
_ORDERS: Final = (4, 16)
_UNRESOLVED: Final = 2.0  # periods of the set-points kept: the least time between two errors that are fitted
_RIDGE: Final = 1e-9  # of the lagged errors, which are nearly dependent


class _Point(NamedTuple):
    """At some parameters: innovations, their derivatives with the disturbance's model eliminated, and that model."""

    innovations: Floats  # shape (n,)
    slopes: Floats  # shape (n, parameters)
    coefficients: Floats


class _Sampling(NamedTuple):
    """Which samples of all stretches, one after the other, are predicted, from which, and of which stretch they are."""

    predicted: Indices  # shape (n,)
    before: Indices  # shape (n, order), the last first
    starts: Indices  # of each stretch, in `predicted`


def fit_by_prediction(model: Model, stretches: Sequence[Manoeuvre]) -> tuple[ModelFit, Floats]:
    """One model, fitted to all stretches; and the squared innovations of each by the fit without it, shape (n,).

    Stretches are of one axis and evenly sampled, all at about the same period. Where set-points were kept seldom, the
    interval is wider by what the other curve through them would change, and by what as much again of the movement that
    was not resolved would (SIMEX: J. Cook and L. Stefanski, J. Am. Stat. Assoc. 89, 1994).
    """
    both = [curves(m) if seldom(m) else (m, m) for m in stretches]
    fitted, other = [smooth for smooth, _ in both], [straight for _, straight in both]
    sampling = _sampling(stretches)
    start = np.array(model.start)

    def residual(values: Floats) -> Floats:
        errors = _errors(model, values, fitted)
        return _innovations(errors, _disturbance(errors, sampling), sampling)

    def jacobian(values: Floats) -> Floats:
        return _at(model, values, fitted, sampling).slopes

    bounds = (np.array(model.lower), np.array(model.upper))
    found = least_squares(residual, start, jacobian, bounds, x_scale=start, xtol=1e-4, ftol=1e-7, max_nfev=30)
    values = np.asarray(found.x)
    point = _at(model, values, fitted, sampling)
    left_out, unseen = _without_each(point, sampling)
    covariance = _covariance(point, left_out)
    freedom = len(stretches) - 1.0
    half = half_widths(covariance, freedom)
    if any(m is not n for m, n in zip(fitted, other, strict=True)):
        away = np.abs(_step(point, _errors(model, values, other), sampling))
        rough = _at(model, values, [roughened(m) for m in stretches], sampling)
        away += np.abs(np.linalg.pinv(rough.slopes.T @ rough.slopes) @ rough.slopes.T @ rough.innovations)
        covariance = widened(covariance, np.diag(covariance) * ((half + away) / half) ** 2)
        half = half + away
    errors = _errors(model, values, fitted)
    squares = float(errors @ errors)
    spread = sum(float(m.measured_rad.var()) * len(m.measured_rad) for m in fitted)
    return (
        ModelFit(
            model,
            tuple(float(v) for v in values),
            1.0 - squares / spread,
            math.sqrt(squares / len(errors)),
            tuple((max(float(v - h), 0.0), float(v + h)) for v, h in zip(values, half, strict=True)),
            covariance,
            freedom,
        ),
        unseen,
    )


def _errors(model: Model, values: Floats, stretches: Sequence[Manoeuvre]) -> Floats:
    return np.concatenate([_averaged(error(model, values, m), m) for m in stretches])


def _together(stretch: Manoeuvre) -> int:
    """How many samples are averaged to one: what set-points did between two that were kept is unknown.

    Errors in the set-points bias the fit at frequencies that the log does not resolve; the average leaves those out.
    """
    if not seldom(stretch):
        return 1
    return max(round(_UNRESOLVED * stretch.recording.lateness_s / float(np.median(np.diff(stretch.time_s)))), 1)


def _averaged(series: Floats, stretch: Manoeuvre) -> Floats:
    """Means of so many samples, along the first axis."""
    size = _together(stretch)
    whole = len(series) // size * size
    return np.asarray(series[:whole].reshape(-1, size, *series.shape[1:]).mean(axis=1))


def _sampling(stretches: Sequence[Manoeuvre]) -> _Sampling:
    period_s = float(np.median([_together(m) * np.median(np.diff(m.time_s)) for m in stretches]))
    order = int(np.clip(round(_MEMORY_S / period_s), *_ORDERS))
    sizes = np.array([len(m.time_s) // _together(m) for m in stretches])
    ends = np.cumsum(sizes)
    predicted = np.concatenate([np.arange(end - size + order, end) for size, end in zip(sizes, ends, strict=True)])
    counts = np.maximum(sizes - order, 0)
    return _Sampling(predicted, predicted[:, None] - np.arange(1, order + 1), np.cumsum(counts) - counts)


def _disturbance(errors: Floats, sampling: _Sampling) -> Floats:
    """Coefficients a1 to ap by least squares over all stretches."""
    return _regressed(errors[sampling.before], errors[sampling.predicted])


def _innovations(errors: Floats, coefficients: Floats, sampling: _Sampling) -> Floats:
    return np.asarray(errors[sampling.predicted] - errors[sampling.before] @ coefficients)


def _at(model: Model, values: Floats, stretches: Sequence[Manoeuvre], sampling: _Sampling) -> _Point:
    errors = _errors(model, values, stretches)
    before = errors[sampling.before]
    coefficients = _regressed(before, errors[sampling.predicted])
    raw = np.concatenate([_averaged(sensitivity(model, values, m), m) for m in stretches])
    slopes = np.stack([_innovations(column, coefficients, sampling) for column in raw.T], axis=1)
    slopes = slopes - before @ _regressed(before, slopes)
    return _Point(errors[sampling.predicted] - before @ coefficients, slopes, coefficients)


def _regressed(on: Floats, what: Floats) -> Floats:
    """Least squares by the normal equations: few columns, many rows."""
    gram = on.T @ on
    gram[np.diag_indices_from(gram)] *= 1.0 + _RIDGE
    return np.asarray(np.linalg.solve(gram, on.T @ what))


def _step(point: _Point, errors: Floats, sampling: _Sampling) -> Floats:
    """The Gauss-Newton step to the fit of other errors, shape (parameters,)."""
    gradient = point.slopes.T @ _innovations(errors, point.coefficients, sampling)
    return np.asarray(-np.linalg.pinv(point.slopes.T @ point.slopes) @ gradient)


def _covariance(point: _Point, left_out: Floats) -> Floats:
    """Of the parameters: of the information, and no variance less than by the fits that leave one stretch out."""
    n, (samples, parameters) = len(left_out), point.slopes.shape
    freedom = max(samples - parameters - len(point.coefficients) - n, 1)
    inverse = np.linalg.pinv(point.slopes.T @ point.slopes)
    informed = float(point.innovations @ point.innovations) / freedom * inverse
    repeated = (n - 1) / n * ((left_out - left_out.mean(axis=0)) ** 2).sum(axis=0)
    return widened(informed, repeated)


def _without_each(point: _Point, sampling: _Sampling) -> tuple[Floats, Floats]:
    """By stretch: a Gauss-Newton step to the fit without it, and the squared innovations that this predicts in it."""
    curvature, gradient = point.slopes.T @ point.slopes, point.slopes.T @ point.innovations
    steps, squares = [], []
    for s, e in zip(*(np.split(v, sampling.starts[1:]) for v in (point.slopes, point.innovations)), strict=True):
        step = -np.linalg.pinv(curvature - s.T @ s) @ (gradient - s.T @ e)
        unseen = e + s @ step
        steps.append(step)
        squares.append(float(unseen @ unseen))
    return np.array(steps), np.array(squares)
