"""How far a certificate reaches: least bandwidth by degree, largest delay, fastest reference model.

Every figure is a bisection in floating point; what is reported was then proven at exactly that number. The bandwidth
needed is that of the theorem in continuous time, as the paper has it; delay and reference model are those that fly,
held over the tick: they are searched without the hold, which is quick, and then from there downwards with it.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from decimal import ROUND_FLOOR, Decimal
from fractions import Fraction

import numpy as np

from companion.attitude_response.exact import Interval
from companion.attitude_response.kind import PLACES, ceiling
from companion.attitude_response.realisation import ZERO
from companion.attitude_response.response import AttitudeResponse
from companion.certify.certificate import Scaling, prove
from companion.certify.closed_loop import axis_channel, axis_vertices
from companion.certify.piecewise.hold import TooSlowError
from companion.certify.piecewise.sector_search import Active, believed
from companion.certify.problem import AxisProblem
from companion.certify.search.bisection import (
    REACH,
    Attempt,
    Certified,
    Found,
    between,
    boundary,
    certified,
    first,
    rise,
)

_HELD_DELAY = (0.03, 2e-3)  # of the value: what the hold is first thought to cost, and to how much it is found
_HELD_REFERENCE = (0.015, 1e-3)  # likewise
DELAY_PLACES = Decimal("0.00001")  # s


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
    """The least bandwidth that the degree certifies in continuous time, for an axis without a delay.

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

    def attempt(value: float) -> Found | None:
        bandwidth = ceiling(Decimal(value), PLACES)
        proof = prove(axis_vertices(with_bandwidth(problem, bandwidth)), degree, scaling)
        return None if proof is None else Found(bandwidth, lambda: proof)

    return certified(boundary(attempt, start, above))


def minimum_bandwidth_by_rays(
    problem: AxisProblem, count: int, above: float = 0.0, below: float | None = None
) -> Certified | None:
    """The least bandwidth that so many rays certify in continuous time, with the true delay; as `minimum_bandwidth`."""
    start = float(tuned_bandwidth(problem.response)) if below is None else below
    active = Active()

    def attempt(value: float) -> Found | None:
        bandwidth = ceiling(Decimal(value), PLACES)
        return _found(bandwidth, with_bandwidth(problem, bandwidth), count, ZERO, active)

    return certified(boundary(attempt, start, above))


def largest_delay(problem: AxisProblem, counts: Sequence[int], tick_s: Fraction = ZERO) -> Certified | None:
    """The largest true delay in s that one of the counts of rays certifies, the rest as tuned; None if not even zero.

    From the configured interval the upper end moves. `tick_s`: the longest tick in s.
    """
    period = 2 * math.pi / float(problem.natural_frequency_rad_s)

    def at(value: float) -> tuple[Decimal, AxisProblem]:
        delay = Decimal(value).quantize(DELAY_PLACES, ROUND_FLOOR)
        return delay, with_delay(problem, delay)

    return _largest(at, counts, 0.0, (0.0, 0.99 * period), tick_s, _HELD_DELAY)


def fastest_reference(problem: AxisProblem, counts: Sequence[int], tick_s: Fraction = ZERO) -> Certified | None:
    """The largest natural frequency in rad/s that one of the counts of rays certifies.

    Damping ratio and attitude response stay, the bounds keep their proportion to the nominal weights. None if nothing
    above a hundredth of the configured one is certified. `tick_s`: the longest tick in s."""
    configured = float(problem.natural_frequency_rad_s)
    slowest_delay = float(problem.response.delay_s.upper)
    limit = min(REACH * configured, 0.99 * 2 * math.pi / slowest_delay if slowest_delay else math.inf)

    def at(value: float) -> tuple[Decimal, AxisProblem]:
        frequency = Decimal(value).quantize(PLACES, ROUND_FLOOR)
        return frequency, with_natural_frequency(problem, frequency)

    return _largest(at, counts, configured, (0.01 * configured, limit), tick_s, _HELD_REFERENCE)


def _found(value: Decimal, problem: AxisProblem, count: int, tick_s: Fraction, active: Active) -> Found | None:
    """What floating point says of an axis with so many rays."""
    try:
        channel = axis_channel(problem, tick_s)
        candidate = believed(channel, count, float(problem.natural_frequency_rad_s), active)
    except (np.linalg.LinAlgError, TooSlowError):  # numbers too far apart for floating point, or too slow a tick
        return None
    return None if candidate is None else Found(value, candidate.proven)


def _largest(
    at: Callable[[float], tuple[Decimal, AxisProblem]],
    counts: Sequence[int],
    start: float,
    limits: tuple[float, float],
    tick_s: Fraction,
    held: tuple[float, float],
) -> Certified | None:
    """The largest value within the limits that is proven by one of the counts; the search begins at `start`."""
    low, high = limits
    found: list[Found] = []
    for count in counts:
        attempt = _attempt(at, count, ZERO)
        found += rise(attempt, float(found[-1].value), high) if found else first(attempt, start, low, high)
    if not found or not tick_s:
        return certified(found)
    # With the hold a little less is left: from there down in growing steps, then between the last two.
    attempt, top = _attempt(at, counts[-1], tick_s), float(found[-1].value)
    share, tolerance = held
    while top > low:
        bottom = max(top * (1 - share), low)
        lower = attempt(bottom)
        if lower is not None:
            return certified([lower, *between(attempt, bottom, top, tolerance)])
        top, share = bottom, min(2 * share, 0.5)
    return None


def _attempt(at: Callable[[float], tuple[Decimal, AxisProblem]], count: int, tick_s: Fraction) -> Attempt:
    active = Active()

    def attempt(value: float) -> Found | None:
        number, problem = at(value)
        return _found(number, problem, count, tick_s, active)

    return attempt
