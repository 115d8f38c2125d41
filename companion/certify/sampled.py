"""The largest adaptation rate at which the sampled adaptation is stable over the flight envelope.

What is checked. With e = x - x_r, W~ = W^ - W and a regressor x held still, hedged adaptation (20)-(22) obeys

    e' = A_r e - B s,    s = W~^T x,    s' = gamma |x|^2 e^T P B,

whatever the attitude dynamics: the hedge takes them out. Between ticks s is constant, so e moves exactly by `e <- Phi
e - Gamma s`, `Phi = exp(A_r dt)`, `Gamma` the integral of `exp(A_r t) B`; at a tick the explicit step adds `dt gamma
|x|^2 e^T P B` to s. Both orders of a tick are checked, the command from the weights before and after their step. The
regressor enters through `gamma |x|^2` alone and the characteristic polynomial is affine in it, so the first loss of
stability is found in closed form (Jury) and covers every smaller regressor. It is a condition for each regressor held
still, not a proof for all that move."""

import math
from typing import NamedTuple

import numpy as np
from numpy.polynomial import Polynomial
from scipy.linalg import expm, solve_continuous_lyapunov

from companion.certify.lyapunov import Floats
from companion.certify.problem import AxisProblem, Sampling


class ErrorDynamics(NamedTuple):
    """Sampled error model of one axis, with the loop cut at the adaptation.

    Attributes
    ----------
    transition
        (2, 2) Phi over one tick.
    input
        (2,) Gamma over one tick, for B = [0, g].
    gain
        (2,) `dt P B`, P from eq. (23).
    """

    transition: Floats
    input: Floats
    gain: Floats


def error_dynamics(problem: AxisProblem, sampling: Sampling) -> ErrorDynamics:
    """Discretise the tracking error of one axis at the tick rate."""
    wn, zeta, g = (float(v) for v in (problem.natural_frequency_rad_s, problem.damping_ratio, problem.gravity_m_s2))
    dt = 1 / float(sampling.tick_rate_hz)
    reference = np.array([[0.0, 1.0], [-wn * wn, -2 * zeta * wn]])
    inlet = np.array([0.0, g])
    p = solve_continuous_lyapunov(reference.T, -np.diag([float(q) for q in sampling.lyapunov_q]))
    augmented = np.zeros((3, 3))
    augmented[:2, :2], augmented[:2, 2] = reference, inlet
    moved = expm(augmented * dt)
    return ErrorDynamics(moved[:2, :2], moved[:2, 2], dt * (p @ inlet))


def largest_adaptation_rate(problem: AxisProblem, sampling: Sampling) -> float:
    """Adaptation rate gamma below which the sampled error dynamics are stable for every regressor in the envelope.

    Parameters
    ----------
    problem
        Axis; only its reference model and gravity matter.
    sampling
        Tick rate, envelope and Q of (23); its own adaptation rate is not used.

    Returns
    -------
    float
        In the unit of gamma; compare with `sampling.adaptation_rate`.
    """
    envelope = float(sampling.position_m) ** 2 + float(sampling.velocity_m_s) ** 2
    model = error_dynamics(problem, sampling)
    return float(min(_first_instability(model, updated) for updated in (False, True)) / envelope)


def tick_matrix(model: ErrorDynamics, strength: float, updated: bool) -> Floats:
    """(3, 3) transition of [e, s] over one tick.

    Parameters
    ----------
    model
        Sampled error model.
    strength
        `gamma |x|^2`.
    updated
        Whether the command of a tick already uses the weights that this tick has updated.
    """
    learning = strength * model.gain
    matrix = np.eye(3)
    matrix[:2, :2], matrix[:2, 2] = model.transition, -model.input
    if updated:
        matrix[:2, :2] -= np.outer(model.input, learning)
    matrix[2, :2] = learning
    return matrix


def _first_instability(model: ErrorDynamics, updated: bool) -> float:
    """Smallest positive strength at which a root of the characteristic polynomial reaches the unit circle."""
    scale = 1 / float(np.abs(model.gain).max() * np.abs(model.input).max())
    start = np.poly(tick_matrix(model, 0.0, updated))
    # exactly affine: the strength enters by a matrix of rank one
    slope = np.poly(tick_matrix(model, scale, updated)) - start
    _, a2, a1, a0 = (Polynomial([c0, c1]) for c0, c1 in zip(start, slope, strict=True))
    # of z^3 + a2 z^2 + a1 z + a0: a root at z = -1, a pair on the circle (Jury); at z = 1 only for strength zero
    margins = [1 - a2 + a1 - a0, 1 - a0 * a0 - a1 + a0 * a2]
    roots = np.concatenate([np.asarray(margin.trim(1e-12).roots(), dtype=complex) for margin in margins])
    crossings = [float(root.real) for root in roots if abs(root.imag) < 1e-9 * root.real]
    return scale * min(crossings, default=math.inf)
