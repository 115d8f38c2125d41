"""The worst that a search finds: weights that switch and a disturbance that is full one way or the other.

It bounds a tube from below. Of `x+ = A_i x + B_i d` in steps, with x_0 of the end to be large, Krotov's method: from
the adjoint of what was chosen before, choose anew on the way forward, by the state that is then there. The end never
gets smaller from round to round. The parameters of the response and the delay are constant, each at an end of its
interval.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from scipy.linalg import eigvals, expm

from companion.certify.piecewise.inequalities import Floats, in_floats
from companion.certify.piecewise.sectors import Channel, Loop

_STEP_S: Final = 0.01  # or a little less, so that the delay is a whole number of them
_HELD_S: Final = (0.2, 0.6)  # of the random starts


def worst_case(
    channel: Channel, duration_s: float = 30.0, rounds: int = 25, weights: tuple[int, ...] | None = None
) -> Floats:
    """The largest position found for a disturbance of 1 m/s^2, m, by corner of the response, then by end of the delay.

    Parameters
    ----------
    channel
        Of `companion.certify.tube.loop`, without a hull.
    duration_s
        Of the attack.
    rounds
        Of improvement.
    weights
        Which corners of the weights it may choose from; all by default.
    """
    chosen = weights or tuple(range(len(channel.corners[0])))
    near = in_floats(channel)
    pairs = [[_discrete(corner[i], float(delay)) for i in chosen] for corner in near.corners for delay in near.delays_s]
    size = max(a.shape[0] for pair in pairs for a, _ in pair)
    a = np.zeros((len(pairs), len(chosen), size, size))
    b = np.zeros((len(pairs), len(chosen), size))
    for k, pair in enumerate(pairs):
        for i, (matrix, inlet) in enumerate(pair):
            a[k, i, : len(matrix), : len(matrix)] = matrix
            b[k, i, : len(inlet)] = inlet
    steps, random = round(duration_s / _STEP_S), np.random.default_rng(1)
    starts = [np.full((steps, len(pairs)), i) for i in range(len(chosen))]
    for held_s in _HELD_S if len(chosen) > 1 else ():
        held = round(held_s / _STEP_S)
        drawn = random.integers(0, len(chosen), (steps // held + 1, len(pairs)))
        starts.append(np.repeat(drawn, held, axis=0)[:steps])
    many = len(starts)
    found = _improved(np.tile(a, (many, 1, 1, 1)), np.tile(b, (many, 1, 1)), np.concatenate(starts, axis=1), rounds)
    best: Floats = found.reshape(many, len(near.corners), len(near.delays_s)).max(axis=0)
    return best


def held_growth(channel: Channel) -> float:
    """The fastest growth of the loop with its weights held in a corner, 1/s; below zero where it always decays."""
    near = in_floats(channel)
    found = [
        float(np.log(np.abs(eigvals(_discrete(loop, float(delay))[0])).max())) / _step_s(float(delay))
        for corner in near.corners
        for loop in corner
        for delay in near.delays_s
    ]
    return max(found)


def _improved(a: Floats, b: Floats, selected: np.typing.NDArray[np.int64], rounds: int) -> Floats:
    steps, many = selected.shape
    which = np.arange(many)
    x = np.zeros((many, a.shape[2]))
    for _ in range(rounds):
        adjoint = np.zeros((steps + 1, many, a.shape[2]))
        adjoint[steps, :, 0] = 1.0
        for k in range(steps - 1, -1, -1):
            adjoint[k] = (adjoint[k + 1][:, None, :] @ a[which, selected[k]])[:, 0, :]
        x = np.zeros_like(x)
        changed = 0
        for k in range(steps):
            after = a @ x[:, None, :, None]
            chosen = (after[..., 0] @ adjoint[k + 1][:, :, None])[..., 0].argmax(axis=1)
            changed += int((chosen != selected[k]).sum())
            selected[k] = chosen
            inlet = b[which, chosen]
            sign = np.where((inlet * adjoint[k + 1]).sum(axis=1) >= 0.0, 1.0, -1.0)
            x = after[which, chosen, :, 0] + inlet * sign[:, None]
        if not changed:
            break
    return x[:, 0]


def _discrete(loop: Loop, delay_s: float) -> tuple[Floats, Floats]:
    """One step: states, then y of the steps that the delay holds, the oldest first."""
    a, e, c, d = (np.array(part, dtype=float) for part in (loop.a, loop.e, loop.c, loop.d))
    n, step_s = len(a), _step_s(delay_s)
    late = round(delay_s / step_s)
    if not late:
        a, e = a + e @ c, np.zeros_like(e)
    block = np.zeros((n + 2, n + 2))
    block[:n, :n], block[:n, n], block[:n, n + 1] = a, e[:, 0], d[:, 0]
    over = expm(step_s * block)
    matrix = np.zeros((n + late, n + late))
    matrix[:n, :n] = over[:n, :n]
    if late:
        matrix[:n, n] = 0.5 * over[:n, n]  # the mean of y over the step: held from its beginning it would come late
        if late > 1:
            matrix[:n, n + 1] = 0.5 * over[:n, n]
        else:
            matrix[:n, :n] += 0.5 * np.outer(over[:n, n], c[0])
        matrix[n:-1, n + 1 :] = np.eye(late - 1)
        matrix[-1, :n] = c[0]
    return matrix, np.concatenate([over[:n, n + 1], np.zeros(late)])


def _step_s(delay_s: float) -> float:
    return delay_s / math.ceil(delay_s / _STEP_S) if delay_s else _STEP_S
