"""The reference model and the adaptation for an identified attitude response and an estimator, and what limits them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from decimal import ROUND_CEILING, ROUND_FLOOR, Decimal
from typing import Final, NamedTuple

from companion.attitude_response.exact import Interval
from companion.certify.bandwidth import fastest_reference, tuned_bandwidth, with_bandwidth, with_natural_frequency
from companion.certify.designing.velocity_error import SAMPLED_SHARE, Adaptation, choose, two_figures
from companion.certify.problem import AxisProblem, Problem, Sampling, nominal_weights
from companion.certify.proof import longest_tick_s
from companion.certify.sampling.sampled import largest_adaptation_rate
from companion.config.estimator import VelocityError

PLACES: Final = Decimal("0.01")  # of the natural frequency chosen, rad/s
BOUND_PLACES: Final = Decimal("0.001")
_SLOWER: Final = tuple(Decimal(share) for share in ("1", "0.95", "0.9", "0.85", "0.8", "0.7", "0.6"))
_WORTH: Final = 0.95  # a slower reference model must leave less displacement than this share of the fastest's
_NUDGE: Final = Decimal("1.2")  # by how much bandwidth and delay are improved in turn, to see which of them limits


class Design(NamedTuple):
    """What was chosen for all axes alike, so that it does not matter which way the nose points.

    Attributes
    ----------
    natural_frequency_rad_s, position_bound, velocity_bound
        Reference model, and projection bounds (lower, upper) in the template's proportion to the nominal weights.
    adaptation_rate, bias_adaptation_rate
        The bias rate is zero without a bias weight. Where nothing is known of the estimator the template's, or less
        where sampling demands it.
    adaptation
        What was chosen for the estimator; None where nothing is known of it.
    fastest_rad_s
        By axis, the fastest certified reference model with the margin.
    slowest
        The axis that decides.
    limited_by
        "attitude bandwidth" or "delay": whichever, a fifth better, would allow the faster reference model. "noise": a
        faster one is certified, but with this estimator it would fly worse.
    sampled
        Whether the adaptation rates had to come down for the tick rate, or a faster tick would allow faster ones.
    cost_of_10_ms_rad_s
        By how much the fastest certified reference model would be slower with 10 ms more of delay.
    """

    natural_frequency_rad_s: Decimal
    position_bound: tuple[Decimal, Decimal]
    velocity_bound: tuple[Decimal, Decimal]
    adaptation_rate: Decimal
    bias_adaptation_rate: Decimal
    adaptation: Adaptation | None
    fastest_rad_s: Mapping[str, Decimal]
    slowest: str
    limited_by: str
    sampled: bool
    cost_of_10_ms_rad_s: Decimal


def design(
    problem: Problem,
    margin: Decimal,
    counts: Sequence[int],
    progress: Callable[[float, str], None] = lambda _fraction, _text: None,
    error: VelocityError | None = None,
) -> Design | None:
    """Choose the reference model and, where it is known how wrong the estimator is, Q and adaptation rates.

    Parameters
    ----------
    problem
        The template's axes with the identified responses in place of its own.
    margin
        What the reference model is certified with in hand: the attitude loop slower, and its delay longer, by so much.
    counts
        Rays of the Lyapunov functions to try, none for a quadratic one.
    progress
        Told the fraction done and what is being done.
    error
        Of the estimated velocity; None where nothing is known of it.

    Returns
    -------
    Design or None
        None if no reference model near the template's is certified.
    """
    slowed = {name: slower(axis, margin) for name, axis in problem.axes.items()}
    fastest: dict[str, Decimal] = {}
    known: dict[AxisProblem, Decimal] = {}
    for index, (name, axis) in enumerate(slowed.items()):
        progress(0.8 * index / len(slowed), f"axis {name}: fastest reference model")
        if axis not in known:
            found = fastest_reference(axis, counts, longest_tick_s(problem, name))
            if found is None:
                return None
            known[axis] = found.value
        fastest[name] = known[axis]
    slowest = min(fastest, key=lambda name: fastest[name])
    frequency, adaptation = fastest[slowest].quantize(PLACES, ROUND_FLOOR), None
    limited_by = ""
    if error is not None and problem.sampling:
        certified = frequency
        frequency, adaptation = _for_estimator(slowed, problem.sampling, certified, error)
        limited_by = "noise" if frequency < certified else ""
    progress(0.8, f"axis {slowest}: what limits it")
    position, velocity = _bounds(with_natural_frequency(problem.axes[slowest], frequency))
    if adaptation is None:
        gamma, bias, sampled = rates(_as_fast(problem.axes, frequency), problem.sampling)
    else:
        gamma, bias, sampled = adaptation[1], adaptation[2], adaptation.at_sampling_limit
    return Design(
        frequency,
        position,
        velocity,
        gamma,
        bias,
        adaptation,
        fastest,
        slowest,
        limited_by or _limit(slowed[slowest]),
        sampled,
        fastest[slowest] - _with_10_ms_more(slowed[slowest], counts),
    )


def _for_estimator(
    slowed: Mapping[str, AxisProblem], sampling: Mapping[str, Sampling], fastest: Decimal, error: VelocityError
) -> tuple[Decimal, Adaptation]:
    """The reference model, up to the fastest that is certified, at which least is left; and its adaptation."""
    found = []
    for share in _SLOWER:
        frequency = (share * fastest).quantize(PLACES, ROUND_FLOOR)
        found.append((frequency, choose(_as_fast(slowed, frequency), sampling, error)))
    best = min(found, key=lambda one: one[1].displacement.rms_m)
    worth = best[1].displacement.rms_m < _WORTH * found[0][1].displacement.rms_m
    return best if worth else found[0]


def _as_fast(axes: Mapping[str, AxisProblem], frequency: Decimal) -> dict[str, AxisProblem]:
    return {name: with_natural_frequency(axis, frequency) for name, axis in axes.items()}


def slower(axis: AxisProblem, margin: Decimal) -> AxisProblem:
    """The same axis with an attitude bandwidth `1 + margin` times smaller, and a delay as many times longer."""
    slow = with_bandwidth(axis, tuned_bandwidth(axis.response) / (1 + margin))
    delay = slow.response.delay_s
    late = Interval(delay.lower * (1 + margin), delay.upper * (1 + margin))
    return replace(slow, response=replace(slow.response, delay_s=late))


def rates(axes: Mapping[str, AxisProblem], sampling: Mapping[str, Sampling]) -> tuple[Decimal, Decimal, bool]:
    """(adaptation rate, bias adaptation rate, whether they came down) that sampling allows on every axis.

    The first axis's where their strength is within `SAMPLED_SHARE` of what sampling bears on each, else both scaled
    down alike.
    """
    scale = 1.0
    first = next(iter(sampling.values()))
    for name, sampled in sampling.items():
        regressor = float(sampled.position_m) ** 2 + float(sampled.velocity_m_s) ** 2
        alone = replace(sampled, bias_adaptation_rate=Decimal(0))
        bearable = largest_adaptation_rate(axes[name], alone) * regressor  # strength, in all
        strength = float(first.adaptation_rate) * regressor + float(first.bias_adaptation_rate)
        scale = min(scale, SAMPLED_SHARE * bearable / strength if strength else 1.0)
    if scale >= 1.0:
        return first.adaptation_rate, first.bias_adaptation_rate, False
    return (
        two_figures(float(first.adaptation_rate) * scale),
        two_figures(float(first.bias_adaptation_rate) * scale),
        True,
    )


def _limit(axis: AxisProblem) -> str:
    """Which of the two, improved by the same share, would help more."""
    delay = axis.response.delay_s
    if not delay.upper:
        return "attitude bandwidth"
    shorter = Interval(delay.lower / _NUDGE, delay.upper / _NUDGE)
    with_less_delay = fastest_reference(replace(axis, response=replace(axis.response, delay_s=shorter)), (0,))
    with_more_bandwidth = fastest_reference(with_bandwidth(axis, tuned_bandwidth(axis.response) * _NUDGE), (0,))
    by_delay = 0 if with_less_delay is None else with_less_delay.value
    by_bandwidth = 0 if with_more_bandwidth is None else with_more_bandwidth.value
    return "delay" if by_delay > by_bandwidth else "attitude bandwidth"


def _with_10_ms_more(axis: AxisProblem, counts: Sequence[int]) -> Decimal:
    """The fastest reference model with that much more delay, rad/s; zero where none is certified."""
    delay, more = axis.response.delay_s, Decimal("0.01")
    late = replace(axis.response, delay_s=Interval(delay.lower + more, delay.upper + more))
    found = fastest_reference(replace(axis, response=late), counts)
    return Decimal(0) if found is None else found.value


def _bounds(axis: AxisProblem) -> list[tuple[Decimal, Decimal]]:
    """Of position and velocity, rounded inwards, so that what was certified covers them; outwards of the nominal."""
    bounds = []
    for lower, nominal, upper in zip(axis.weights_lower, nominal_weights(axis), axis.weights_upper, strict=True):
        low, high = lower.quantize(BOUND_PLACES, ROUND_CEILING), upper.quantize(BOUND_PLACES, ROUND_FLOOR)
        bounds.append(
            (
                low if low <= nominal else lower.quantize(BOUND_PLACES, ROUND_FLOOR),
                high if high >= nominal else upper.quantize(BOUND_PLACES, ROUND_CEILING),
            )
        )
    return bounds
