"""Fit the models to the manoeuvres of one axis, choose one, and say how well its parameters are known.

- Least squares of the measured angle against the exact response, one constant per manoeuvre free: trim and sensor bias.
- ``fit = 1 - |y - model|² / |y - mean|²`` over all manoeuvres, R²: one for a perfect model. A manoeuvre's own mean.
- Choice by cross-validation: each manoeuvre is predicted by the fit to the others, and the simplest model is taken
  whose error is within `TOLERANCE` of the best. Residuals are no white noise, so that a criterion that counts samples
  (AIC, BIC) would take every model for better.
- Intervals from the repetition: the fits that leave one manoeuvre out give a jackknife variance of the parameters
  (B. Efron, The Jackknife, the Bootstrap and Other Resampling Plans, SIAM 1982, eq. 3.2), Student's t with one degree
  of freedom fewer than manoeuvres makes it an interval. A certificate is for the box of all intervals of an axis, so
  they hold together: 95 % that all of its parameters are inside (Bonferroni).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import t as student

from companion.attitude_response.kinds import MODELS, Model
from companion.attitude_response.simulation import respond
from companion.identify.manoeuvres import Manoeuvre
from companion.identify.series import Floats

TOLERANCE: Final = 0.05  # of the root mean square error of prediction
CONFIDENCE: Final = 0.95
_STEP: Final = 1e-3  # of a parameter's size, for differences
_WRONG_LAGS_S: Final = np.arange(0.0, 0.6, 0.05)


class ModelFit(NamedTuple):
    """One model fitted to all manoeuvres.

    Attributes
    ----------
    model
        Which.
    values
        Its parameters, in the model's order.
    fit
        R² over all manoeuvres.
    prediction_rad
        Root mean square error on manoeuvres that were left out of the fit.
    interval_95
        Lower and upper end of each parameter: 95 % that all of them are inside.
    covariance, freedom
        Of the parameters, shape (parameters, parameters), and with how many degrees of freedom it is known.
    """

    model: Model
    values: tuple[float, ...]
    fit: float
    prediction_rad: float
    interval_95: tuple[tuple[float, float], ...]
    covariance: Floats
    freedom: float

    def named(self) -> dict[str, float]:
        """The parameters by name."""
        return dict(zip(self.model.parameters, self.values, strict=True))

    def intervals(self) -> dict[str, tuple[float, float]]:
        """The intervals by name of the parameter."""
        return dict(zip(self.model.parameters, self.interval_95, strict=True))


def fit_all(manoeuvres: Sequence[Manoeuvre]) -> dict[str, ModelFit]:
    """Every model, fitted to all manoeuvres of one axis, by name and from the simplest."""
    return {model.name: fit(model, manoeuvres) for model in MODELS}


def choose(fits: dict[str, ModelFit]) -> ModelFit:
    """The simplest model that predicts a manoeuvre it has not seen as well as the best one, within `TOLERANCE`."""
    best = min(f.prediction_rad for f in fits.values())
    return next(f for f in fits.values() if f.prediction_rad <= (1.0 + TOLERANCE) * best)


def fit(model: Model, manoeuvres: Sequence[Manoeuvre]) -> ModelFit:
    """One model, fitted to all manoeuvres and to all but each."""
    values = _solve(model, manoeuvres)
    errors = [error(model, values, m) for m in manoeuvres]
    sensitivities = [sensitivity(model, values, m) for m in manoeuvres]
    left_out = _without_each(model, values, errors, sensitivities)
    unseen = [error(model, seen, m) for seen, m in zip(left_out, manoeuvres, strict=True)]
    spread = sum(float(m.measured_rad.var()) * len(m.measured_rad) for m in manoeuvres)
    covariance = _covariance(left_out, errors, sensitivities)
    half = half_widths(covariance, len(manoeuvres) - 1.0)
    return ModelFit(
        model,
        tuple(float(v) for v in values),
        1.0 - sum(float(e @ e) for e in errors) / spread,
        math.sqrt(sum(float(e @ e) for e in unseen) / sum(len(e) for e in unseen)),
        tuple((max(float(v - h), 0.0), float(v + h)) for v, h in zip(values, half, strict=True)),
        covariance,
        len(manoeuvres) - 1.0,
    )


def fit_delay(model: Model, values: Sequence[float], manoeuvre: Manoeuvre) -> float:
    """The delay that suits one manoeuvre best, in s, all other parameters held; it may come out below zero."""
    dynamics = np.array(values, dtype=np.float64)

    def residual(delay: Floats) -> Floats:
        return error(model, np.append(dynamics[:-1], delay[0]), manoeuvre)

    return float(least_squares(residual, [dynamics[-1]], x_scale=0.01, diff_step=1e-2).x[0])


def error(model: Model, values: Floats, manoeuvre: Manoeuvre) -> Floats:
    """Measured minus modelled angle in rad, its mean taken off, shape (m,)."""
    modelled = respond(model, values, manoeuvre.setpoint_time_s, manoeuvre.setpoint_rad, manoeuvre.time_s)
    missed = manoeuvre.measured_rad - modelled
    return np.asarray(missed - missed.mean())


def gain(model: Model, values: Sequence[float], manoeuvres: Sequence[Manoeuvre]) -> float:
    """How far the attitude goes for a set-point of one: the slope of measured over modelled angle."""
    over, under = 0.0, 0.0
    for m in manoeuvres:
        modelled = respond(model, values, m.setpoint_time_s, m.setpoint_rad, m.time_s)
        modelled = modelled - modelled.mean()
        over += float(modelled @ m.measured_rad)
        under += float(modelled @ modelled)
    return over / under


def opposed(manoeuvres: Sequence[Manoeuvre]) -> bool:
    """Whether the attitude goes against its set-point: the strongest correlation at any lag is negative."""
    strongest = 0.0
    for lag_s in _WRONG_LAGS_S:
        product = 0.0
        for m in manoeuvres:
            at = np.searchsorted(m.setpoint_time_s, m.time_s - lag_s, side="right") - 1
            wanted = m.setpoint_rad[np.maximum(at, 0)]
            product += float((wanted - wanted.mean()) @ m.measured_rad)
        if abs(product) > abs(strongest):
            strongest = product
    return strongest < 0.0


def _solve(model: Model, manoeuvres: Sequence[Manoeuvre]) -> Floats:
    def residual(values: Floats) -> Floats:
        return np.concatenate([error(model, values, m) for m in manoeuvres])

    def jacobian(values: Floats) -> Floats:
        return np.concatenate([sensitivity(model, values, m) for m in manoeuvres])

    bounds = (np.array(model.lower), np.array(model.upper))
    start = np.array(model.start)
    return np.asarray(least_squares(residual, start, jacobian, bounds, x_scale=start, xtol=1e-5, ftol=1e-8).x)


def sensitivity(model: Model, values: Floats, manoeuvre: Manoeuvre) -> Floats:
    """Derivative of `error` by each parameter, shape (m, parameters), by central differences."""
    columns = []
    for k, step in enumerate(_STEP * np.array(model.start)):
        up, down = values.copy(), values.copy()
        up[k] += step
        down[k] -= step
        columns.append((error(model, up, manoeuvre) - error(model, down, manoeuvre)) / (2.0 * step))
    return np.stack(columns, axis=1)


def _without_each(model: Model, values: Floats, errors: Sequence[Floats], sensitivities: Sequence[Floats]) -> Floats:
    """The fit to all manoeuvres but each, shape (n, parameters): a Gauss-Newton step from the fit to all of them."""
    curvatures = [s.T @ s for s in sensitivities]
    slopes = [s.T @ e for s, e in zip(sensitivities, errors, strict=True)]
    curvature, slope = np.sum(curvatures, axis=0), np.sum(slopes, axis=0)
    steps = [np.linalg.lstsq(curvature - c, slope - s, rcond=None)[0] for c, s in zip(curvatures, slopes, strict=True)]
    return np.asarray(np.clip(values - np.array(steps), model.lower, model.upper))


def _covariance(left_out: Floats, errors: Sequence[Floats], sensitivities: Sequence[Floats]) -> Floats:
    """Of the parameters, shape (parameters, parameters), from the fits that leave one manoeuvre out.

    Never narrower than the residual's size alone allows: a few manoeuvres may agree by chance.
    """
    n, parameters = left_out.shape
    repeated = (n - 1) / n * ((left_out - left_out.mean(axis=0)) ** 2).sum(axis=0)
    variance = sum(float(e @ e) for e in errors) / max(sum(len(e) for e in errors) - parameters - n, 1)
    return widened(variance * np.linalg.pinv(np.sum([s.T @ s for s in sensitivities], axis=0)), repeated)


def widened(informed: Floats, repeated: Floats) -> Floats:
    """A covariance with variances no less than `repeated`, shape (n,), and its correlations as they were.

    The correlations are those of the information: few repetitions do not tell them.
    """
    grown = np.sqrt(np.maximum(repeated / np.maximum(np.diag(informed), np.finfo(float).tiny), 1.0))
    return np.asarray(informed * np.outer(grown, grown))


def half_widths(covariance: Floats, freedom: float) -> Floats:
    """Half of each parameter's share of the 95 % box (Bonferroni), shape (parameters,)."""
    quantile = float(student.ppf(1.0 - 0.5 * (1.0 - CONFIDENCE) / len(covariance), freedom))
    return np.asarray(quantile * np.sqrt(np.diag(covariance)))
