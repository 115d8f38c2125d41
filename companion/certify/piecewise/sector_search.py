"""A proof by sectors, or none: which inequalities the solver is given, and how what it says becomes exact.

Most inequalities hold by themselves once a few do. The solver is given those that were tight before, and is given more
while others fail in floating point. Where the few have no solution, all have none.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from typing import Final, NamedTuple

import numpy as np

from companion.certify.piecewise.hold import UNITS
from companion.certify.piecewise.inequalities import Floats, Forms, Plan, in_floats
from companion.certify.piecewise.sector_proof import SectorProof, check_sectors
from companion.certify.piecewise.sector_solver import solve
from companion.certify.piecewise.sectors import Channel, Loop, Scale, falls, multipliers, pattern, positive, sectors

_LEAST: Final = 1e-8  # of a margin: below, rounding eats it
_ROUNDING_BITS: Final = (20, 30, 42)
_RAY_BITS: Final = 8
_FEW: Final = 40  # inequalities, which the solver is given all at once
_ADDED: Final = 32  # a round, of those that fail, shared by the sectors
_SHARE: Final = 0.05  # of the solver's margin, which the others are to have


class Active:
    """The inequalities of one kind of proof that were tight, from one search to the next."""

    def __init__(self) -> None:
        self.numbers: dict[int, set[int]] = {}  # by how many inequalities there are


def rays(count: int) -> tuple[tuple[Fraction, Fraction], ...]:
    """Rays at even angles, both axes exactly; `count` is even, or zero for none."""
    unit = 1 << _RAY_BITS
    angles = [math.pi * k / count for k in range(count)]
    return tuple((Fraction(round(math.cos(a) * unit), unit), Fraction(round(math.sin(a) * unit), unit)) for a in angles)


def natural_scale(channel: Channel, frequency_rad_s: float) -> Scale:
    """Powers of two near the time and the speeds of the reference model, for one axis or two."""
    power = Fraction(2) ** round(math.log2(frequency_rad_s))
    loop = channel.corners[0][0]
    count, axes = len(loop.a), len(loop.c)
    gain = max((float(abs(entry)) for corner in channel.corners for row in corner[0].c for entry in row), default=1.0)
    tilt = power * power / Fraction(2) ** round(math.log2(max(gain, 1e-9)))
    states = [Fraction(1)] * axes + [power] * axes + [tilt] * (count - 2 * axes)
    return Scale(1 / power, (*states, *_error_units(loop, states, tilt, power)))


def _error_units(loop: Loop, states: Sequence[Fraction], tilt: Fraction, power: Fraction) -> list[Fraction]:
    """Of each error of a hold: between its natural unit and its bound, where a multiplier of one does best."""
    units = []
    for bound, exponent in zip(loop.bounds, UNITS, strict=False):
        natural = tilt * power**exponent
        sizes = [
            float(f) * max(float(abs(x) * y) for x, y in zip(row, states, strict=False)) ** 2
            for f, row in bound.terms[1:]
        ]
        units.append(natural * Fraction(2) ** round(0.5 * math.log2(math.sqrt(sum(sizes)) / float(natural))))
    return units


def plan(channel: Channel, count: int, scale: Scale) -> Plan:
    """The inequalities with so many rays."""
    chosen = rays(count)
    cut = sectors(channel, chosen)
    near, near_cut, near_scale = in_floats(channel), in_floats(cut), in_floats(scale)
    inequalities = [*falls(near, near_cut, near_scale), *positive(near, near_cut, near_scale)]
    return Plan(channel, chosen, scale, cut, inequalities)


class Believed(NamedTuple):
    """What holds in floating point, to be proven."""

    plan: Plan
    unknowns: Floats
    signs: Floats
    margin: float

    def proven(self) -> SectorProof | None:
        """The proof, exactly checked, or None."""
        for bits in _ROUNDING_BITS:
            if self.margin >= 2.0 ** -(bits + 2):
                proof = rounded(self, bits)
                if not check_sectors(proof, self.plan.channel):
                    return proof
        return None


def believed(channel: Channel, count: int, frequency_rad_s: float, active: Active | None = None) -> Believed | None:
    """A candidate with so many rays that holds in floating point, or None.

    Parameters
    ----------
    channel
        What is to be proven.
    count
        Rays: even, or zero for one quadratic function.
    frequency_rad_s
        Natural frequency of the reference model: it sets the scale.
    active
        What was tight in a search like this one.
    """
    wanted = plan(channel, count, natural_scale(channel, frequency_rad_s))
    unknowns, signs, margin = _candidate(wanted, active or Active())
    return Believed(wanted, unknowns, signs, margin) if margin >= _LEAST else None


def prove_by_sectors(channel: Channel, count: int, frequency_rad_s: float) -> SectorProof | None:
    """An exactly checked proof with so many rays, or None."""
    found = believed(channel, count, frequency_rad_s)
    return None if found is None else found.proven()


def rounded(candidate: Believed, bits: int) -> SectorProof:
    """The candidate in rationals with `bits` binary places."""
    wanted = candidate.plan
    numbers = [_dyadic(value, bits) for value in candidate.unknowns]
    entries, (late, _) = len(pattern(wanted.cut)), multipliers(wanted.channel)
    weights = [max(number, Fraction(0)) for number in numbers[entries:]]
    turned = tuple(_dyadic(value, bits) for value in candidate.signs) if wanted.rays else ()
    return SectorProof(
        wanted.rays, wanted.scale, tuple(numbers[:entries]), tuple(weights[:late]), tuple(weights[late:]), turned
    )


def _candidate(wanted: Plan, active: Active) -> tuple[Floats, Floats, float]:
    """Unknowns, sign multipliers, and the margin in floating point of all inequalities; negative if there is none."""
    forms = Forms(wanted)
    total = len(wanted.inequalities)
    chosen = set(range(total)) if total <= _FEW else active.numbers.get(total, set())
    nothing = np.zeros(0)
    if not chosen:
        start = np.concatenate([forms.identity(), np.zeros(sum(multipliers(wanted.channel)))])
        always = {number for number, inequality in enumerate(wanted.inequalities) if not inequality.rate}
        chosen = always | _worst(wanted, forms.margins(start)[0], math.inf)
    while True:
        candidate = solve(wanted, forms, sorted(chosen))
        if candidate is None:  # too few to go by
            if len(chosen) == total:
                return nothing, nothing, -1.0
            chosen = set(range(total))
            continue
        active.numbers[total] = chosen
        if candidate.margin < _LEAST:
            return nothing, nothing, -1.0
        margins, signs = forms.margins(candidate.unknowns)
        failing = _worst(wanted, margins, _SHARE * candidate.margin) - chosen
        if not failing:
            return candidate.unknowns, signs, float(margins.min())
        chosen = chosen | failing


def _worst(wanted: Plan, margins: Floats, enough: float) -> set[int]:
    """In each sector the few inequalities of the least margin, where it is not enough."""
    each = max(2, _ADDED // len(wanted.cut))
    found: dict[int, list[int]] = {}
    for number in np.argsort(margins):
        places = found.setdefault(wanted.inequalities[number].sector, [])
        if margins[number] < enough and len(places) < each:
            places.append(int(number))
    return {number for places in found.values() for number in places}


def _dyadic(value: float, bits: int) -> Fraction:
    return Fraction(round(math.ldexp(float(value), bits)), 1 << bits)
