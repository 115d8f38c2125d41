"""A tube by search: a candidate, improved while it pays, then rounded to rationals and checked exactly."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Final

import numpy as np

from companion.certify.piecewise.inequalities import Floats
from companion.certify.piecewise.sectors import Channel
from companion.certify.tube.tube_forms import DECAY_1_S, Plan, natural_scale, plan
from companion.certify.tube.tube_proof import TubeProof, check_tube
from companion.certify.tube.tube_solver import Candidate, solve

_RATES_1_S: Final = (0.4, 0.15, 0.05, 0.015)  # to begin with, all alike
_ROUNDS: Final = 5
_TRUST: Final = 0.35
_MOST_TRUST: Final = 0.8
_ENOUGH: Final = 0.99  # a round that gains less is the last
_LEAST_RATE: Final = 1e-4
_GIVE: Final = (1.001, 1.01)  # of T and of the squared gain: room to round in
_ROUNDING_BITS: Final = (24, 34, 44)


def search(
    channel: Channel, count: int, frequency_rad_s: float, *, state: int = 0, start: Floats | None = None
) -> tuple[TubeProof, Floats] | None:
    """An exactly checked bound and its rates, or None.

    Parameters
    ----------
    channel
        Of `companion.certify.tube.loop`.
    count
        Rays: even.
    frequency_rad_s
        Natural frequency of the reference model: it sets the scale of time.
    state
        Which state is bounded: the first or the last.
    start
        Rates to begin with: those of a neighbour.
    """
    wanted = plan(channel, count, natural_scale(channel, frequency_rad_s), state)
    best = _begun(wanted, start)
    if best is None:
        return None
    best = _improved(wanted, best)
    for give in _GIVE:
        for bits in _ROUNDING_BITS:
            proof = _rounded(wanted, best, give, bits, state)
            if not check_tube(proof, channel):
                return proof, best.rates
    return None


def _begun(wanted: Plan, start: Floats | None) -> Candidate | None:
    time_s = float(wanted.scale.time_s)
    if start is not None and len(start) == wanted.groups:
        found = solve(wanted, start)
        if found is not None:
            return found
    best: Candidate | None = None
    for rate in _RATES_1_S:
        found = solve(wanted, np.full(wanted.groups, rate * time_s))
        if found is not None and (best is None or found.squared_gain < best.squared_gain):
            best = found
        elif best is not None:
            break
    return best


def _improved(wanted: Plan, best: Candidate) -> Candidate:
    most, trust = DECAY_1_S * float(wanted.scale.time_s), _TRUST
    for _ in range(_ROUNDS):
        moved = solve(wanted, best.rates, best, trust)
        found = None
        if moved is not None:
            found = solve(wanted, np.clip(moved.rates, _LEAST_RATE, most))
        if found is None or found.squared_gain >= best.squared_gain:
            trust /= 3.0
            if trust < 0.1 * _TRUST:
                break
            continue
        paid, best = found.squared_gain < _ENOUGH * best.squared_gain, found
        if not paid:
            break
        trust = min(1.5 * trust, _MOST_TRUST)
    return best


def _rounded(wanted: Plan, found: Candidate, give: float, bits: int, state: int) -> TubeProof:
    """In rationals, T and the squared gain scaled up alike: what does not scale is given room."""
    room = float(give)
    values = [_dyadic(room * value, bits) for value in found.unknowns]
    entries = wanted.entries
    signs = [max(_dyadic(room * value, bits), Fraction(0)) for value in found.signs]
    squared = _dyadic(found.squared_gain * room, bits)
    return TubeProof(
        wanted.rays,
        wanted.scale,
        tuple(values[:entries]),
        tuple(max(value, Fraction(0)) for value in values[entries:]),
        tuple(max(_dyadic(rate, bits), Fraction(0)) for rate in found.rates),
        squared,
        state,
        tuple(signs),
    )


def _dyadic(value: float, bits: int) -> Fraction:
    return Fraction(round(math.ldexp(float(value), bits)), 1 << bits)
