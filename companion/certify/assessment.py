"""What is known of a problem: certified or not, by what margin, and what could be had; as a record and as JSON."""

from collections.abc import Iterator, Mapping
from decimal import Decimal
from typing import NamedTuple

from companion.certify.falsify import Counterexample
from companion.certify.piecewise.sector_proof import DELAY, TICK
from companion.certify.proof import longest_tick_s
from companion.certify.search.bisection import Certified
from companion.certify.statement import Json, problem_of


class AxisAssessment(NamedTuple):
    """What is known of one axis; None where it does not apply, was not asked for or was not found.

    Attributes
    ----------
    tuned_bandwidth_rad_s
        The configured attitude bandwidth.
    minimum_bandwidth
        Least certified bandwidth in rad/s by degree, each with its proof; empty with a delay, which no degree takes.
    minimum_bandwidth_by_rays
        The same by rays, none being one quadratic function, with the true delay, in continuous time.
    unstable_below
        Largest bandwidth in rad/s found unstable, and the switching that shows it.
    delay_s
        The configured delay, upper end.
    maximum_delay
        Largest certified delay in s, at the slowest tick.
    fastest_reference
        Largest certified natural frequency in rad/s, at the slowest tick.
    attack
        Where there is no certificate, a switching that makes the tuned loop itself grow, with its delay as a Pade
        approximant of the highest order. None if none was found, or none can be.
    """

    tuned_bandwidth_rad_s: Decimal
    minimum_bandwidth: Mapping[int, Certified | None]
    minimum_bandwidth_by_rays: Mapping[int, Certified | None]
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
    degree, rays
        Highest degree, and most rays, that the certificate needed; None if it needed none. A quadratic function is of
        degree 2, whatever the delay.
    axes
        By name; empty if only the verdict was asked for.
    adaptation_rates
        By axis, the configured adaptation rate and the largest stable one; empty without sampling.
    growing
        Axes that grow at the slowest tick with the weights held at a corner (`held`), and that rate.
    """

    certificate: dict[str, Json] | None
    degree: int | None
    rays: int | None
    axes: Mapping[str, AxisAssessment]
    adaptation_rates: Mapping[str, tuple[float, float]]
    growing: Mapping[str, float]

    @property
    def certified(self) -> bool:
        """Whether there is a certificate, every adaptation rate is below its limit, and nothing grows at the tick."""
        sampled = all(rate < limit for rate, limit in self.adaptation_rates.values())
        return self.certificate is not None and sampled and not self.growing


def to_json(assessment: Assessment) -> dict[str, object]:
    """The machine-readable contract of `companion check --json`."""
    return {
        "certified": assessment.certified,
        "degree": assessment.degree,
        "sectors": assessment.rays,
        "proof": {"delay": _proof_of(assessment, "delay", DELAY), "tick": _proof_of(assessment, "tick", TICK)},
        "axes": {
            name: {
                "tuned_bandwidth_rad_s": float(axis.tuned_bandwidth_rad_s),
                "minimum_bandwidth_rad_s": _bandwidths(axis),
                "unstable_below_rad_s": None if axis.unstable_below is None else float(axis.unstable_below[0]),
                "delay_s": float(axis.delay_s),
                "maximum_delay_s": _value(axis.maximum_delay),
                "fastest_natural_frequency_rad_s": _value(axis.fastest_reference),
            }
            for name, axis in assessment.axes.items()
        },
        "delay_interval_s": delay_intervals(assessment),
        "tick_hz_certified": slowest_ticks_hz(assessment),
        "adaptation_rate_limit": min((limit for _, limit in assessment.adaptation_rates.values()), default=None),
    }


def needed(certificate: Mapping[str, Json]) -> tuple[list[int], list[int]]:
    """Degrees and rays of its proofs."""
    degrees, rays = [], []
    for proof in _proofs(certificate):
        if "rays" in proof:
            assert isinstance(proof["rays"], list)
            rays.append(len(proof["rays"]))
            degrees += [] if proof["rays"] else [2]
        else:
            degrees.append(int(str(proof["degree"])))
    return degrees, rays


def _proofs(certificate: Mapping[str, Json]) -> Iterator[Mapping[str, Json]]:
    proofs = certificate["proofs"]
    assert isinstance(proofs, Mapping)
    for proof in proofs.values():
        assert isinstance(proof, Mapping)
        yield proof


def _proof_of(assessment: Assessment, what: str, by: str) -> str | None:
    """How the certificate takes the delay or the tick; None where it does not."""
    proofs = [] if assessment.certificate is None else list(_proofs(assessment.certificate))
    return by if any(proof.get(what) == by for proof in proofs) else None


def slowest_ticks_hz(assessment: Assessment) -> dict[str, float] | None:
    """The slowest tick that is proven, by axis; None without a certificate, or where it says nothing of the tick."""
    if assessment.certificate is None or _proof_of(assessment, "tick", TICK) is None:
        return None
    stated = problem_of(assessment.certificate["problem"])
    return {name: float(1 / longest_tick_s(stated, name)) for name in stated.axes if longest_tick_s(stated, name)}


def delay_intervals(assessment: Assessment) -> dict[str, list[float]] | None:
    """Ends of the certified interval of the delay by axis; None without a certificate."""
    if assessment.certificate is None:
        return None
    stated = problem_of(assessment.certificate["problem"])
    return {name: [float(end) for end in axis.response.delay_s] for name, axis in stated.axes.items()}


def _bandwidths(axis: AxisAssessment) -> dict[str, float | None]:
    """By degree, and by rays; a quadratic function is both."""
    by_rays = {
        f"sectors_{count}" if count else "quadratic": _value(c) for count, c in axis.minimum_bandwidth_by_rays.items()
    }
    return {"2": by_rays["quadratic"]} | {str(d): _value(c) for d, c in axis.minimum_bandwidth.items()} | by_rays


def _value(certified: Certified | None) -> float | None:
    return None if certified is None else float(certified.value)
