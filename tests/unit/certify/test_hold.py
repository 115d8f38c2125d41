"""The tick in the proof: its figures, its algebra against a tick that is integrated, and loops that are flown."""

import dataclasses
import itertools
import math
from decimal import Decimal
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.attitude_response.exact import decimal, interval
from companion.attitude_response.kinds import FirstOrder, SecondOrder
from companion.attitude_response.response import AttitudeResponse
from companion.certify.bandwidth import fastest_reference, with_bandwidth, with_natural_frequency
from companion.certify.certificate import assemble, certify, prove
from companion.certify.closed_loop import axis_channel, axis_vertices
from companion.certify.falsify import exponentials, worst_switching
from companion.certify.piecewise.hold import TooSlowError
from companion.certify.piecewise.sector_proof import check_sectors
from companion.certify.piecewise.sector_search import Active, believed, prove_by_sectors
from companion.certify.problem import Problem, Sampling
from companion.certify.proof import verify
from companion.control import mrac
from companion.control.reference_model import transition

RIG = 2.3


def needed(axis, count, tick_s, low, high):
    """Least bandwidth in rad/s by bisection in floating point, then proven."""
    active, best = Active(), None
    while high - low > 5e-4 * high:
        middle = (low + high) / 2
        found = believed(axis_channel(with_bandwidth(axis, decimal(middle)), tick_s), count, RIG, active)
        low, high, best = (low, middle, found) if found else (middle, high, best)
    assert best is not None
    assert best.proven() is not None
    return high


@pytest.mark.parametrize(
    ("count", "rate_hz", "most"), [(0, 1000, 2.907), (0, 100, 2.931), (0, 20, 3.195), (8, 100, 2.62), (8, 20, 2.865)]
)
def test_needed_bandwidth_of_the_rig(count, rate_hz, most, rig):
    """Without a tick 2.904 and 2.596. A quadratic function for one known rate of 20 Hz would need 3.015."""
    assert needed(rig(), count, Fraction(1, rate_hz), 2.5, 3.4) <= most


def test_a_short_tick_is_no_tick(rig):
    found = needed(rig(), 0, Fraction(1, 10**6), 2.5, 3.4)
    assert found == pytest.approx(2.904, rel=1e-3)


def test_so_slow_a_tick_that_nothing_bounds_it(rig):
    with pytest.raises(TooSlowError):
        axis_channel(rig(), Fraction(10))


def test_a_proof_without_the_tick_is_refused_where_there_is_one(rig, sampling):
    stated = Problem({"x": rig()}, sampling={"x": sampling})
    for proof in (prove(axis_vertices(rig()), 2), prove_by_sectors(axis_channel(rig()), 8, RIG)):
        assert proof is not None
        verdict = verify(assemble(stated, {"x": proof}))
        assert not verdict.ok
        assert "tick" in verdict.reason


def test_a_proof_for_a_shorter_tick_is_refused(rig):
    proof = prove_by_sectors(axis_channel(rig("2.95"), Fraction(1, 100)), 0, RIG)
    assert proof is not None
    assert check_sectors(proof, axis_channel(rig("2.95"), Fraction(1, 200))) == ""  # shorter is covered
    assert check_sectors(proof, axis_channel(rig("2.95"), Fraction(1, 10))) != ""
    for changed in ((Fraction(0),) * 4, (Fraction(-1), *proof.hold[1:]), proof.hold[:3]):
        assert check_sectors(proof._replace(hold=changed), axis_channel(rig("2.95"), Fraction(1, 100))) != ""


RESPONSES = {"first": FirstOrder(interval("3")), "second": SecondOrder(interval("9"), interval("0.9"))}


@pytest.mark.parametrize("kind", RESPONSES)
@pytest.mark.parametrize("share", [0.4, 1.0])
def test_the_loop_with_errors_is_the_loop_that_is_held(kind, share, rig):
    """One tick, integrated finely: in the new coordinates its rates are the rows of the loop, and the bounds hold."""
    tick_s = 0.02
    axis = dataclasses.replace(rig(), response=AttitudeResponse(RESPONSES[kind]))
    response = axis.response.dynamics.corners()[0]
    a, b, c = (np.array(part, dtype=float) for part in (response.a, response.b, response.c))
    g, stiffness, damping = 9.81, RIG**2, 2 * 0.7 * RIG
    weights = np.array([0.55, -0.35])
    generator = np.random.default_rng(3)
    x, xa = generator.normal(size=2), generator.normal(size=len(b))
    held, points = weights @ x, 4001
    dt = share * tick_s / (points - 1)
    over = exponentials(np.block([[a, -b[:, None]], [np.zeros((1, len(b) + 1))]])[None], np.array([dt]))[0]
    states = [np.append(xa, held)]
    for _ in range(points - 1):
        states.append(over @ states[-1])
    actuator = np.array(states)[:, :-1]
    w = actuator @ c
    mean_of_two = (w[0] + w[-1]) / 2
    f = transition(RIG, 0.7, dt)
    position = [x]
    for _ in range(points - 1):
        p, v = position[-1]
        drive = g * (mean_of_two + held)
        position.append(
            np.array([f.phi11 * p + f.phi12 * v + f.gamma1 * drive, f.phi21 * p + f.phi22 * v + f.gamma2 * drive])
        )
    position = np.array(position)

    def mean(values):
        return np.trapezoid(values, dx=dt) / (share * tick_s)

    def integral(values):
        return np.concatenate([[0.0], np.cumsum((values[1:] + values[:-1]) / 2) * dt])

    theta = share * tick_s / 2
    error = mean_of_two - mean(w)
    w1, w2 = weights
    left = (share * tick_s - np.arange(points) * dt) / (share * tick_s)
    moved = [
        mean(left * share * tick_s * values)
        for values in (position[:, 1], -stiffness * position[:, 0] - damping * position[:, 1])
    ]
    divisor = 1 + theta * g * w2
    s = (position @ weights - w1 * moved[0] - w2 * moved[1] - theta * w2 * g * (w + error)) / divisor
    assert mean(s) == pytest.approx(held, abs=1e-9)
    n_, r = integral(mean_of_two - error - w), integral(held - s)
    beta = np.abs(b).max()
    v, shifted = position[:, 1] - g * (n_ + r), actuator + np.outer(r, b)
    q, fast = n_ + r, beta * r
    linear = w1 * (position[:, 0] - theta * v) + w2 * (
        v - theta * (-stiffness * position[:, 0] - damping * v + g * (w + error))
    )
    z = divisor * s - linear
    channel = axis_channel(axis, Fraction(str(tick_s)))
    number = list(itertools.product((-0.55, 0.55), (-0.35, 0.35))).index(tuple(weights))
    errors = np.stack([np.full(points, error), q, fast, z], axis=1)
    state = np.column_stack([position[:, 0], v, shifted])
    if share == 1.0:  # theta is that of the corner
        loop = channel.held[0][number]
        a_, e_, c_, d_ = (np.array(part, dtype=float) for part in (loop.a, loop.e, loop.c, loop.d))
        rates = state @ (a_ + e_ @ c_).T + errors @ d_.T
        assert np.allclose(np.gradient(state, dt, axis=0)[2:-2], rates[2:-2], atol=1e-4 * np.abs(rates).max())
    loop = channel.corners[0][number]
    y = state @ np.array(loop.c[0], dtype=float)
    rows = np.column_stack([state, y, errors])
    for bound, name in zip(loop.bounds, "EQFZ", strict=True):
        total = sum(float(factor) * mean((rows @ np.array(row, dtype=float)) ** 2) for factor, row in bound.terms)
        assert total > 0, name


def flown(axis, weights_at, tick_s, delay_s, ticks, seed, uneven):
    """Growth of the product's own step with e = 0 and weights as they come: largest state late over early, 1/s."""
    generator = np.random.default_rng(seed)
    kind = axis.response.dynamics
    values = tuple(float(end.lower if generator.random() < 0.5 else end.upper) for end in kind.intervals())
    piece_s = 1e-3
    advance = kind.step(values, piece_s)
    late = round(delay_s / piece_s)
    state, waiting = (0.0,) * (2 + kind.further), [0.0] * (late + 1)
    wn, zeta, g = float(axis.natural_frequency_rad_s), float(axis.damping_ratio), float(axis.gravity_m_s2)
    low, high = (tuple(map(float, ends)) for ends in (axis.weights_lower, axis.weights_upper))
    params = mrac.AxisParams(wn, zeta, g, 0.0, 0.0, 0.0, low[0], high[0], low[1], high[1], hedging=True)
    control = mrac.start(1.0, 0.0, 0.0, 0.0, 0.0)
    control = control._replace(command_m=0.0, control=0.0)
    sizes, time_s, dt_s = [], 0.0, 0.0
    for _ in range(ticks):
        if dt_s:
            over = transition(wn, zeta, dt_s)
            f11, f12, f21, f22, g1, g2 = over
            drive = g * (0.5 * (control.actuator + waiting[0]) - control.control)
            p, v = control.reference_position_m, control.reference_velocity_m_s
            at = (f11 * p + f12 * v + g1 * drive, f21 * p + f22 * v + g2 * drive)  # the vehicle: e = 0
        else:
            over, at = transition(wn, zeta, 1e-9), (1.0, 0.0)
        w1, w2 = weights_at(time_s, at, state, generator)
        control = control._replace(position_weight=w1, velocity_weight=w2)
        control, output = mrac.step(params, control, over, 0.0, *at, waiting[0], 0.0, dt_s)
        assert abs(output.error_position_m) < 1e-9 * max(1.0, abs(at[0]))
        pieces = int(generator.integers(1, round(tick_s / piece_s) + 1)) if uneven else round(tick_s / piece_s)
        for _ in range(pieces):
            state = advance(state, control.control)
            waiting = [*waiting[1:], state[0]]
        dt_s = pieces * piece_s
        time_s += dt_s
        sizes.append(max(abs(at[0]), abs(at[1]) / wn, *(abs(value) for value in waiting)))
    quarter = ticks // 4
    return math.log(max(sizes[-quarter:]) / max(sizes[quarter : 2 * quarter])) / time_s


def greedy(axis):
    """Weights that push with the attitude as it moves: near the worst that is known."""
    low, high = (tuple(map(float, ends)) for ends in (axis.weights_lower, axis.weights_upper))

    def weights_at(_time_s, at, state, _generator):
        return tuple(high[i] if at[i] * state[1] > 0 else low[i] for i in range(2))

    return weights_at


def switching(axis, period_s, phase):
    low, high = (tuple(map(float, ends)) for ends in (axis.weights_lower, axis.weights_upper))

    def weights_at(time_s, _at, _state, generator):
        if period_s == 0.0:
            return tuple(generator.choice([low[i], high[i]]) for i in range(2))
        return tuple(
            high[i] if math.sin(2 * math.pi * (time_s / period_s + phase[i])) > 0 else low[i] for i in range(2)
        )

    return weights_at


@settings(max_examples=20, deadline=None)
@given(data=st.data())
def test_no_certified_loop_grows_when_it_is_flown(data, rig):
    """Configs at the edge of what is certified, delayed, held over ticks as they come, under weights that switch."""
    second = data.draw(st.booleans())
    frequency = data.draw(st.sampled_from(["6", "9", "12"]))
    dynamics = SecondOrder(interval(frequency), interval("0.7", "1")) if second else FirstOrder(interval(frequency))
    delay = data.draw(st.sampled_from(["0", "0.01", "0.03"]))
    rate_hz = data.draw(st.sampled_from([25, 50, 100, 250]))
    axis = dataclasses.replace(rig(), response=AttitudeResponse(dynamics, interval(delay)))
    found = fastest_reference(axis, [0])
    assert found is not None
    sampling = Sampling(Decimal(rate_hz), Decimal("0.001"), Decimal("0.4"), Decimal("0.5"))
    certificate, share = None, Decimal("0.995")
    while certificate is None:
        edge = with_natural_frequency(axis, round(found.value * share, 3))
        certificate = certify(Problem({"x": edge}, sampling={"x": sampling}), 2, 0)
        share -= Decimal("0.03")
    assert verify(certificate).ok
    period = data.draw(st.floats(0.4, 2.5)) * 2 * math.pi / float(edge.natural_frequency_rad_s)
    phase = (data.draw(st.floats(0, 1)), data.draw(st.floats(0, 1)))
    seed, uneven = data.draw(st.integers(0, 99)), data.draw(st.booleans())
    ticks = 10 * rate_hz
    for weights_at in (greedy(edge), switching(edge, period, phase), switching(edge, 0.0, phase)):
        assert flown(edge, weights_at, 1 / rate_hz, float(delay), ticks, seed, uneven) < 0


def test_the_flown_loop_does_grow_where_it_is_proven_to(rig):
    """The flights above can tell: slower than what is proven unstable, the worst weights make it grow."""
    axis = rig("2.4")
    worst = worst_switching(axis)
    assert worst.spectral_radius > 1
    ends = np.cumsum(worst.durations_s)

    def weights_at(time_s, *_):
        return worst.weights[int(np.searchsorted(ends, time_s % ends[-1], side="right"))]

    assert flown(axis, weights_at, 0.001, 0.0, 20_000, 1, uneven=False) > 0
