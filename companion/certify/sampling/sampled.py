"""The largest adaptation rate at which the sampled adaptation is stable over the flight envelope.

What is checked. With e = x - x_r, W~ = W^ - W and a regressor x held still, hedged adaptation (20)-(22) obeys

    e' = A_r e - B s,    s = W~^T x,    s' = (gamma |x|^2 + gamma_b) e^T P B,

whatever the attitude dynamics: the hedge takes them out. gamma_b is the rate of the bias weight, whose regressor is 1;
without one it is zero. Between ticks s is constant, so e moves exactly by `e <- Phi e - Gamma s`, `Phi = exp(A_r dt)`,
`Gamma` the integral of `exp(A_r t) B`; at a tick the explicit step adds `dt` times s' to s. Both orders of a tick are
checked, the command from the weights before and after their step. The regressor enters through the strength `gamma
|x|^2 + gamma_b` alone and the characteristic polynomial is affine in it, so the first loss of stability is found in
closed form (Jury) and covers every smaller regressor. The stricter of the two orders of a tick counts: what flies uses
the weights it has just updated and would bear more.

What is proven: the error dynamics are stable for each regressor of the envelope that stands still. Regressors that move
are not covered: near the tick rate some make the error grow, slowly, until the projection stops the weights at their
bounds, where `guards.weights_on_bound` sees them. Position and velocity are taken at their largest together, since
`guards.envelope` watches each by itself: a vehicle may be at the corner of that box, and an ellipse inside it would be
watched by nobody.

Standard library only, on the discretisation and the Lyapunov solution that fly: `companion run` checks it too."""

from __future__ import annotations

import math
from typing import NamedTuple

from companion.certify.problem import AxisProblem, Sampling
from companion.control.mrac import solve_lyapunov
from companion.control.reference_model import transition

Rows = tuple[tuple[float, float, float], ...]


class ErrorDynamics(NamedTuple):
    """Sampled error model of one axis, with the loop cut at the adaptation.

    Attributes
    ----------
    transition
        (2, 2) Phi over one tick, by rows.
    input
        (2,) Gamma over one tick, for B = [0, g].
    gain
        (2,) `dt P B`, P from eq. (23).
    """

    transition: tuple[tuple[float, float], tuple[float, float]]
    input: tuple[float, float]
    gain: tuple[float, float]


def error_dynamics(problem: AxisProblem, sampling: Sampling) -> ErrorDynamics:
    """Discretise the tracking error of one axis at the tick rate."""
    wn, zeta, g = (float(v) for v in (problem.natural_frequency_rad_s, problem.damping_ratio, problem.gravity_m_s2))
    dt = 1 / float(sampling.tick_rate_hz)
    over = transition(wn, zeta, dt)
    _, p12, p22 = solve_lyapunov(wn, zeta, float(sampling.lyapunov_q[0]), float(sampling.lyapunov_q[1]))
    return ErrorDynamics(
        ((over.phi11, over.phi12), (over.phi21, over.phi22)),
        (g * over.gamma1, g * over.gamma2),
        (dt * g * p12, dt * g * p22),
    )


def largest_adaptation_rate(problem: AxisProblem, sampling: Sampling) -> float:
    """Adaptation rate gamma below which the sampled error dynamics are stable for every regressor in the envelope.

    What the bias weight takes of the strength that is stable is gone for the others: `(limit - gamma_b) / |x|^2`.

    Parameters
    ----------
    problem
        Axis; only its reference model and gravity matter.
    sampling
        Tick rate, envelope and Q of (23); its own adaptation rate is not used.

    Returns
    -------
    float
        In the unit of gamma; compare with `sampling.adaptation_rate`. Negative if the bias weight alone is too fast.
    """
    envelope = float(sampling.position_m) ** 2 + float(sampling.velocity_m_s) ** 2
    model = error_dynamics(problem, sampling)
    strength = min(_first_instability(model, updated) for updated in (False, True))
    return (strength - float(sampling.bias_adaptation_rate)) / envelope


def tick_matrix(model: ErrorDynamics, strength: float, updated: bool) -> Rows:
    """(3, 3) transition of [e, s] over one tick, by rows.

    Parameters
    ----------
    model
        Sampled error model.
    strength
        `gamma |x|^2 + gamma_b`.
    updated
        Whether the command of a tick already uses the weights that this tick has updated.
    """
    (f11, f12), (f21, f22) = model.transition
    (b1, b2), (l1, l2) = model.input, (strength * model.gain[0], strength * model.gain[1])
    if updated:
        f11, f12, f21, f22 = f11 - b1 * l1, f12 - b1 * l2, f21 - b2 * l1, f22 - b2 * l2
    return (f11, f12, -b1), (f21, f22, -b2), (l1, l2, 1.0)


def _characteristic(m: Rows) -> tuple[float, float, float]:
    """(a2, a1, a0) of det(z I - m) = z^3 + a2 z^2 + a1 z + a0."""
    (a, b, c), (d, e, f), (g, h, i) = m
    minors = (e * i - f * h) + (a * i - c * g) + (a * e - b * d)
    return -(a + e + i), minors, -(a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g))


def _first_instability(model: ErrorDynamics, updated: bool) -> float:
    """Smallest positive strength at which a root of the characteristic polynomial reaches the unit circle."""
    scale = 1 / (max(map(abs, model.gain)) * max(map(abs, model.input)))
    start = _characteristic(tick_matrix(model, 0.0, updated))
    far = _characteristic(tick_matrix(model, scale, updated))
    # Exactly affine in the strength, which enters by a matrix of rank one: a_k = p_k + q_k s.
    (p2, p1, p0), (q2, q1, q0) = start, tuple(f - s for f, s in zip(far, start, strict=True))
    # A root at z = -1; a pair on the circle (Jury). At z = 1 there is one only for strength zero.
    at_minus_one = _roots(0.0, q2 * -1 + q1 - q0, 1 - p2 + p1 - p0)
    on_circle = _roots(q0 * (q2 - q0), q0 * (p2 - 2 * p0) + p0 * q2 - q1, 1 - p0 * p0 - p1 + p0 * p2)
    # Strength zero itself is on the circle: rounding must not make it the answer.
    return scale * min((s for s in (*at_minus_one, *on_circle) if s > 1e-9), default=math.inf)


def _roots(a: float, b: float, c: float) -> list[float]:
    """Real roots of a s^2 + b s + c, without cancellation."""
    if abs(a) < 1e-12 * max(abs(b), abs(c)):
        return [-c / b] if b else []
    square = b * b - 4 * a * c
    if square < 0:
        return []
    half = -0.5 * (b + math.copysign(math.sqrt(square), b))
    return [half / a, c / half] if half else [0.0]
