"""The loop in the frame that moves with a trajectory, the bias weight and its adaptation among its states.

With xi the distance from the trajectory, w the specific force over g that flies less the trajectory's own, and d what
disturbs, an acceleration:

    xi'' = g w + d,   w = H u(t - h),   u = -W1 xi - W2 xi' - b - l b',
    b' = gamma g (p12 e1 + p22 e2),     e' = A_r e + B (-(W - W_nominal)' x - b) + [0, d]

e is the error to the hedged reference model (20), which holds it whatever w does; b the bias weight, by (22) inside
its bound; l the lag by which it is foreseen (`companion.control.tracking`). W may be anything in its box at any time:
how it adapts is not used.

A response of second order has the states w and the integral of u - w. Any others would do for one response; of those
that were tried these move least from corner to corner of its box, which is what a common function V suffers from.
Standard library only.
"""

from __future__ import annotations

import itertools
from fractions import Fraction
from typing import NamedTuple

from companion.attitude_response.exact import ends
from companion.attitude_response.realisation import ONE, ZERO, Row, StateSpace
from companion.certify.piecewise.sectors import Channel, Loop, Square
from companion.certify.problem import AxisProblem, nominal_weights


class Bias(NamedTuple):
    """The bias weight of one axis, exact.

    Attributes
    ----------
    rate
        gamma of its adaptation.
    bound
        Specific force over g.
    lyapunov_q
        Diagonal of Q in (23).
    lead_s
        The lag by which it is foreseen.
    """

    rate: Fraction
    bound: Fraction
    lyapunov_q: tuple[Fraction, Fraction]
    lead_s: Fraction = ZERO


def moving_channel(axis: AxisProblem, bias: Bias | None, *, hull: bool = True) -> Channel:
    """The loop of one axis, disturbed through its one error input, in m/s^2.

    State: position, velocity, the attitude response's; then e1, e2 and b where there is a bias weight. `hull`: for a
    proof; without it the corners are responses that there are.
    """
    corners = list(itertools.product(*zip(axis.weights_lower, axis.weights_upper, strict=True)))
    weights = [(Fraction(first), Fraction(second)) for first, second in corners]
    own = axis.response.dynamics.corners()
    responses = _hull(own) if hull else own
    return Channel(
        tuple(tuple(_loop(axis, bias, response, w) for w in weights) for response in responses),
        tuple(ends(axis.response.delay_s)),
    )


def lyapunov(axis: AxisProblem, q: tuple[Fraction, Fraction]) -> tuple[Fraction, Fraction]:
    """p12 and p22 of (23)."""
    wn, zeta = Fraction(axis.natural_frequency_rad_s), Fraction(axis.damping_ratio)
    p12 = q[0] / (2 * wn * wn)
    return p12, (q[1] + 2 * p12) / (4 * zeta * wn)


def _hull(responses: list[StateSpace]) -> list[StateSpace]:
    """Responses of second order in the states w and the integral of u - w, as corners of a convex set around them.

    Their entries are 2 zeta wn and wn^2, and the curve (wn, wn^2) between two ends lies in the triangle of these and
    of (their mean, their product), where its tangents meet. Others are their own corners.
    """
    of_zeta: dict[Fraction, list[Fraction]] = {}
    for response in responses:
        if len(response.b) != 2:
            return responses
        (none, wn), (back, damping) = response.a
        if none or back != -wn or response.b != (ZERO, wn) or response.c != (ONE, ZERO):
            return responses
        of_zeta.setdefault(-damping / wn, []).append(wn)
    found = []
    for twice_zeta, frequencies in of_zeta.items():
        low, high = min(frequencies), max(frequencies)
        points = [(low, low * low), ((low + high) / 2, low * high), (high, high * high)]
        for wn, squared in points if high > low else points[:1]:
            found.append(StateSpace(((-twice_zeta * wn, squared), (-ONE, ZERO)), (ZERO, ONE), (ONE, ZERO), ZERO))
    return found


def _loop(axis: AxisProblem, bias: Bias | None, response: StateSpace, weights: tuple[Fraction, Fraction]) -> Loop:
    g, (w1, w2), order = Fraction(axis.gravity_m_s2), weights, len(response.b)
    n1, n2 = nominal_weights(axis)
    rest = 3 if bias else 0

    def row(ahead: Row, states: Row, error: Row) -> Row:
        return (*ahead, *states, *error[:rest])

    still = (ZERO,) * order
    u, b_rate = (-w1, -w2), (ZERO, ZERO, ZERO)
    u_error: Row = (ZERO, ZERO, -ONE)
    if bias:
        p12, p22 = lyapunov(axis, bias.lyapunov_q)
        b_rate = (bias.rate * g * p12, bias.rate * g * p22, ZERO)
        u_error = tuple(x - bias.lead_s * y for x, y in zip(u_error, b_rate, strict=True))
    a = [row((ZERO, ONE), still, (ZERO,) * 3), row((ZERO, ZERO), still, (ZERO,) * 3)]
    for states, b in zip(response.a, response.b, strict=True):
        a.append(row((b * u[0], b * u[1]), states, tuple(b * x for x in u_error)))
    if bias:
        a.append(row((ZERO, ZERO), still, (ZERO, ONE, ZERO)))
        a.append(row((g * (n1 - w1), g * (n2 - w2)), still, (-g * n1, -g * n2, -g)))
        a.append(row((ZERO, ZERO), still, b_rate))
    inlet = [ZERO, ONE, *still, *[ZERO] * rest]
    disturbed = [ZERO, ONE, *still, *(ZERO, ONE, ZERO)[:rest]]
    c = row((ZERO, ZERO), tuple(g * x for x in response.c), (ZERO,) * 3)
    width = len(a) + 2  # over (x, y(t - h), d)
    return Loop(
        tuple(a),
        tuple((x,) for x in inlet),
        (c,),
        tuple((x,) for x in disturbed),
        (Square(((-ONE, (*(ZERO for _ in range(width - 1)), ONE)),)),),
    )
