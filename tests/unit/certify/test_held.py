"""The loop as it is sampled and held: what the proof in continuous time does not see."""

import dataclasses
from decimal import Decimal

import numpy as np
import pytest

from companion.attitude_response.exact import decimal, interval
from companion.attitude_response.kinds import FirstOrder
from companion.attitude_response.response import AttitudeResponse
from companion.certify.assess import verdict_of
from companion.certify.certificate import assemble, certify, prove
from companion.certify.closed_loop import axis_vertices
from companion.certify.falsify import exponentials
from companion.certify.problem import AxisProblem, Problem, Sampling, nominal_weights
from companion.certify.proof import verify
from companion.certify.sampling.held import grows

# Certified once: nothing counted the hold, and at 6 Hz a step of 1 cm ended in a limit cycle of 0.28 m.
HELD = AxisProblem(
    decimal("4"),
    decimal("0.7"),
    (decimal("1.6"), decimal("0.55")),
    (decimal("1.8"), decimal("0.65")),
    AttitudeResponse(FirstOrder(interval("5.5"))),
)
SLOW = Sampling(Decimal(6), Decimal(1), Decimal("0.5"), Decimal("0.6"))
# Certified once by an approximant of the delay: the true loop grew to 0.7 m.
DELAYED = AxisProblem(
    decimal("2.3"),
    decimal("0.7"),
    (decimal("0.53"), decimal("0.32")),
    (decimal("0.55"), decimal("0.336")),
    AttitudeResponse(FirstOrder(interval("60")), interval("0.32")),
)


def spectral_radius(axis, weights, dt_s):
    """Of the held vehicle without delay: position, velocity, w and the command as one linear system over a tick."""
    g, m = float(axis.gravity_m_s2), float(axis.response.dynamics.bandwidth_rad_s.lower)
    system = np.array([[0, 1, 0, 0], [0, 0, g, 0], [0, 0, -m, m], [0, 0, 0, 0.0]])
    over = exponentials(system[None], np.array([dt_s]))[0]
    command = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [-weights[0], -weights[1], 0.0]])
    return np.abs(np.linalg.eigvals(over[:3] @ command)).max()


def test_the_proof_in_continuous_time_is_right_and_the_held_loop_grows():
    assert verdict_of(Problem({"x": HELD})).certified
    found = verdict_of(Problem({"x": HELD}, sampling={"x": SLOW}))
    assert found.certificate is None
    assert found.growing == {"x": 6.0}


@pytest.mark.parametrize("rate_hz", ["5", "6", "8", "12", "20", "50"])
def test_growth_agrees_with_the_spectral_radius(rate_hz):
    slow = dataclasses.replace(SLOW, tick_rate_hz=Decimal(rate_hz))
    position, velocity = map(float, nominal_weights(HELD))
    assert (grows(HELD, slow) is not None) == (spectral_radius(HELD, (position, velocity), 1 / float(rate_hz)) > 1)


def test_every_corner_of_the_false_config_grows():
    """1.02 to 1.06 a tick."""
    radii = [spectral_radius(HELD, (p, v), 1 / 6) for p in (1.6, 1.8) for v in (0.55, 0.65)]
    assert min(radii) > 1.01


def test_certificates_made_for_the_two_false_configs_are_refused():
    stated = Problem({"x": HELD}, sampling={"x": SLOW})
    assert certify(stated) is None
    forged = assemble(stated, {"x": prove(axis_vertices(HELD), 2)})  # right in continuous time
    verdict = verify(forged)
    assert not verdict.ok
    assert verdict.reason == "axis x grows when it is held over a tick at 6 Hz"
    proof = prove(axis_vertices(DELAYED), 2)
    assert proof is not None
    verdict = verify(assemble(Problem({"x": DELAYED}), {"x": proof}))
    assert not verdict.ok
    assert "approximant" in verdict.reason
    assert certify(Problem({"x": DELAYED})) is None


def test_a_long_delay_grows_when_flown():
    assert grows(DELAYED, dataclasses.replace(SLOW, tick_rate_hz=Decimal(250))) is not None


def test_the_rig_dies_out(rig, sampling):
    assert grows(rig("3", "0.02"), sampling) is None
