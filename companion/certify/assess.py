"""All answers about one problem: certified or not, by what margin, and what could be had."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from decimal import Decimal
from functools import partial
from typing import NamedTuple

from companion.attitude_response.response import MAX_PADE_ORDER
from companion.certify.bandwidth import (
    Certified,
    fastest_reference,
    largest_delay,
    minimum_bandwidth,
    tuned_bandwidth,
    with_bandwidth,
)
from companion.certify.certificate import certify
from companion.certify.falsify import GROWTH_FLOOR, Counterexample, unstable_bandwidth, worst_switching
from companion.certify.problem import AxisProblem, Problem
from companion.certify.proof import MAX_DEGREE
from companion.certify.sampled import largest_adaptation_rate
from companion.certify.statement import Json

DELAY_DEGREE = 6  # highest degree of the delay search: degree 8 with a delay line takes minutes


class AxisAssessment(NamedTuple):
    """What is known of one axis; None where it does not apply, was not asked for or was not found.

    Attributes
    ----------
    tuned_bandwidth_rad_s
        The configured attitude bandwidth.
    minimum_bandwidth
        Least certified bandwidth in rad/s by degree, each with its proof.
    unstable_below
        Largest bandwidth in rad/s found unstable, and the switching that shows it.
    delay_s
        The configured delay, upper end.
    maximum_delay
        Largest certified delay in s.
    fastest_reference
        Largest certified natural frequency in rad/s.
    attack
        A switching that makes the tuned loop itself grow, with its delay as a Pade approximant of the highest order:
        a proof about a coarser approximant does not stand against it. None if none was found, or none can be.
    """

    tuned_bandwidth_rad_s: Decimal
    minimum_bandwidth: Mapping[int, Certified | None]
    unstable_below: tuple[Decimal, Counterexample] | None
    delay_s: Decimal
    maximum_delay: Certified | None
    fastest_reference: Certified | None
    attack: Counterexample | None


class Assessment(NamedTuple):
    """Everything `companion check` shows.

    Attributes
    ----------
    certificate
        The certificate, or None if the problem as configured is not certified.
    degree
        Highest degree the certificate needed.
    axes
        By name.
    adaptation_rates
        By axis, the configured adaptation rate and the largest stable one; empty without sampling.
    """

    certificate: dict[str, Json] | None
    degree: int | None
    axes: Mapping[str, AxisAssessment]
    adaptation_rates: Mapping[str, tuple[float, float]]

    @property
    def certified(self) -> bool:
        """Whether there is a certificate, no attack, and every adaptation rate is below its limit."""
        sampled = all(rate < limit for rate, limit in self.adaptation_rates.values())
        return self.certificate is not None and sampled and all(axis.attack is None for axis in self.axes.values())


def assess(
    problem: Problem,
    max_degree: int = 8,
    all_degrees: bool = False,
    fastest: bool = False,
    progress: Callable[[float, str], None] | None = None,
) -> Assessment:
    """Answer all questions about a problem.

    Parameters
    ----------
    problem
        What is configured.
    max_degree
        Highest degree to try, even.
    all_degrees
        Find the least bandwidth of every degree up to `max_degree`, not only of those needed for the tuned one.
    fastest
        Also find the fastest certified reference model.
    progress
        Called with the fraction done and what is being done.

    Raises
    ------
    ValueError
        If `max_degree` is not an even number from 2 on.
    """
    if not 2 <= max_degree <= MAX_DEGREE or max_degree % 2:
        raise ValueError(f"degree must be even, from 2 to {MAX_DEGREE}, not {max_degree}")
    show = progress or _silent
    certificate = certify(problem, max_degree)
    known: dict[AxisProblem, AxisAssessment] = {}
    axes = {}
    for index, (name, axis) in enumerate(problem.axes.items()):
        family = with_bandwidth(axis, Decimal(1))  # axes that differ in bandwidth alone share both bounds
        twin = next((known[other] for other in known if with_bandwidth(other, Decimal(1)) == family), None)
        if axis not in known:
            share = partial(_scaled, show, index / len(problem.axes), 1 / len(problem.axes), name)
            known[axis] = _assess_axis(axis, max_degree, all_degrees, fastest, twin, share)
        axes[name] = known[axis]
    show(1.0, "done")
    return Assessment(
        certificate,
        None if certificate is None else max(_degrees(certificate)),
        axes,
        {
            name: (float(sampling.adaptation_rate), largest_adaptation_rate(problem.axes[name], sampling))
            for name, sampling in problem.sampling.items()
        },
    )


def to_json(assessment: Assessment) -> dict[str, object]:
    """The machine-readable contract of `companion check --json`."""
    return {
        "certified": assessment.certified,
        "degree": assessment.degree,
        "axes": {
            name: {
                "tuned_bandwidth_rad_s": float(axis.tuned_bandwidth_rad_s),
                "minimum_bandwidth_rad_s": {str(d): _value(c) for d, c in axis.minimum_bandwidth.items()},
                "unstable_below_rad_s": None if axis.unstable_below is None else float(axis.unstable_below[0]),
                "delay_s": float(axis.delay_s),
                "maximum_delay_s": _value(axis.maximum_delay),
                "fastest_natural_frequency_rad_s": _value(axis.fastest_reference),
            }
            for name, axis in assessment.axes.items()
        },
        "adaptation_rate_limit": min((limit for _, limit in assessment.adaptation_rates.values()), default=None),
    }


def _assess_axis(
    axis: AxisProblem,
    max_degree: int,
    all_degrees: bool,
    fastest: bool,
    twin: AxisAssessment | None,
    show: Callable[[float, str], None],
) -> AxisAssessment:
    tuned = tuned_bandwidth(axis.response)
    degrees = range(2, max_degree + 1, 2)
    minimum: dict[int, Certified | None] = dict.fromkeys(degrees)
    show(0.0, "degree 2")
    minimum[2] = minimum_bandwidth(axis, 2) if twin is None else twin.minimum_bandwidth[2]
    show(0.1, "counterexample")
    if twin is None:
        above = float(minimum[2].value) if minimum[2] else 2 * float(tuned)
        unstable = unstable_bandwidth(partial(with_bandwidth, axis), above)
    else:
        unstable = twin.unstable_below
    best = minimum[2]
    for degree in degrees[1:]:
        if not all_degrees and best is not None and best.value <= tuned:
            break
        show(0.1 + 0.5 * degree / max_degree, f"degree {degree}")
        if twin is not None and twin.minimum_bandwidth[degree] is not None:
            minimum[degree] = twin.minimum_bandwidth[degree]
        else:
            floor = float(unstable[0]) if unstable else 0.0
            minimum[degree] = minimum_bandwidth(axis, degree, floor, float(best.value) if best else None)
        best = minimum[degree] or best
    needed = [d for d, found in minimum.items() if found is not None and found.value <= tuned]
    tried = [d for d in degrees if d <= max([DELAY_DEGREE, *needed[:1]])]
    show(0.6, "delay")
    delay = largest_delay(axis, tried)
    show(0.8, "fastest reference model")
    quickest = fastest_reference(axis, tried) if fastest else None
    show(0.95, "attack")
    found = None if needed and not axis.response.delay_s.upper else attack(axis)
    return AxisAssessment(tuned, minimum, unstable, axis.response.delay_s.upper, delay, quickest, found)


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


def _degrees(certificate: Mapping[str, Json]) -> Iterator[int]:
    proofs = certificate["proofs"]
    assert isinstance(proofs, Mapping)
    for proof in proofs.values():
        assert isinstance(proof, Mapping)
        yield int(str(proof["degree"]))


def _value(certified: Certified | None) -> float | None:
    return None if certified is None else float(certified.value)
