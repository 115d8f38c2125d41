"""What an approximant of the delay certifies and the true one makes grow: no certificate, and an attack says why."""

import math
from collections import deque
from dataclasses import replace
from decimal import Decimal

import pytest

from companion.attitude_response.exact import decimal, interval
from companion.attitude_response.kinds import FirstOrder
from companion.attitude_response.response import AttitudeResponse
from companion.certify.assess import assess
from companion.certify.certificate import prove
from companion.certify.closed_loop import axis_vertices
from companion.certify.falsify import Counterexample
from companion.certify.problem import AxisProblem, Problem

NARROW = AxisProblem(
    decimal("2.3"),
    decimal("0.7"),
    (decimal("0.4314"), decimal("0.2626")),
    (decimal("0.5662"), decimal("0.3447")),
    AttitudeResponse(FirstOrder(interval("20")), interval("0.26")),
)


def true_delay_growth(axis: AxisProblem, attack: Counterexample, periods: int = 12) -> float:
    """Growth a period of the loop with its transport delay as it is: a buffer, no approximant."""
    dynamics, g, dt = axis.response.dynamics, float(axis.gravity_m_s2), 2e-4
    assert isinstance(dynamics, FirstOrder)
    wn, zeta = float(axis.natural_frequency_rad_s), float(axis.damping_ratio)
    bandwidth, delay = float(dynamics.bandwidth_rad_s.lower), float(axis.response.delay_s.lower)
    x, v, w = 0.1, 0.0, 0.0
    waiting = deque([0.0] * round(delay / dt))
    decay, peaks = math.exp(-bandwidth * dt), []
    for _ in range(periods):
        peak = 0.0
        for (position_weight, velocity_weight), duration in zip(attack.weights, attack.durations_s, strict=True):
            for _ in range(round(duration / dt)):
                u = -position_weight * x - velocity_weight * v
                waiting.append(u)
                late = waiting.popleft()
                w = late + (w - late) * decay
                x, v = x + dt * v, v + dt * (-wn * wn * x - 2 * zeta * wn * v + g * (w - u))  # (20), (24)
                peak = max(peak, abs(x))
        peaks.append(peak)
    return (peaks[-1] / peaks[len(peaks) // 2]) ** (1.0 / (len(peaks) - 1 - len(peaks) // 2))


@pytest.fixture(scope="module")
def attacked() -> Counterexample:
    found = assess(Problem({"x": NARROW}), 2)
    assert prove(axis_vertices(NARROW), 2) is not None  # the approximant of first order could be proven, exactly
    assert found.certificate is None  # and that is not taken for the truth
    attack = found.axes["x"].attack
    assert attack is not None
    return attack


def test_what_is_found_by_the_finer_approximant_grows_with_the_true_delay(attacked: Counterexample) -> None:
    assert attacked.spectral_radius > 1.01
    assert true_delay_growth(NARROW, attacked) > 1.01


def test_at_a_link_s_delay_the_attack_finds_nothing() -> None:
    quick = replace(NARROW, response=AttitudeResponse(FirstOrder(interval("20")), interval(Decimal("0.02"))))
    found = assess(Problem({"x": quick}), 2)
    assert found.certified
    assert found.axes["x"].attack is None
