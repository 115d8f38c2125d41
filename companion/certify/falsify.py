"""Search for a counterexample: weights that switch periodically inside their bounds and make the closed loop (24) grow.

The extremal switching of a linear system follows a maximum principle: at each instant the vertex is the one that
maximises `l(t)^T A_i x(t)`, x the state and l the costate. On a grid of times in a period this is a fixed point: take
the dominant right and left eigenvectors of the monodromy matrix, choose the best vertex at each step, repeat. All
periods and starting patterns run as one batch; the durations of the best pattern are then refined. No randomness: the
same problem gives the same answer."""

import math
from collections.abc import Callable, Sequence
from decimal import Decimal
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from companion.certify.closed_loop import switching_vertices, weight_corners
from companion.certify.polynomial.lyapunov import Floats
from companion.certify.problem import AxisProblem

STEPS = 48  # of the time grid in a period
PERIODS = 16
ITERATIONS = 12
GROWTH_FLOOR = 1e-6  # spectral radius above 1 + this counts as unstable; rounding is some 1e-12


class Counterexample(NamedTuple):
    """A periodic switching of the weights and what it does.

    Attributes
    ----------
    weights
        (position, velocity) weight in rad/m and rad s/m, for each phase of the period.
    durations_s
        Length of each phase in s.
    spectral_radius
        Of the monodromy matrix: the factor from period to period.
    response_corner
        Index of the corner of the attitude response, 0 for plain values.
    """

    weights: tuple[tuple[float, float], ...]
    durations_s: tuple[float, ...]
    spectral_radius: float
    response_corner: int


class _Pattern(NamedTuple):
    vertices: tuple[int, ...]
    durations: Floats
    growth: float  # log of the spectral radius a second


def worst_switching(problem: AxisProblem, start: Counterexample | None = None) -> Counterexample:
    """The periodic switching between corners of the weight bounds with the fastest growth that the search finds.

    Parameters
    ----------
    problem
        Axis to attack.
    start
        Known switching of a similar problem: its durations are refined instead of a search from nothing.
    """
    bounds = [(float(p), float(v)) for p, v in weight_corners(problem)]
    best: tuple[_Pattern, int] | None = None
    for corner, exact in enumerate(switching_vertices(problem)):
        vertices = np.array(exact, dtype=float)
        if start is None:
            pattern = _search(vertices, 2 * math.pi / float(problem.natural_frequency_rad_s))
        elif start.response_corner == corner:
            order = tuple(min(range(len(bounds)), key=lambda k: math.dist(bounds[k], w)) for w in start.weights)
            pattern = _refine(vertices, order, np.array(start.durations_s))
        else:
            continue
        if best is None or pattern.growth > best[0].growth:
            best = pattern, corner
    assert best is not None  # there is at least one corner
    (order, durations, growth), corner = best
    return Counterexample(
        tuple(bounds[k] for k in order),
        tuple(float(d) for d in durations),
        math.exp(growth * float(durations.sum())),
        corner,
    )


def unstable_bandwidth(
    at_bandwidth: Callable[[Decimal], AxisProblem], upper: float, tolerance: float = 2e-4
) -> tuple[Decimal, Counterexample] | None:
    """The largest bandwidth found at which some switching is unstable, and that switching.

    Parameters
    ----------
    at_bandwidth
        The problem with its bandwidth replaced, in rad/s.
    upper
        Bandwidth in rad/s to search below, best a certified one.
    tolerance
        Relative resolution.

    Returns
    -------
    bandwidth, counterexample or None
        None if no counterexample turns up down to a hundredth of `upper`.
    """
    low, worst = upper, worst_switching(at_bandwidth(_rounded(upper)))
    if worst.spectral_radius > 1 + GROWTH_FLOOR:
        return _rounded(upper), worst
    while worst.spectral_radius <= 1 + GROWTH_FLOOR:
        if low < upper / 100:
            return None
        low *= 0.85
        worst = worst_switching(at_bandwidth(_rounded(low)))
    found, high = (_rounded(low), worst), min(low / 0.85, upper)
    while True:
        while high - low > tolerance * low:  # follow the known pattern up
            middle = (low + high) / 2
            worst = worst_switching(at_bandwidth(_rounded(middle)), start=found[1])
            if worst.spectral_radius > 1 + GROWTH_FLOOR:
                low, found = middle, (_rounded(middle), worst)
            else:
                high = middle
        worst = worst_switching(at_bandwidth(_rounded(high)))  # another pattern may reach further
        if worst.spectral_radius <= 1 + GROWTH_FLOOR or high >= upper:
            return found
        low, high, found = high, upper, (_rounded(high), worst)


def simulate(problem: AxisProblem, switching: Counterexample, periods: int, steps: int = 40) -> tuple[Floats, Floats]:
    """Fly the switching from the eigenvector it amplifies most.

    Parameters
    ----------
    problem
        Axis it was found for.
    switching
        Counterexample to fly.
    periods
        Number of periods.
    steps
        Samples a phase.

    Returns
    -------
    time_s : (k,) array
    state : (k, n) array
        Position m, velocity m/s, then the states of the attitude response; a start of unit norm.
    """
    vertices = np.array(switching_vertices(problem)[switching.response_corner], dtype=float)
    bounds = [(float(p), float(v)) for p, v in weight_corners(problem)]
    order = [bounds.index(w) for w in switching.weights]
    transitions = exponentials(vertices[order], np.array(switching.durations_s) / steps)
    monodromy = np.eye(vertices.shape[1])
    for transition in transitions:
        monodromy = np.linalg.matrix_power(transition, steps) @ monodromy
    values, vectors = np.linalg.eig(monodromy)
    state = np.real(vectors[:, np.argmax(np.abs(values))])
    states, times = [state / np.linalg.norm(state)], [0.0]
    for _ in range(periods):
        for transition, duration in zip(transitions, switching.durations_s, strict=True):
            for _ in range(steps):
                states.append(transition @ states[-1])
                times.append(times[-1] + duration / steps)
    return np.array(times), np.array(states)


def _search(vertices: Floats, reference_period: float) -> _Pattern:
    """Best pattern from a batch of periods around that of the reference model and of starting patterns, refined."""
    m, n = len(vertices), vertices.shape[1]
    periods = np.geomspace(0.15, 3.0, PERIODS) * reference_period
    pairs = [(i, j) for i in range(m) for j in range(i)] or [(0, 0)]
    half = np.arange(STEPS) < STEPS // 2
    choice = np.array([np.where(half, i, j) for _ in periods for i, j in pairs])
    steps = exponentials(np.repeat(vertices[None], PERIODS, 0), np.repeat(periods[:, None], m, 1) / STEPS)
    steps = np.repeat(steps, len(pairs), axis=0)
    lengths = np.repeat(periods, len(pairs))
    batch = np.arange(len(lengths))

    best: list[tuple[float, NDArray[np.intp], float]] = []
    for _ in range(ITERATIONS):
        taken = [steps[batch, choice[:, k]] for k in range(STEPS)]
        before = [np.broadcast_to(np.eye(n), (len(batch), n, n))]
        for matrix in taken:
            before.append(matrix @ before[-1])
        values, right = np.linalg.eig(before[-1])
        dominant = np.argmax(np.abs(values), axis=1)
        growth = np.log(np.maximum(np.abs(values[batch, dominant]), 1e-300)) / lengths
        for k in np.argsort(-growth, kind="stable")[:3]:
            best.append((float(growth[k]), choice[k].copy(), float(lengths[k])))
        # d|mu| = Re(conj(mu) / |mu| l^H dPhi x / l^H x): the left eigenvectors are the rows of the inverse
        x = right[batch, :, dominant]
        inverse = np.linalg.pinv(right)
        left = inverse[batch, dominant, :]
        phase = np.conj(values[batch, dominant]) / np.maximum(np.abs(values[batch, dominant]), 1e-300)
        costate = left * phase[:, None]
        updated = np.empty_like(choice)
        for k in range(STEPS - 1, -1, -1):
            state = np.einsum("bij,bj->bi", before[k], x)
            updated[:, k] = np.argmax(np.real(np.einsum("bi,bmij,bj->bm", costate, steps, state)), axis=1)
            costate = np.einsum("bi,bij->bj", costate, taken[k])
        if np.array_equal(updated, choice):
            break
        choice = updated
    best.sort(key=lambda entry: -entry[0])
    patterns = [_refine(vertices, *_phases(grid, length / STEPS)) for grid, length in _different(best)]
    return max(patterns, key=lambda pattern: (round(pattern.growth, 6), -len(pattern.vertices)))


def _different(
    best: list[tuple[float, NDArray[np.intp], float]], count: int = 3
) -> list[tuple[NDArray[np.intp], float]]:
    """The first patterns of the sorted list that differ in growth."""
    chosen: list[tuple[float, NDArray[np.intp], float]] = []
    for entry in best:
        if all(abs(entry[0] - other[0]) > 1e-9 for other in chosen):
            chosen.append(entry)
    return [(grid, length) for _, grid, length in chosen[:count]]


def _phases(grid: NDArray[np.intp], step: float) -> tuple[tuple[int, ...], Floats]:
    """Runs of the same vertex on the cyclic grid, and their durations."""
    changes = [k for k in range(len(grid)) if grid[k] != grid[k - 1]]
    if not changes:
        return (int(grid[0]),), np.array([len(grid) * step])
    lengths = [(after - k - 1) % len(grid) + 1 for k, after in zip(changes, changes[1:] + changes[:1], strict=True)]
    return tuple(int(grid[k]) for k in changes), np.array(lengths) * step


def _refine(vertices: Floats, order: Sequence[int], durations: Floats) -> _Pattern:
    """Maximise the growth rate over the durations of the phases."""
    matrices = vertices[list(order)]

    def decay(logarithms: Floats) -> tuple[float, Floats]:
        clipped = np.clip(logarithms, -20, 5)
        lengths = np.exp(clipped)
        total = float(lengths.sum())
        grown, slopes = _log_radius(matrices, lengths)
        return -grown / total, np.where(clipped == logarithms, lengths * (grown / total - slopes) / total, 0.0)

    start = np.log(durations)
    growth = -decay(start)[0]
    if len(order) == 1:
        return _Pattern(tuple(order), durations, growth)
    found = minimize(decay, start, jac=True, method="BFGS", options={"gtol": 1e-7})
    if not -found.fun > growth:
        return _Pattern(tuple(order), durations, growth)
    return _Pattern(tuple(order), np.exp(np.clip(found.x, -20, 5)), -float(found.fun))


def _log_radius(matrices: Floats, durations: Floats) -> tuple[float, Floats]:
    """Logarithm of the monodromy's spectral radius and its derivative by each duration, shape (k,).

    With right and left eigenvectors x and l of the dominant eigenvalue mu, ``dmu = l^H dPhi x / l^H x``, and a phase
    that lasts longer by dt puts ``A dt`` behind its exponential.
    """
    transitions = exponentials(matrices, durations)
    n = matrices.shape[1]
    reached = np.empty((len(matrices) + 1, n, n))
    reached[0] = np.eye(n)
    for k, transition in enumerate(transitions):
        reached[k + 1] = transition @ reached[k]
    values, right = np.linalg.eig(reached[-1])
    dominant = int(np.argmax(np.abs(values)))
    mu, x = values[dominant], right[:, dominant]
    size = max(abs(complex(mu)), 1e-300)
    phase = np.conj(mu) / size
    left = np.linalg.pinv(right)[dominant]  # its product with x is one
    slopes = np.empty(len(matrices))
    for k in range(len(matrices) - 1, -1, -1):
        slopes[k] = np.real(left @ matrices[k] @ (reached[k + 1] @ x) * phase) / size
        left = left @ transitions[k]
    return math.log(size), slopes


def exponentials(matrices: Floats, durations: Floats) -> Floats:
    """exp(matrix * duration) of a stack, by a Taylor series and squaring.

    A stack of tiny matrices: plain products are many times faster than a library routine that starts threads for each.
    """
    scaled = matrices * durations[..., None, None]
    squarings = max(0, math.ceil(math.log2(max(float(np.abs(scaled).sum(axis=-1).max()), 1e-300))) + 1)
    scaled = scaled / 2.0**squarings
    identity = np.eye(scaled.shape[-1])
    result = np.broadcast_to(identity, scaled.shape)
    for k in range(14, 0, -1):  # the norm is at most 1/2: the next term is below 1e-16
        result = identity + scaled @ result / k
    for _ in range(squarings):
        result = result @ result
    return np.asarray(result, dtype=np.float64)


def _rounded(bandwidth: float) -> Decimal:
    return Decimal(f"{bandwidth:.4f}")
