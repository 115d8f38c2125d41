"""A proof by sectors as it stands in a certificate, and its exact check. Standard library only."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from fractions import Fraction
from itertools import chain
from typing import Final, NamedTuple

from companion.attitude_response.realisation import ZERO, Row
from companion.certify.exact.elimination import positive_definite
from companion.certify.exact.rational import list_of, rational, rationals
from companion.certify.piecewise.sectors import (
    ORDER,
    Channel,
    Inequality,
    Scale,
    Sector,
    delayed,
    falls,
    multipliers,
    pattern,
    positive,
    sectors,
)
from companion.certify.statement import Json

MAX_RAYS: Final = 64
DELAY: Final = "bessel_legendre_2"
TICK: Final = "wirtinger"
KEYS: Final = {
    "rays", "delay", "tick", "time_scale", "state_scale", "lyapunov", "krasovskii", "hold", "sign_multipliers",
}  # fmt: skip


class SectorProof(NamedTuple):
    """A piecewise quadratic Lyapunov functional, in exact rationals; `sectors` says of what.

    Attributes
    ----------
    rays
        K rays (position, velocity) in scaled units, counterclockwise; none for one quadratic function.
    scale
        Units.
    lyapunov
        Entries of T in the order of `pattern`.
    krasovskii
        S and R of each channel in turn; none without a delay.
    hold
        The multiplier of each error of a hold; none without one.
    sign_multipliers
        u of each inequality, those of `falls` and then those of `positive`; none without rays.
    """

    rays: tuple[tuple[Fraction, Fraction], ...]
    scale: Scale
    lyapunov: tuple[Fraction, ...]
    krasovskii: tuple[Fraction, ...]
    hold: tuple[Fraction, ...]
    sign_multipliers: tuple[Fraction, ...]


def check_sectors(proof: SectorProof, channel: Channel) -> str:
    """Check one proof exactly.

    Returns
    -------
    str
        Empty if it holds, else one line that says what fails.
    """
    loop = channel.corners[0][0]
    states = len(loop.a) + len(loop.bounds)
    if len(proof.rays) > MAX_RAYS or len(proof.rays) == 1:
        return f"{len(proof.rays)} rays are not supported"
    if proof.rays and len(channel.corners[0]) != 4:
        return "sectors are for one axis"
    if proof.scale.time_s <= 0 or len(proof.scale.states) != states or min(proof.scale.states) <= 0:
        return "the scale does not fit"
    weights = (*proof.krasovskii, *proof.hold)
    if (len(proof.krasovskii), len(proof.hold)) != multipliers(channel) or min(weights, default=ZERO) < 0:
        return "the multipliers of delay and hold do not fit"
    if min(proof.sign_multipliers, default=ZERO) < 0:
        return "a sign multiplier is negative"
    try:
        cut = sectors(channel, proof.rays)
    except ValueError as error:
        return str(error)
    places = pattern(cut)
    if len(proof.lyapunov) != len(places):
        return "Lyapunov matrix has the wrong size"
    matrices = [matrix_of(proof.lyapunov, places, sector) for sector in cut]
    wanted = [*falls(channel, cut, proof.scale), *positive(channel, cut, proof.scale)]
    signs: Sequence[Fraction] = proof.sign_multipliers if proof.rays else [ZERO] * len(wanted)
    if len(signs) != len(wanted) or (proof.sign_multipliers and not proof.rays):
        return "sign multipliers do not match the inequalities"
    for number, (inequality, sign) in enumerate(zip(wanted, signs, strict=True)):
        if not positive_definite(integers_of(form_of(inequality, matrices[inequality.sector], weights, sign))):
            what = "fall" if inequality.rate else "stay positive"
            return f"the Lyapunov function does not {what} in sector {inequality.sector}, inequality {number}"
    return ""


def sector_proof_json(proof: SectorProof) -> dict[str, Json]:
    """As it stands in a certificate."""
    return {
        "rays": [[str(p), str(v)] for p, v in proof.rays],
        "delay": DELAY if proof.krasovskii else "none",
        "tick": TICK if proof.hold else "none",
        "time_scale": str(proof.scale.time_s),
        "state_scale": [str(entry) for entry in proof.scale.states],
        "lyapunov": [str(entry) for entry in proof.lyapunov],
        "krasovskii": [str(entry) for entry in proof.krasovskii],
        "hold": [str(entry) for entry in proof.hold],
        "sign_multipliers": [str(entry) for entry in proof.sign_multipliers],
    }


def sector_proof_of(stated: Mapping[str, object], channel: Channel) -> SectorProof:
    """The inverse of `sector_proof_json`. Raises `ValueError` for what is malformed."""
    if stated["delay"] != (DELAY if delayed(channel) else "none"):
        raise ValueError(f"a proof takes the delay as {stated['delay']}")
    if stated["tick"] != (TICK if channel.held else "none"):
        raise ValueError(f"a proof takes the tick as {stated['tick']}")
    if ORDER != 2:
        raise AssertionError("the name of the delay's inequality says its order")
    rays = [rationals(ray) for ray in list_of(stated["rays"])]
    if any(len(ray) != 2 for ray in rays):
        raise ValueError("a ray is not a pair")
    return SectorProof(
        tuple((ray[0], ray[1]) for ray in rays),
        Scale(rational(stated["time_scale"]), rationals(stated["state_scale"])),
        rationals(stated["lyapunov"]),
        rationals(stated["krasovskii"]),
        rationals(stated["hold"]),
        rationals(stated["sign_multipliers"]),
    )


def matrix_of(
    entries: Sequence[Fraction], places: Mapping[tuple[int, int], int], sector: Sector
) -> list[list[Fraction]]:
    """P, the entries of T of a sector."""
    pairs = list(zip(sector.places, sector.signs, strict=True))
    return [[s * t * entries[places[min(i, j), max(i, j)]] for j, t in pairs] for i, s in pairs]


def form_of(
    inequality: Inequality, p: list[list[Fraction]], weights: Sequence[Fraction], sign: Fraction
) -> list[list[Fraction]]:
    """Lower triangle of what must be positive definite."""
    if inequality.rate:
        width = len(inequality.rate[0])
        through = [combined(row, inequality.rate) for row in p]  # P H
        product = [combined([row[i] for row in inequality.state], through) for i in range(width)]  # G' P H
        form = [[-(product[i][j] + product[j][i]) for j in range(i + 1)] for i in range(width)]
    else:
        form = [list(row[: i + 1]) for i, row in enumerate(p)]
    for multiplier, square in zip(weights, inequality.squares, strict=True):
        for factor, row in square.terms:
            weighted = multiplier * factor
            filled = [(i, entry) for i, entry in enumerate(row) if entry]
            for i, left in filled:
                for j, right in filled:
                    if j <= i:
                        form[i][j] -= weighted * left * right
    form[1][0] -= sign
    return form


def combined(factors: Sequence[Fraction], rows: Sequence[Row | list[Fraction]]) -> list[Fraction]:
    """Sum of factor times row."""
    result = [ZERO] * len(rows[0])
    for factor, row in zip(factors, rows, strict=True):
        if factor:
            for j, entry in enumerate(row):
                if entry:
                    result[j] += factor * entry
    return result


def integers_of(form: list[list[Fraction]]) -> list[list[int]]:
    """The same but for a positive factor."""
    common = math.lcm(*(entry.denominator for entry in chain.from_iterable(form)))
    return [[entry.numerator * (common // entry.denominator) for entry in row] for row in form]
