"""How far from its trajectory a disturbance drives an axis: proven where a proof is found, and what is not, by name."""

from __future__ import annotations

import math
from dataclasses import replace
from decimal import Decimal
from itertools import pairwise
from typing import Final, NamedTuple

from companion.attitude_response.exact import Interval
from companion.certify.piecewise.sectors import Channel, delayed
from companion.certify.problem import AxisProblem, nominal_weights
from companion.certify.tube.loop import Bias, moving_channel
from companion.certify.tube.tube_proof import TubeProof
from companion.certify.tube.tube_search import search
from companion.certify.tube.worst_case import held_growth, worst_case

RAYS: Final = (16, 8)
"""Without a delay and with one: there twice as many cost minutes."""
PROVEN: Final = "proven"
_TICK: Final = "not proven: the loop is taken as continuous"
_ESTIMATE: Final = "not counted: the tube is around where the estimate says that it is"
_LIMITS: Final = "not counted: what tilt, thrust and acceleration limits cut"


class Tube(NamedTuple):
    """Of one axis.

    Attributes
    ----------
    m_per_m_s2
        Distance for each m/s^2 of disturbance: proven, or what `proof` says.
    searched_m_per_m_s2
        The worst that a search finds with weights that switch; infinite where it grows without end.
    largest_m_s2
        The disturbance up to which the bias weight is proven to stay inside its bound; infinite without one, zero where
        it is not proven for any.
    proof
        By part of the loop, `proven` or why it is not.
    proofs
        The proofs, one a part of the response's box; none where there is none.
    """

    m_per_m_s2: float
    searched_m_per_m_s2: float
    largest_m_s2: float
    proof: dict[str, str]
    proofs: tuple[TubeProof, ...] = ()


def tube(axis: AxisProblem, bias: Bias | None, *, bound_bias: bool = True, parts: int = 1) -> Tube:
    """The tube of one axis, with its bias weight if it has one.

    `bound_bias`: whether to look for how much the bias weight takes up, too: as long again. `parts`: into how
    many each interval of the response and its delay is cut, each part with a proof of its own: tighter, and slower.
    """
    channel = moving_channel(axis, bias, hull=False)
    frequency = float(axis.natural_frequency_rad_s)
    told = {"tick": _TICK, "estimate": _ESTIMATE, "limits": _LIMITS}
    growth = held_growth(channel)
    if growth >= 0.0:
        why = f"not proven: with weights that stand in a corner of their bounds it grows by {growth:.2g} 1/s"
        held = float(worst_case(_at_nominal(axis, bias), weights=(0,)).max())
        return Tube(held, math.inf, 0.0, {"weights": f"{why}; of weights at their nominal values", **told})
    searched = float(worst_case(channel).max())
    proofs = _proven(axis, bias, parts, frequency, 0)
    if not proofs:
        why = "not proven: the worst that a search finds, which finds no more"
        return Tube(searched, searched, 0.0, {"weights": why, **told})
    largest, how = math.inf, PROVEN
    if bias is not None:
        last = len(channel.corners[0][0].a) - 1
        bounds = _proven(axis, bias, parts, frequency, last) if bound_bias else ()
        largest = float(bias.bound) / max(proof.gain for proof in bounds) if bounds else 0.0
        how = f"proven up to {largest:.3g} m/s2" if bounds else "not proven: taken to stay inside its bound"
    proven = {"weights": PROVEN, "response": PROVEN, "delay": PROVEN, "bias": how}
    return Tube(max(proof.gain for proof in proofs), searched, largest, {**proven, **told}, proofs)


def _proven(axis: AxisProblem, bias: Bias | None, parts: int, frequency: float, state: int) -> tuple[TubeProof, ...]:
    """A proof for each part of the box of the response and its delay, which are constant; none if one has none."""
    proofs: list[TubeProof] = []
    rates = None
    for part in _cut(axis, parts):
        channel = moving_channel(part, bias)
        found = search(channel, RAYS[delayed(channel)], frequency, state=state, start=rates)
        if found is None:
            return ()
        proof, rates = found
        proofs.append(proof)
    return tuple(proofs)


def _cut(axis: AxisProblem, parts: int) -> list[AxisProblem]:
    """The axis with each interval of its response, and that of its delay, in so many parts."""
    cells = [axis]
    response = axis.response
    for key in response.dynamics.key_names():
        value = getattr(response.dynamics, key)
        if not isinstance(value, Interval):
            continue
        cells = [
            replace(cell, response=replace(cell.response, dynamics=replace(cell.response.dynamics, **{key: part})))
            for cell in cells
            for part in _parts(value, parts)
        ]
    return [
        replace(cell, response=replace(cell.response, delay_s=part))
        for cell in cells
        for part in _parts(response.delay_s, parts)
    ]


def _parts(interval: Interval, parts: int) -> list[Interval]:
    lower, upper = interval
    if lower == upper:
        return [interval]
    ends = [lower + (upper - lower) * Decimal(k) / parts for k in range(parts)] + [upper]
    return [Interval(a, b) for a, b in pairwise(ends)]


def _at_nominal(axis: AxisProblem, bias: Bias | None) -> Channel:
    """The loop with its weights at their nominal values, but for rounding."""
    near, step = [Decimal(f"{float(value):.10g}") for value in nominal_weights(axis)], Decimal("1e-8")
    lower, upper = (near[0] - step, near[1] - step), (near[0] + step, near[1] + step)
    return moving_channel(replace(axis, weights_lower=lower, weights_upper=upper), bias, hull=False)
