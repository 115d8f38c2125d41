"""All answers about one problem: certified or not, by what margin, and what could be had."""

from collections.abc import Callable
from dataclasses import replace
from decimal import Decimal
from fractions import Fraction
from functools import partial
from typing import NamedTuple

from companion.attitude_response.response import MAX_PADE_ORDER
from companion.certify.assessment import Assessment, AxisAssessment, needed
from companion.certify.bandwidth import (
    fastest_reference,
    largest_delay,
    minimum_bandwidth,
    minimum_bandwidth_by_rays,
    tuned_bandwidth,
    with_bandwidth,
)
from companion.certify.certificate import RAYS, certify
from companion.certify.falsify import GROWTH_FLOOR, Counterexample, unstable_bandwidth, worst_switching
from companion.certify.polynomial.polynomial_proof import MAX_DEGREE
from companion.certify.problem import AxisProblem, Problem
from companion.certify.proof import longest_tick_s
from companion.certify.sampling.held import grows
from companion.certify.sampling.sampled import largest_adaptation_rate
from companion.certify.search.bisection import Certified
from companion.processes import Processes

SEARCH_RAYS = (8, 16)  # of the searches over delay and reference model, for a response of many corners and of one


def verdict_of(problem: Problem, max_degree: int = 2, max_rays: int = RAYS[-1]) -> Assessment:
    """Certified or not, and nothing else.

    Raises
    ------
    ValueError
        If `max_degree` is not an even number from 2 on.
    """
    if not 2 <= max_degree <= MAX_DEGREE or max_degree % 2:
        raise ValueError(f"degree must be even, from 2 to {MAX_DEGREE}, not {max_degree}")
    certificate = certify(problem, max_degree, max_rays)
    limits = {
        name: (float(sampling.adaptation_rate), largest_adaptation_rate(problem.axes[name], sampling))
        for name, sampling in problem.sampling.items()
    }
    degrees, rays = ([], []) if certificate is None else needed(certificate)
    growing = {
        name: float(sampling.tick_rate_hz)
        for name, sampling in problem.sampling.items()
        if grows(problem.axes[name], sampling)
    }
    most = max(filter(None, rays), default=None)
    return Assessment(certificate, max(degrees, default=None), most, {}, limits, growing)


def assess(
    problem: Problem,
    max_degree: int = 2,
    all_methods: bool = False,
    fastest: bool = False,
    progress: Callable[[float, str], None] | None = None,
    max_rays: int = RAYS[-1],
    known_verdict: Assessment | None = None,
) -> Assessment:
    """Answer all questions about a problem.

    Parameters
    ----------
    problem
        What is configured.
    max_degree
        Highest degree to try, even.
    all_methods
        Find the least bandwidth of every degree and of all rays, not only of those needed for the tuned one.
    fastest
        Also find the fastest certified reference model.
    progress
        Called with the fraction done and what is being done.
    max_rays
        Most rays to try.
    known_verdict
        Of `verdict_of`, if it is at hand.

    Raises
    ------
    ValueError
        If `max_degree` is not an even number from 2 on.
    """
    show = progress or _silent
    found = known_verdict or verdict_of(problem, max_degree, max_rays)
    known: dict[AxisProblem, AxisAssessment] = {}
    axes = {}
    ticks_s = {name: longest_tick_s(problem, name) for name in problem.axes}
    with Processes(any(_long(axis) or ticks_s[name] for name, axis in problem.axes.items())) as processes:
        efforts = {
            name: _Effort(max_degree, max_rays, all_methods, fastest, found.certificate is None, ticks_s[name])
            for name in problem.axes
        }
        begun: dict[AxisProblem, _Searches] = {}  # all of them at once, so that no core waits
        for name, axis in problem.axes.items():
            if axis not in begun:
                begun[axis] = _begin(axis, efforts[name], processes)
        for index, (name, axis) in enumerate(problem.axes.items()):
            family = with_bandwidth(axis, Decimal(1))  # axes that differ in bandwidth alone share both bounds
            twin = next((known[other] for other in known if with_bandwidth(other, Decimal(1)) == family), None)
            if axis not in known:
                share = partial(_scaled, show, index / len(problem.axes), 1 / len(problem.axes), name)
                known[axis] = _assess_axis(axis, efforts[name], twin, begun[axis], share)
            axes[name] = known[axis]
    show(1.0, "done")
    return found._replace(axes=axes)


class _Effort(NamedTuple):
    """How much is asked for."""

    max_degree: int
    max_rays: int
    all_methods: bool
    fastest: bool
    attack: bool
    tick_s: Fraction


class _Searches(NamedTuple):
    """What is searched elsewhere: to be asked for its result."""

    fastest: Callable[[], Certified | None] | None
    delay: Callable[[], Certified | None]


def _begin(axis: AxisProblem, effort: _Effort, processes: Processes) -> _Searches:
    most = SEARCH_RAYS[effort.all_methods or not _long(axis)]
    counts = [count for count in RAYS if count <= min(most, effort.max_rays)]
    fastest = processes.call(fastest_reference, axis, counts, effort.tick_s) if effort.fastest else None
    return _Searches(fastest, processes.call(largest_delay, axis, counts, effort.tick_s))


def _long(axis: AxisProblem) -> bool:
    """Whether its searches take longer than other processes take to start."""
    return len(axis.response.dynamics.corners()) > 1


def _assess_axis(
    axis: AxisProblem,
    effort: _Effort,
    twin: AxisAssessment | None,
    searches: _Searches,
    show: Callable[[float, str], None],
) -> AxisAssessment:
    tuned = tuned_bandwidth(axis.response)
    show(0.0, "needed bandwidth, quadratic")
    by_rays: dict[int, Certified | None] = {count: None for count in RAYS if count <= effort.max_rays}
    by_rays[0] = minimum_bandwidth_by_rays(axis, 0) if twin is None else twin.minimum_bandwidth_by_rays[0]
    show(0.1, "counterexample")
    if twin is None:
        above = float(by_rays[0].value) if by_rays[0] else 2 * float(tuned)
        unstable = unstable_bandwidth(partial(with_bandwidth, axis), above)
    else:
        unstable = twin.unstable_below
    # A counterexample to an approximant of the delay is none to the delay: only without one does it bound the search.
    floor = float(unstable[0]) if unstable and not axis.response.delay_s.upper else 0.0
    best = by_rays[0]
    for number, count in enumerate(list(by_rays)[1:]):
        if not effort.all_methods and best is not None and best.value <= tuned:
            break
        show(0.2 + 0.1 * number, f"needed bandwidth, {count} sectors")
        known = None if twin is None else twin.minimum_bandwidth_by_rays.get(count)
        by_rays[count] = known or minimum_bandwidth_by_rays(axis, count, floor, float(best.value) if best else None)
        best = by_rays[count] or best
    show(0.5, "needed bandwidth, by degree")
    by_degree = {} if axis.response.delay_s.upper else _by_degree(axis, effort, twin, floor)
    show(0.6, "delay budget")
    longest = searches.delay()
    show(0.8, "fastest reference model")
    quickest = None if searches.fastest is None else searches.fastest()
    show(0.95, "attack")
    found = attack(axis) if effort.attack else None
    return AxisAssessment(tuned, by_degree, by_rays, unstable, axis.response.delay_s.upper, longest, quickest, found)


def _by_degree(
    axis: AxisProblem, effort: _Effort, twin: AxisAssessment | None, floor: float
) -> dict[int, Certified | None]:
    tuned, best = tuned_bandwidth(axis.response), None
    found: dict[int, Certified | None] = dict.fromkeys(range(2, effort.max_degree + 1, 2))
    for degree in range(2, effort.max_degree + 1, 2):
        if not effort.all_methods and best is not None and best.value <= tuned:
            break
        known = None if twin is None else twin.minimum_bandwidth.get(degree)
        found[degree] = known or minimum_bandwidth(axis, degree, floor, float(best.value) if best else None)
        best = found[degree] or best
    return found


def attack(axis: AxisProblem) -> Counterexample | None:
    """A switching that destabilises the axis as tuned, its delay modelled as finely as can be."""
    finest = replace(axis, response=replace(axis.response, pade_order=MAX_PADE_ORDER))
    worst = worst_switching(finest)
    return worst if worst.spectral_radius > 1 + GROWTH_FLOOR else None


def _silent(_fraction: float, _text: str) -> None:
    """No progress shown."""


def _scaled(
    show: Callable[[float, str], None], start: float, share: float, name: str, fraction: float, text: str
) -> None:
    show(start + share * fraction, f"{name}: {text}")
