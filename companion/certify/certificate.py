"""From a problem to a certificate: solve, round to rationals, verify exactly. The solver's status is never asked."""

import math
import platform
from collections.abc import Mapping, Sequence
from fractions import Fraction
from importlib import metadata

import numpy as np

from companion.attitude_response.realisation import Matrix
from companion.certify.assumptions import assumptions
from companion.certify.lyapunov import Candidate, Floats, coordinates, rescale, solve
from companion.certify.problem import Problem
from companion.certify.proof import SCHEMA, Proof, channels, check
from companion.certify.statement import Json, digest, statement

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


def prove_lowest(vertices: Sequence[Matrix], max_degree: int) -> Proof | None:
    """The proof of lowest degree up to `max_degree`; a degree is tried only if the lower ones fail."""
    scaling = Scaling(vertices)
    for degree in range(2, max_degree + 1, 2):
        proof = prove(vertices, degree, scaling)
        if proof is not None:
            return proof
    return None


def certify(problem: Problem, max_degree: int = 8) -> dict[str, Json] | None:
    """The certificate of a problem as a JSON object, or None if no polynomial up to `max_degree` proves it."""
    proofs: dict[str, Proof] = {}
    known: dict[tuple[Matrix, ...], Proof | None] = {}
    for name, vertices in channels(problem).items():
        key = tuple(vertices)
        if key not in known:  # identical axes are proven once
            known[key] = prove_lowest(vertices, max_degree)
        proof = known[key]
        if proof is None:
            return None
        proofs[name] = proof
    return assemble(problem, proofs)


def assemble(problem: Problem, proofs: Mapping[str, Proof]) -> dict[str, Json]:
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


def _proof_json(proof: Proof) -> dict[str, Json]:
    return {
        "degree": proof.degree,
        "time_scale": str(proof.time_scale),
        "coordinates": [[str(entry) for entry in row] for row in proof.coordinates],
        "lyapunov": [str(entry) for entry in proof.lyapunov],
        "multipliers": [[str(entry) for entry in row] for row in proof.multipliers],
    }
