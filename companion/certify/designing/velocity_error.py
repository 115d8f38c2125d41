"""Q and the rate of the bias weight for the estimator they meet: how far gusts and a wrong velocity move the vehicle.

Two things move it. A gust, an acceleration d, until the bias weight has taken it up. And an error e_v of the estimated
velocity, which the feedback brakes against and the bias weight integrates. With fixed nominal weights, x the true
position, the attitude response G(s) with its delay, and s = g times the bias weight, one axis of (18)-(22) is

    x'' = f + d     f = G u     u = -wn^2 x - 2 zeta wn (x' + e_v) - s
    x_r'' = -2 zeta wn x_r' - wn^2 x_r + f - u              the hedged reference (20), nothing commanded
    s' = gamma_b g^2 (p12 (x - x_r) + p22 (x' + e_v - x_r'))

A lasting e_v leaves the bias weight at rest where p12 e1 + p22 e2 = 0, so it moves the vehicle by T e_v with

    T = p22 / p12 = 1 / (2 zeta wn) + (q2 / q1) wn / (2 zeta)

in seconds, by (23) for Q = diag(q1, q2): 1.95 s for Q = I at 2.3 rad/s, 0.39 s for [1, 0.05]. But p22 also damps the
adaptation. Without it the bias weight bears little, or rings, and a gust is taken up late. So there is a best T, and it
depends on how large e_v is: that is the trade-off. d and e_v are first-order Markov processes, and what is least is

    E[x^2] = what the gusts do + what e_v does,

two Lyapunov equations, at the worst corner of the response. gamma_b may be as large as
sampling bears with a share in hand (`sampled.py`). q1 stays 1, since Q's scale is that of the rates.

The correction of the estimate (`companion.control.estimate_correction`) leaves of e_v what `CORRECTED` says, so it is
chosen where that makes E[x^2] smaller. None of this is a proof. The theorem holds for every Q above zero and the
sampled check is made for what was chosen; here is only said which of them is best.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from decimal import ROUND_FLOOR, Decimal
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.linalg import solve_continuous_lyapunov

from companion.attitude_response.realisation import StateSpace
from companion.attitude_response.response import corners
from companion.certify.problem import AxisProblem, Sampling
from companion.certify.sampling.sampled import largest_adaptation_rate
from companion.config.estimator import VelocityError
from companion.control.mrac import solve_lyapunov

GUST_M_S2: Final = 0.5  # standard deviation: 5 m/s of wind, gusts of half as much, 1 kg with 0.05 N s^2/m^2 of drag
GUST_TIME_S: Final = 2.0
# Standard deviation and time constant that the correction leaves of those of e_v: 0.088 of 0.192 m/s north, 0.117 of
# 0.267 east for `gps`; 0.030 of 0.076 for `rtk`, 0.017 of 0.037 for `motion_capture`; 1.2 of 3.7 s, 1.5 of 4.0, 0.9 of
# 2.3 (8 min of the plant's error models, default correction).
CORRECTED: Final = (0.45, 0.35)
Q2: Final = tuple(map(Decimal, ("1", "0.7", "0.5", "0.3", "0.2", "0.15", "0.1", "0.07", "0.05", "0.03", "0.02")))
STEPS: Final = 10  # rates that are tried for each Q, up to the largest
ENOUGH: Final = 1.05  # of the least displacement: a faster rate for less than that is not worth its risk
SAMPLED_SHARE: Final = 0.8  # of the adaptation rate at which sampling would make it unstable

Matrix = npt.NDArray[np.float64]


class Displacement(NamedTuple):
    """RMS of the true position about where it should be, m, by what moves it."""

    gusts_m: float
    velocity_error_m: float

    @property
    def rms_m(self) -> float:
        """Both."""
        return math.hypot(*self)


def ratio_s(axis: AxisProblem, q2: float) -> float:
    """T, the displacement by each m/s of lasting velocity error, for Q = diag(1, q2)."""
    _, p12, p22 = solve_lyapunov(float(axis.natural_frequency_rad_s), float(axis.damping_ratio), 1.0, q2)
    return p22 / p12


def corrected(error: VelocityError) -> VelocityError:
    """What the correction of the estimate leaves."""
    return VelocityError(CORRECTED[0] * error.deviation_m_s, CORRECTED[1] * error.time_s)


def displacement(axis: AxisProblem, q2: float, bias_rate: float, error: VelocityError) -> Displacement:
    """At the worst corner of the response; infinite where that loop is unstable. A rate of zero: no bias weight."""
    return max(
        (_displacement(axis, corner, q2, bias_rate, error) for corner in corners(axis.response)),
        key=lambda found: found.rms_m,
    )


def _displacement(
    axis: AxisProblem, response: StateSpace, q2: float, bias_rate: float, error: VelocityError
) -> Displacement:
    wn, zeta, g = (float(v) for v in (axis.natural_frequency_rad_s, axis.damping_ratio, axis.gravity_m_s2))
    _, p12, p22 = solve_lyapunov(wn, zeta, 1.0, q2)
    x, v, x_r, v_r, d, e, *rest = range(7 + len(response.b) - (not bias_rate))
    lags = rest[: len(response.b)]
    n = 6 + len(rest)
    u, f = np.zeros(n), np.zeros(n)
    u[x], u[v], u[e] = -wn * wn, -2.0 * zeta * wn, -2.0 * zeta * wn
    f[lags] = [float(c) for c in response.c]
    a: Matrix = np.zeros((n, n))
    a[x, v] = a[x_r, v_r] = a[v, d] = 1.0
    if bias_rate:
        s = rest[-1]
        u[s] = -1.0
        k1, k2 = bias_rate * g * g * p12, bias_rate * g * g * p22
        a[s, x], a[s, x_r], a[s, v], a[s, e], a[s, v_r] = k1, -k1, k2, k2, -k2
    a[v] += f
    a[v_r] += f - u
    a[v_r, x_r], a[v_r, v_r] = a[v_r, x_r] - wn * wn, a[v_r, v_r] - 2.0 * zeta * wn
    for row, (lag, b) in enumerate(zip(lags, response.b, strict=True)):
        a[lag, lags] = [float(c) for c in response.a[row]]
        a[lag] += float(b) * u
    a[d, d], a[e, e] = -1.0 / GUST_TIME_S, -1.0 / error.time_s
    if np.linalg.eigvals(a).real.max() >= 0.0:
        return Displacement(math.inf, math.inf)
    return Displacement(
        *(
            math.sqrt(max(_variance(a, source, deviation, time_s)[x, x], 0.0))
            for source, deviation, time_s in ((d, GUST_M_S2, GUST_TIME_S), (e, error.deviation_m_s, error.time_s))
        )
    )


def _variance(a: Matrix, source: int, deviation: float, time_s: float) -> Matrix:
    """Of all states, driven by one Markov process."""
    drive = np.zeros_like(a)
    drive[source, source] = 2.0 * deviation * deviation / time_s
    return np.asarray(solve_continuous_lyapunov(a, -drive))


class Adaptation(NamedTuple):
    """What was chosen for all axes alike, and what it leaves at the worst of them.

    Attributes
    ----------
    q2
        Of Q = diag(1, q2).
    adaptation_rate, bias_adaptation_rate
        Of the axes' weights, and of the bias weight; zero without one.
    correct
        Whether the estimate is to be corrected.
    displacement, ratio_s
        Where it should be to where it is, and T.
    at_sampling_limit
        Whether a faster tick would allow a faster rate, and this one is as fast as is of use at this tick.
    """

    q2: Decimal
    adaptation_rate: Decimal
    bias_adaptation_rate: Decimal
    correct: bool
    displacement: Displacement
    ratio_s: float
    at_sampling_limit: bool


def choose(axes: Mapping[str, AxisProblem], sampling: Mapping[str, Sampling], error: VelocityError) -> Adaptation:
    """The Q and the rates that leave least, of those that do as well as the best within `ENOUGH` the slowest rate.

    The axes' own rate is the template's, or as much less that half of what sampling bears is left to the bias weight.
    """
    left = corrected(error) if error.position_aided else error
    first = next(iter(sampling.values()))
    found: list[Adaptation] = []
    for q2 in Q2:
        bearable = SAMPLED_SHARE * min(
            _strength(axes[n], replace(s, lyapunov_q=(Decimal(1), q2))) for n, s in sampling.items()
        )
        regressor = float(first.position_m) ** 2 + float(first.velocity_m_s) ** 2
        with_bias = bool(first.bias_adaptation_rate)
        most = (0.5 if with_bias else 1.0) * bearable / regressor
        gamma = first.adaptation_rate if float(first.adaptation_rate) <= most else two_figures(most)
        rest = bearable - float(gamma) * regressor
        for step in range(STEPS if with_bias else 1, 0, -1):
            bias = two_figures(rest * step / STEPS) if with_bias else Decimal(0)
            worst = max(
                (displacement(axis, float(q2), float(bias), left) for axis in set(axes.values())),
                key=lambda found: found.rms_m,
            )
            t = max(ratio_s(axis, float(q2)) for axis in axes.values())
            tick = gamma < first.adaptation_rate or step == STEPS
            found.append(Adaptation(q2, gamma, bias, error.position_aided, worst, t, tick))
    least = min(one.displacement.rms_m for one in found)
    good = [one for one in found if one.displacement.rms_m <= ENOUGH * least]
    return min(good, key=lambda one: (one.bias_adaptation_rate, one.displacement.rms_m))


def two_figures(value: float) -> Decimal:
    """Two significant figures, downwards."""
    if value <= 0.0:
        return Decimal(0)
    rounded = Decimal(value).quantize(Decimal(1).scaleb(math.floor(math.log10(value)) - 1), ROUND_FLOOR)
    return Decimal(f"{rounded:f}")  # 100, not 1.0E+2


def _strength(axis: AxisProblem, sampled: Sampling) -> float:
    """What sampling bears in all, gamma |x|^2 + gamma_b."""
    regressor = float(sampled.position_m) ** 2 + float(sampled.velocity_m_s) ** 2
    return largest_adaptation_rate(axis, replace(sampled, bias_adaptation_rate=Decimal(0))) * regressor
