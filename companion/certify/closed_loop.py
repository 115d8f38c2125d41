"""Closed loop of reference model and attitude dynamics, eq. (24), at the corners of every box. Standard library only.

State: position and velocity of the hedged reference model (20), then the states of the attitude dynamics. With the
weights W of eq. (21) and the attitude response (A_a, B_a, C_a),

    A(W) = [ A_r + B W^T    B C_a ]
           [   -B_a W^T      A_a  ]

which is eq. (24) for first-order dynamics. The signs of the channels are left out: B = [0, g] on either axis and a
positive nominal W (x tilts nose down to accelerate, y right side down; the sign of eq. (15) moves into the tilt)."""

import itertools
from collections.abc import Iterable
from fractions import Fraction

from companion.attitude_response.exact import ends
from companion.attitude_response.realisation import ONE, ZERO, Matrix, Row, StateSpace
from companion.attitude_response.response import corners
from companion.certify.piecewise.hold import Reference, held
from companion.certify.piecewise.sectors import Channel, Loop
from companion.certify.problem import AxisProblem

YAW_OCTAGON = tuple(
    corner
    for q in (Fraction(5, 12), Fraction(-5, 12))  # 5/12 > sqrt(2) - 1: the octagon holds the unit circle
    for corner in ((ONE, q), (-ONE, q), (q, ONE), (q, -ONE))
)
"""Rational corners around all (cos 2 yaw, sin 2 yaw)."""

Block = tuple[tuple[Fraction, Fraction], tuple[Fraction, Fraction]]


def axis_vertices(problem: AxisProblem) -> list[Matrix]:
    """Closed-loop matrices at all corners of the weight bounds and of the parameters of the attitude response.

    Returns
    -------
    list of (n, n) Matrix
        n = 2 + order of the attitude dynamics; SI units; no matrix twice.
    """
    return _distinct(vertex for vertices in switching_vertices(problem) for vertex in vertices)


def switching_vertices(problem: AxisProblem) -> list[list[Matrix]]:
    """Matrices by corner of the attitude response (unknown, but it does not switch), then by `weight_corners`."""
    bounds = weight_corners(problem)
    return [[_closed_loop(problem, weights, actuator) for weights in bounds] for actuator in corners(problem.response)]


def _joint(x: AxisProblem, y: AxisProblem) -> list[Matrix]:
    """Matrices of both axes at all corners with the yaw free: each state of an axis twice, for x and y in turn.

    Turning the vehicle by psi turns the attitude response seen by the two position axes: each coefficient pair (a_x,
    a_y) becomes `mean I + half difference S`, `S = [[cos 2 psi, sin 2 psi], [sin 2 psi, -cos 2 psi]]`. The corners of
    `YAW_OCTAGON` cover every psi, moving or not, as long as the thrust direction does not turn along with the yaw.
    """
    pairs = list(itertools.product(x.response.dynamics.corners(), y.response.dynamics.corners()))
    if len(pairs[0][0].b) != len(pairs[0][1].b):
        raise ValueError("a free yaw needs attitude responses of the same order on both axes")
    bounds = list(itertools.product(weight_corners(x), weight_corners(y)))
    return _distinct(
        _joint_closed_loop((x, y), weights, pair, yaw) for pair in pairs for yaw in YAW_OCTAGON for weights in bounds
    )


def axis_channel(problem: AxisProblem, tick_s: Fraction = ZERO) -> Channel:
    """One axis with its true delay: the inlet of its corners is the acceleration, g times the delayed response.

    `tick_s`: the longest tick over which its command is held, zero for none. Raises `ValueError` where it is too slow,
    or where the kind of response does not allow for one (`hold`).
    """
    if tick_s:
        stiffness, damping, g = _reference(problem)
        ends_ = [
            (Fraction(low), Fraction(high))
            for low, high in zip(problem.weights_lower, problem.weights_upper, strict=True)
        ]
        reference = Reference(stiffness, damping, g, (ends_[0], ends_[1]))
        return held(reference, problem.response.dynamics.corners(), tuple(ends(problem.response.delay_s)), tick_s)
    corners_ = tuple(
        tuple(_loop(_closed_loop(problem, weights, actuator), 1) for weights in _all_weights(problem))
        for actuator in problem.response.dynamics.corners()
    )
    return Channel(corners_, tuple(ends(problem.response.delay_s)))


def joint_channel(x: AxisProblem, y: AxisProblem) -> Channel:
    """Both axes with the yaw free to turn, and one delay in common: that of the vehicle and its link.

    `Problem` has seen to it that the delay is the same, and that with one the output does not turn.

    Raises
    ------
    ValueError
        If the attitude responses have different order.
    """
    loops = [_loop(vertex, 2) for vertex in _joint(x, y)]
    if x.response.delay_s.upper and len({loop.c for loop in loops}) > 1:
        raise ValueError(
            "a free yaw with a delay needs responses of first or second order"
        )  # its output would turn too
    return Channel(tuple((loop,) for loop in loops), tuple(ends(x.response.delay_s)))


def _loop(vertex: Matrix, channels: int) -> Loop:
    """The loop cut where the attitude response drives the velocities."""
    n, first = len(vertex), 2 * channels
    a, e, c = [list(row) for row in vertex], [[ZERO] * channels for _ in range(n)], []
    for number in range(channels):
        row = channels + number
        c.append((*(ZERO for _ in range(first)), *vertex[row][first:]))  # g y: a specific force
        a[row][first:] = [ZERO] * (n - first)
        e[row][number] = ONE
    return Loop(tuple(map(tuple, a)), tuple(map(tuple, e)), tuple(c))


def _all_weights(problem: AxisProblem) -> list[tuple[Fraction, Fraction]]:
    """The four corners of the projection box in order, also where two of them are one."""
    positions, velocities = zip(problem.weights_lower, problem.weights_upper, strict=True)
    return [(Fraction(p), Fraction(v)) for p in positions for v in velocities]


def weight_corners(problem: AxisProblem) -> list[tuple[Fraction, Fraction]]:
    """The four corners of the projection box, (position, velocity) weight."""
    ends = [
        sorted({Fraction(w) for w in pair}) for pair in zip(problem.weights_lower, problem.weights_upper, strict=True)
    ]
    return [(position, velocity) for position in ends[0] for velocity in ends[1]]


def _closed_loop(problem: AxisProblem, weights: tuple[Fraction, Fraction], actuator: StateSpace) -> Matrix:
    stiffness, damping, g = _reference(problem)
    rows = [
        (ZERO, ONE, *(ZERO for _ in actuator.b)),
        (g * weights[0] - stiffness, g * weights[1] - damping, *(g * c for c in actuator.c)),
    ]
    for row, b in zip(actuator.a, actuator.b, strict=True):
        rows.append((-b * weights[0], -b * weights[1], *row))
    return tuple(rows)


def _joint_closed_loop(
    axes: tuple[AxisProblem, AxisProblem],
    weights: tuple[tuple[Fraction, Fraction], tuple[Fraction, Fraction]],
    actuators: tuple[StateSpace, StateSpace],
    yaw: tuple[Fraction, Fraction],
) -> Matrix:
    (ax, bx, cx, _), (ay, by, cy, _) = actuators
    references = [_reference(axis) for axis in axes]
    order = len(bx)

    rows: list[Row] = [_interleaved([_diagonal(ZERO, ZERO), _diagonal(ONE, ONE)], order, i) for i in range(2)]
    outputs = [_turned(cx[j], cy[j], yaw) for j in range(order)]
    for i, (stiffness, damping, g) in enumerate(references):
        row = [ZERO] * (4 + 2 * order)
        row[i], row[2 + i] = g * weights[i][0] - stiffness, g * weights[i][1] - damping
        row[4:] = [g * entry for block in outputs for entry in block[i]]
        rows.append(tuple(row))
    for j in range(order):
        inlet = _turned(bx[j], by[j], yaw)
        blocks = [_turned(ax[j][k], ay[j][k], yaw) for k in range(order)]
        for i in range(2):
            feedback = [-inlet[i][axis] * weights[axis][state] for state in range(2) for axis in range(2)]
            rows.append((*feedback, *(entry for block in blocks for entry in block[i])))
    return tuple(rows)


def _reference(problem: AxisProblem) -> tuple[Fraction, Fraction, Fraction]:
    wn, g = Fraction(problem.natural_frequency_rad_s), Fraction(problem.gravity_m_s2)
    return wn * wn, 2 * Fraction(problem.damping_ratio) * wn, g


def _turned(x: Fraction, y: Fraction, yaw: tuple[Fraction, Fraction]) -> Block:
    mean, half = (x + y) / 2, (x - y) / 2
    cosine, sine = yaw
    return ((mean + half * cosine, half * sine), (half * sine, mean - half * cosine))


def _diagonal(x: Fraction, y: Fraction) -> Block:
    return ((x, ZERO), (ZERO, y))


def _interleaved(blocks: list[Block], order: int, i: int) -> Row:
    return tuple(entry for block in blocks for entry in block[i]) + (ZERO,) * (2 * order)


def _distinct(matrices: Iterable[Matrix]) -> list[Matrix]:
    return list(dict.fromkeys(matrices))
