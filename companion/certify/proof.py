"""Exact verification of a certificate, with the standard library alone.

From the numbers as written in the config this rebuilds every closed-loop vertex in rationals, and checks each proof of
the file by its kind: a polynomial (`polynomial.polynomial_proof`), or a piecewise quadratic function on sectors
(`piecewise.sector_proof`). No floating point is involved.
"""

import json
import os
import stat
from collections.abc import Mapping
from fractions import Fraction
from pathlib import Path
from typing import NamedTuple

from companion.attitude_response.realisation import Matrix
from companion.attitude_response.transfer_function import TransferFunction
from companion.certify.assumptions import assumptions
from companion.certify.closed_loop import axis_channel, joint_channel
from companion.certify.piecewise.sector_proof import KEYS as SECTOR_KEYS
from companion.certify.piecewise.sector_proof import check_sectors, sector_proof_of
from companion.certify.piecewise.sectors import Channel, delayed, whole
from companion.certify.polynomial.polynomial_proof import check, proof_of
from companion.certify.problem import Problem
from companion.certify.sampling.held import grows
from companion.certify.sampling.sampled import largest_adaptation_rate
from companion.certify.statement import covers, digest, problem_of

SCHEMA = 2  # 1 took the loop as continuous in time
MAX_FILE_BYTES = 4_000_000
JOINT = "joint"

KEYS = {"schema", "problem", "problem_sha256", "proofs", "assumptions", "tools", "sha256"}


class Verdict(NamedTuple):
    """Whether a certificate holds, and why in one line."""

    ok: bool
    reason: str


def load(path: Path | str) -> tuple[dict[str, object], str]:
    """Read a certificate file.

    Returns
    -------
    certificate, reason
        The JSON object and an empty text, or an empty object and one line that says why there is none.
    """
    try:
        # O_NONBLOCK: opening a pipe would wait for a writer. O_CLOEXEC is Python's own.
        with os.fdopen(os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0)), "rb") as file:
            if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
                return {}, f"certificate {path} is not a regular file"
            text = file.read(MAX_FILE_BYTES + 1)
        if len(text) > MAX_FILE_BYTES:
            return {}, f"certificate {path} is larger than {MAX_FILE_BYTES} bytes"
        content = json.loads(text.decode("utf-8"), object_pairs_hook=_unique_keys)
    except OSError as error:
        return {}, f"cannot read certificate {path}: {error.strerror or error}"
    except (ValueError, RecursionError) as error:
        return {}, f"certificate {path} is not JSON: {error}".splitlines()[0]
    if not isinstance(content, dict):
        return {}, f"certificate {path} is not a JSON object"
    return content, ""


def verify(certificate: Mapping[str, object], problem: Mapping[str, object] | None = None) -> Verdict:
    """Verify a certificate, and that it speaks of this very problem, or of it with a delay where it has none.

    Parameters
    ----------
    certificate
        As loaded from `certificate.json`.
    problem
        The statement of the problem at hand (`companion.certify.statement.statement`); None accepts any.

    Returns
    -------
    Verdict
        Malformed input is refused with a reason, it never raises.
    """
    try:
        return _verify(certificate, problem)
    except (ValueError, TypeError, ArithmeticError, LookupError, AttributeError, RecursionError) as error:
        return Verdict(False, f"certificate is malformed: {str(error).splitlines()[0] if str(error) else error!r}")


def _verify(certificate: Mapping[str, object], problem: Mapping[str, object] | None) -> Verdict:
    if not isinstance(certificate, Mapping) or set(certificate) != KEYS:
        return Verdict(False, "certificate is malformed: not the keys of a certificate")
    if certificate["schema"] != SCHEMA or isinstance(certificate["schema"], bool):
        return Verdict(
            False, f"certificate schema {certificate['schema']} is not {SCHEMA}: run `companion check` again"
        )
    if certificate["sha256"] != digest({key: value for key, value in certificate.items() if key != "sha256"}):
        return Verdict(False, "certificate was changed: its digest does not match")
    if certificate["problem_sha256"] != digest(certificate["problem"]):
        return Verdict(False, "certificate was changed: the digest of its problem does not match")
    if problem is not None and not covers(certificate["problem"], problem):
        return Verdict(False, "certificate is of another config")

    stated = problem_of(certificate["problem"])
    if digest(certificate["assumptions"]) != digest(assumptions(stated)):
        return Verdict(False, "certificate lists other assumptions than its problem makes")
    for name, sampling in stated.sampling.items():
        limit = largest_adaptation_rate(stated.axes[name], sampling)
        if not float(sampling.adaptation_rate) < limit:
            return Verdict(False, f"adaptation rate {sampling.adaptation_rate} of axis {name} is not below {limit:.4g}")
    for name, sampling in stated.sampling.items():
        if grows(stated.axes[name], sampling):
            return Verdict(False, f"axis {name} grows when it is held over a tick at {sampling.tick_rate_hz} Hz")
    proofs = certificate["proofs"]
    wanted = channels(stated)
    if not isinstance(proofs, Mapping) or set(proofs) != set(wanted):
        return Verdict(False, f"certificate must prove exactly: {', '.join(wanted)}")
    known: dict[tuple[Channel, str], str] = {}
    for name, channel in wanted.items():
        key = (channel, digest(proofs[name]))
        if key not in known:  # identical axes are checked once
            known[key], failure = _checked(proofs[name], channel)
            if failure:
                return Verdict(False, f"proof of {name} fails: {failure}")
    told = [f"{name} by {known[channel, digest(proofs[name])]}" for name, channel in wanted.items()]
    return Verdict(True, "verified exactly: " + ", ".join(told))


def _checked(stated: object, channel: Channel) -> tuple[str, str]:
    """What a proof is by, and why it fails; empty if it holds."""
    if isinstance(stated, Mapping) and set(stated) == SECTOR_KEYS:
        by_sectors = sector_proof_of(stated, channel)
        return described(len(by_sectors.rays), channel), check_sectors(by_sectors, channel)
    proof = proof_of(stated)
    if delayed(channel):
        return "", "it takes the delay as an approximant, which is no delay: run `companion check` again"
    if channel.held:
        return "", "it takes the loop as continuous, without its tick: run `companion check` again"
    return f"degree {proof.degree}", check(proof, channel_vertices(channel))


def described(rays: int, channel: Channel) -> str:
    """A proof by sectors in words."""
    by = f"{rays} sectors" if rays else "a quadratic function"
    if channel.held:
        by += f", for ticks of at most {float(1000 * channel.tick_s):g} ms"
    if not delayed(channel):
        return by
    return f"{by}{' and' if channel.held else ' for'} every constant delay of {_milliseconds(channel.delays_s)} ms"


def _milliseconds(ends: tuple[Fraction, ...]) -> str:
    return " to ".join(f"{float(1000 * end):g}" for end in ends)


def channels(problem: Problem) -> dict[str, Channel]:
    """Everything that needs a proof of its own: each axis, or both as "joint" if the yaw is free.

    An axis is held over its slowest tick where the problem states one; both together are not.

    Raises
    ------
    TooSlowError
        If nothing can be said of a loop that is held for so long.
    """
    if problem.yaw_free:
        x, y = problem.axes.values()
        return {JOINT: joint_channel(x, y)}
    return {name: axis_channel(axis, longest_tick_s(problem, name)) for name, axis in problem.axes.items()}


def longest_tick_s(problem: Problem, axis: str) -> Fraction:
    """The longest tick of an axis in s; zero where the problem states none, or where it is not proven.

    It is not for a turning yaw, and not for a transfer function of first order, whose slope is not affine in it.
    """
    sampling, dynamics = problem.sampling.get(axis), problem.axes[axis].response.dynamics
    bent = isinstance(dynamics, TransferFunction) and len(dynamics.denominator) == 2
    return Fraction(0) if sampling is None or problem.yaw_free or bent else 1 / Fraction(sampling.tick_rate_hz)


def channel_vertices(channel: Channel) -> list[Matrix]:
    """Closed-loop matrices of a channel without a delay, none twice."""
    return list(dict.fromkeys(whole(loop) for corner in channel.corners for loop in corner))


def _unique_keys(pairs: list[tuple[str, object]]) -> dict[str, object]:
    result = dict(pairs)
    if len(result) != len(pairs):
        raise ValueError("a key stands twice")
    return result
