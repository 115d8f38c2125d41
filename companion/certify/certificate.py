"""From a problem to a certificate: solve, round to rationals, verify exactly. The solver's status is never asked."""

import math
import platform
from collections.abc import Mapping, Sequence
from dataclasses import replace
from decimal import ROUND_FLOOR, Decimal
from fractions import Fraction
from importlib import metadata

import numpy as np

from companion.attitude_response.exact import NO_DELAY, Interval
from companion.attitude_response.realisation import Matrix
from companion.attitude_response.response import SHORTEST_DELAY_S
from companion.certify.assumptions import assumptions
from companion.certify.piecewise.hold import TooSlowError
from companion.certify.piecewise.sector_proof import SectorProof, sector_proof_json
from companion.certify.piecewise.sector_search import prove_by_sectors
from companion.certify.piecewise.sectors import Channel, delayed
from companion.certify.polynomial.lyapunov import Candidate, Floats, coordinates, rescale, solve
from companion.certify.polynomial.polynomial_proof import Proof, check
from companion.certify.problem import Problem
from companion.certify.proof import SCHEMA, channel_vertices, channels, verify
from companion.certify.statement import Json, digest, statement

AnyProof = Proof | SectorProof

RAYS = (0, 8, 16, 32)
"""Tried in turn; none is one quadratic function. Twice the rays halve what is lost to the truth, and cost twice."""

_SHARES = (Decimal("0.98"), Decimal("0.9"), Decimal("0.7"), Decimal("0.4"))
"""Of the largest delay of an axis by itself, tried for a link: the tick, and a yaw that turns, may bear less."""
_SHORTEST_S = Decimal("0.0001")  # of a link's delay, and the places of one

ROUNDING_BITS = (10, 16, 24, 34)  # tried in turn: few bits make a short certificate, many follow a thin margin


class Scaling:
    """Time unit and coordinates for a set of vertices; reusable for neighbouring problems of the same state."""

    def __init__(self, vertices: Sequence[Matrix]) -> None:
        self.time_scale, self.transform = coordinates(floats(vertices))

    def apply(self, vertices: Sequence[Matrix]) -> Floats:
        """(m, n, n) vertices in the scaled coordinates and time."""
        return rescale(floats(vertices), self.time_scale, self.transform)


def floats(vertices: Sequence[Matrix]) -> Floats:
    """(m, n, n) array of exact matrices."""
    return np.array([[[float(entry) for entry in row] for row in matrix] for matrix in vertices])


def prove(vertices: Sequence[Matrix], degree: int, scaling: Scaling | None = None) -> Proof | None:
    """An exactly checked proof of the degree that all vertices share a Lyapunov polynomial, or None.

    Parameters
    ----------
    vertices
        Closed-loop matrices of `companion.certify.closed_loop`.
    degree
        Even degree of the polynomial.
    scaling
        Scaling to use; by default that of the vertices themselves.
    """
    try:
        scaling = scaling or Scaling(vertices)
        candidate = solve(scaling.apply(vertices), degree)
    except np.linalg.LinAlgError:  # numbers too far apart for floating point: no candidate, no proof
        return None
    if candidate is None:
        return None
    for bits in ROUNDING_BITS:
        if candidate.margin < 2.0 ** -(bits + 2):  # rounding alone would eat the margin
            continue
        proof = rounded(candidate, degree, scaling, bits)
        if not check(proof, vertices):
            return proof
    return None


def rounded(candidate: Candidate, degree: int, scaling: Scaling, bits: int) -> Proof:
    """The candidate in rationals with `bits` binary places."""
    size = len(candidate.lyapunov)
    return Proof(
        degree,
        Fraction(scaling.time_scale),
        tuple(tuple(Fraction(float(entry)) for entry in row) for row in scaling.transform),
        tuple(_dyadic(candidate.lyapunov[i, j], bits) for i in range(size) for j in range(i + 1)),
        tuple(tuple(_dyadic(value, bits) for value in row) for row in candidate.multipliers),
    )


def prove_channel(channel: Channel, frequency_rad_s: float, max_degree: int, max_rays: int) -> AnyProof | None:
    """The first proof that holds: by degree up to `max_degree` without delay and hold, then by `RAYS`.

    Several axes at once, with the yaw free, have no sectors.
    """
    plain = not delayed(channel) and not channel.held
    if plain:
        vertices = channel_vertices(channel)
        scaling = Scaling(vertices)
        for degree in range(2, max_degree + 1, 2):
            proof = prove(vertices, degree, scaling)
            if proof is not None:
                return proof
    for count in RAYS if len(channel.corners[0]) == 4 else RAYS[:1]:
        if count <= max_rays and (count or not plain):
            by_sectors = prove_by_sectors(channel, count, frequency_rad_s)
            if by_sectors is not None:
                return by_sectors
    return None


def certify(problem: Problem, max_degree: int = 2, max_rays: int = RAYS[-1]) -> dict[str, Json] | None:
    """The certificate of a problem as a JSON object, or None if nothing up to `max_degree` and `max_rays` proves it."""
    proofs: dict[str, AnyProof] = {}
    known: dict[Channel, AnyProof | None] = {}
    frequency = float(max(axis.natural_frequency_rad_s for axis in problem.axes.values()))
    try:
        wanted = channels(problem)
    except TooSlowError:
        return None
    for name, channel in wanted.items():
        if channel not in known:  # identical axes are proven once
            known[channel] = prove_channel(channel, frequency, max_degree, max_rays)
        proof = known[channel]
        if proof is None:
            return None
        proofs[name] = proof
    return assemble(problem, proofs)


def without_delay(problem: Problem) -> list[str]:
    """The axes that have none."""
    return [name for name, axis in problem.axes.items() if axis.response.delay_s == NO_DELAY]


def certify_for_a_link(
    problem: Problem, largest_s: Mapping[str, Decimal], max_rays: int
) -> tuple[dict[str, Json], Decimal] | None:
    """The certificate of the problem with a delay on the axes that have none, and its upper end in s.

    `delay_s: 0` is what the paper assumes, and a certificate of it covers no link, since every one has a delay. One
    from next to nothing up to nearly the largest does; `covers` accepts it for the config without, and flight watches
    its upper end.

    Parameters
    ----------
    problem
        What is configured.
    largest_s
        The largest certified delay in s of each axis without one; an axis that bears none is not there.
    max_rays
        As for `certify`.

    Returns
    -------
    tuple or None
        Verified; None if no delay of a tenth of a millisecond or more is certified.
    """
    axes = without_delay(problem)
    if not axes or not set(axes) <= set(largest_s):
        return None
    for share in _SHARES:
        upper = (share * min(largest_s[name] for name in axes)).quantize(_SHORTEST_S, ROUND_FLOOR)
        if upper < _SHORTEST_S:
            return None
        try:
            certificate = certify(_delayed(problem, axes, Interval(SHORTEST_DELAY_S, upper)), max_rays=max_rays)
        except ValueError:  # a response that is not certified with a delay
            return None
        if certificate is not None and verify(certificate).ok:
            return certificate, upper
    return None


def _delayed(problem: Problem, names: list[str], delay_s: Interval) -> Problem:
    axes = dict(problem.axes)
    for name in names:
        axes[name] = replace(axes[name], response=replace(axes[name].response, delay_s=delay_s))
    return replace(problem, axes=axes)


def assemble(problem: Problem, proofs: Mapping[str, AnyProof]) -> dict[str, Json]:
    """Certificate from proofs already at hand, one per channel of the problem."""
    stated = statement(problem)
    certificate: dict[str, Json] = {
        "schema": SCHEMA,
        "problem": stated,
        "problem_sha256": digest(stated),
        "proofs": {name: _proof_json(proof) for name, proof in proofs.items()},
        "assumptions": list(assumptions(problem)),
        "tools": {"python": platform.python_version()}
        | {name: metadata.version(name) for name in ("numpy", "clarabel")},
    }
    return certificate | {"sha256": digest(certificate)}


def _dyadic(value: float, bits: int) -> Fraction:
    return Fraction(round(math.ldexp(float(value), bits)), 1 << bits)


def _proof_json(proof: AnyProof) -> dict[str, Json]:
    if isinstance(proof, SectorProof):
        return sector_proof_json(proof)
    return {
        "degree": proof.degree,
        "time_scale": str(proof.time_scale),
        "coordinates": [[str(entry) for entry in row] for row in proof.coordinates],
        "lyapunov": [str(entry) for entry in proof.lyapunov],
        "multipliers": [[str(entry) for entry in row] for row in proof.multipliers],
    }
