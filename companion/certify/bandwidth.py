"""How far a certificate reaches: least bandwidth by degree, largest delay, fastest reference model.

Every figure is a bisection whose verdicts are exact proofs: what is reported was proven at exactly that number.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from decimal import ROUND_FLOOR, Decimal
from fractions import Fraction
from typing import NamedTuple

import numpy as np

from companion.attitude_response.exact import Interval
from companion.attitude_response.kind import PLACES, ceiling
from companion.attitude_response.response import AttitudeResponse
from companion.certify.certificate import AnyProof, Scaling, prove
from companion.certify.closed_loop import axis_channel, axis_vertices
from companion.certify.piecewise.sector_proof import SectorProof
from companion.certify.piecewise.sector_solver import prove_by_sectors
from companion.certify.problem import AxisProblem

TOLERANCE = 5e-4  # relative, of every bisection
REACH = 32.0  # how many times the tuned value is searched before giving up
DELAY_PLACES = Decimal("0.00001")  # s


class Certified(NamedTuple):
    """A number and the exactly checked proof at that number."""

    value: Decimal
    proof: AnyProof


def tuned_bandwidth(response: AttitudeResponse) -> Decimal:
    """The number called bandwidth, rad/s: M, natural frequency, or -3 dB frequency; of an interval the lower end."""
    return response.dynamics.bandwidth()


def with_bandwidth(problem: AxisProblem, bandwidth: Decimal) -> AxisProblem:
    """The same problem with another attitude bandwidth in rad/s; damping, delay and width of intervals are kept."""
    return replace(
        problem, response=replace(problem.response, dynamics=problem.response.dynamics.with_bandwidth(bandwidth))
    )


def with_delay(problem: AxisProblem, delay_s: Decimal) -> AxisProblem:
    """The same problem with another delay; of an interval the upper end moves, the lower no further than it must."""
    lower = min(problem.response.delay_s.lower, delay_s)
    if problem.response.delay_s.lower == problem.response.delay_s.upper or lower == 0:
        lower = delay_s
    return replace(problem, response=replace(problem.response, delay_s=Interval(lower, delay_s)))


def with_natural_frequency(problem: AxisProblem, natural_frequency_rad_s: Decimal) -> AxisProblem:
    """The same damping ratio and bounds in proportion to the nominal weights, for another reference model.

    The bounds are rounded outwards to six places.
    """
    ratio = Fraction(natural_frequency_rad_s) / Fraction(problem.natural_frequency_rad_s)
    growth = (ratio * ratio, ratio)  # of the two nominal weights
    lower, upper = (
        [Fraction(w) * factor for w, factor in zip(bounds, growth, strict=True)]
        for bounds in (problem.weights_lower, problem.weights_upper)
    )
    places = 10**6
    return replace(
        problem,
        natural_frequency_rad_s=natural_frequency_rad_s,
        weights_lower=(
            Decimal(math.floor(lower[0] * places)) / places,
            Decimal(math.floor(lower[1] * places)) / places,
        ),
        weights_upper=(Decimal(math.ceil(upper[0] * places)) / places, Decimal(math.ceil(upper[1] * places)) / places),
    )


def minimum_bandwidth(
    problem: AxisProblem, degree: int, above: float = 0.0, below: float | None = None
) -> Certified | None:
    """The least bandwidth that the degree certifies, for an axis without a delay.

    Parameters
    ----------
    problem
        Axis; its bandwidth is where the search starts.
    degree
        Even degree of the polynomial.
    above
        Bandwidth in rad/s known not to be certified, such as that of a counterexample.
    below
        Bandwidth in rad/s known to be certified by a lower degree.

    Returns
    -------
    Certified or None
        None if no bandwidth up to `REACH` times the tuned one is certified.

    Raises
    ------
    ValueError
        If there is a delay.
    """
    if problem.response.delay_s.upper:
        raise ValueError("no degree certifies a delay")
    start = float(tuned_bandwidth(problem.response)) if below is None else below
    scaling = Scaling(axis_vertices(with_bandwidth(problem, ceiling(Decimal(start), PLACES))))

    def attempt(value: float) -> Certified | None:
        bandwidth = ceiling(Decimal(value), PLACES)
        proof = prove(axis_vertices(with_bandwidth(problem, bandwidth)), degree, scaling)
        return None if proof is None else Certified(bandwidth, proof)

    return _boundary(attempt, start, above)


def prove_axis(problem: AxisProblem, count: int) -> SectorProof | None:
    """An axis with its true delay, by so many rays."""
    try:
        return prove_by_sectors(axis_channel(problem), count, float(problem.natural_frequency_rad_s))
    except np.linalg.LinAlgError:  # numbers too far apart for floating point: no candidate, no proof
        return None


def minimum_bandwidth_by_rays(
    problem: AxisProblem, count: int, above: float = 0.0, below: float | None = None
) -> Certified | None:
    """The least bandwidth that so many rays certify, with the true delay; as `minimum_bandwidth`."""
    start = float(tuned_bandwidth(problem.response)) if below is None else below

    def attempt(value: float) -> Certified | None:
        bandwidth = ceiling(Decimal(value), PLACES)
        proof = prove_axis(with_bandwidth(problem, bandwidth), count)
        return None if proof is None else Certified(bandwidth, proof)

    return _boundary(attempt, start, above)


def largest_delay(problem: AxisProblem, counts: Sequence[int]) -> Certified | None:
    """The largest true delay in s that one of the counts of rays certifies, the rest as tuned; None if not even zero.

    From the configured interval the upper end moves.
    """
    period = 2 * math.pi / float(problem.natural_frequency_rad_s)
    best: Certified | None = None
    for count in counts:

        def attempt(value: float, count: int = count) -> Certified | None:
            delay = Decimal(value).quantize(DELAY_PLACES, ROUND_FLOOR)
            proof = prove_axis(with_delay(problem, delay), count)
            return None if proof is None else Certified(delay, proof)

        best = _largest(attempt, float(best.value) if best else 0.0, 0.99 * period, best)
    return best


def fastest_reference(problem: AxisProblem, counts: Sequence[int]) -> Certified | None:
    """The largest natural frequency in rad/s that one of the counts of rays certifies.

    Damping ratio and attitude response stay, the bounds keep their proportion to the nominal weights. None if nothing
    above a hundredth of the configured one is certified."""
    configured = float(problem.natural_frequency_rad_s)
    slowest_delay = float(problem.response.delay_s.upper)
    limit = min(REACH * configured, 0.99 * 2 * math.pi / slowest_delay if slowest_delay else math.inf)
    best: Certified | None = None
    for count in counts:

        def attempt(value: float, count: int = count) -> Certified | None:
            frequency = Decimal(value).quantize(PLACES, ROUND_FLOOR)
            proof = prove_axis(with_natural_frequency(problem, frequency), count)
            return None if proof is None else Certified(frequency, proof)

        best = _largest(attempt, float(best.value) if best else 0.01 * configured, limit, best)
    return best


def _boundary(attempt: Callable[[float], Certified | None], start: float, above: float) -> Certified | None:
    """Least value that succeeds, by doubling and bisection from `start`; values up to `above` are known to fail."""
    good, high = attempt(start), start
    while good is None:
        above, high = high, 1.5 * high
        if high > REACH * start:
            return None
        good = attempt(high)
    low = max(above, 0.8 * high)
    while low > above and (better := attempt(low)) is not None:
        good, high, low = better, low, max(above, 0.8 * low)
        if high < start / 1000:
            return good
    while high - low > TOLERANCE * high:
        middle = (low + high) / 2
        better = attempt(middle)
        if better is None:
            low = middle
        else:
            good, high = better, middle
    return good


def _largest(
    attempt: Callable[[float], Certified | None], low: float, high: float, known: Certified | None
) -> Certified | None:
    """Largest value that succeeds between `low`, where `known` holds if given, and `high`."""
    good = known or attempt(low)
    if good is None:
        return None
    step = max(0.1 * low, 0.01 * high)
    while low + step < high and (better := attempt(low + step)) is not None:
        good, low, step = better, low + step, 2 * step
    high = min(high, low + step)
    while high - low > TOLERANCE * high:
        middle = (low + high) / 2
        better = attempt(middle)
        if better is None:
            high = middle
        else:
            good, low = better, middle
    return good
