"""A piecewise quadratic Lyapunov function on sectors, with the true delay: what has to hold, exactly.

Standard library only: the verifier and the solver build on the same inequalities.

The loop, with a constant transport delay h. Delay and attitude response commute, so the delay acts on one smooth
scalar a channel, the undelayed response y:

    x' = A(W, theta) x + E y(t - h),   y = C x,   C E = 0,

x = (position, velocity, states of the response), W the weights, theta the parameters of the response.

Function. K rays in the plane of position and velocity, both axes among them, cut its half plane into sectors; beyond
the last ray the rays repeat, mirrored. In a sector a state is `b1 r1 + b2 r2`, b1 b2 >= 0, and psi has b1 and b2 at
the places of its two rays and zeros elsewhere, signed so that psi is odd and continuous. With z = (psi, the other
states, X_0, ..., X_(N-1)), X_i the integral of the shifted Legendre polynomial L_i times y over the last h,

    V = z' T z + S int y^2 + h R int int y'^2,   S, R >= 0 (one pair a channel),

is continuous and even. K = 0 is the one quadratic function: psi is (position, velocity) itself.

Theorem. V is positive and falls along every solution, for all weights that move anyhow (measurably) in their box,
every constant theta in its box and every constant h in its interval, if some u >= 0 exist with

    He(G' P H) + S (y y' - yh yh') + R (h^2 yd yd' - sum_(i<=N) (2 i + 1) O_i O_i') + u (b1 b2' + b2 b1') < 0

for every sector, both ends of h, every corner of theta and the vertices of W below, and

    P + (S / h) diag(0, 1, 3, ..., 2 N - 1) - u (b1 b2' + b2 b1') > 0

for every sector and the longest h. P are the entries of T of the sector; the first form is in (b, other states,
Phi_i = X_i / h, yh = y(t - h)), z = G zeta, z' = H zeta, yd is y', and O_i, the integral of L_i y', is `y - (-1)^i yh -
sum_(j<i) (2 j + 1) (1 - (-1)^(i+j)) Phi_j`. Why: h int y'^2 >= sum (2 i + 1) O_i^2 and int y^2 >= sum (2 i + 1) X_i^2 /
h are the Bessel-Legendre inequality (Seuret and Gouaisbaut 2015, order N); b1 b2 >= 0 in a sector. W enters through
the scalar W' x alone, and where position and velocity have one sign it lies between its values at the two corners
(lower, lower) and (upper, upper), where they differ between those at (lower, upper) and (upper, lower). At a fixed zeta
the form is convex in that scalar, in each entry of theta and in h, each by itself, so that it is largest at a corner.
Time and states may be scaled; N = 2. Piecewise quadratic functions: Johansson and Rantzer 1998.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from fractions import Fraction
from typing import Final, NamedTuple

from companion.attitude_response.realisation import ONE, ZERO, Row

ORDER: Final = 2
"""N, of the Bessel-Legendre inequality."""


class Square(NamedTuple):
    """A sum of `factor (row' zeta)^2`."""

    terms: tuple[tuple[Fraction, Row], ...]


class Loop(NamedTuple):
    """One corner: `x' = a x + e y(t - h)`, `y = c x`; SI units.

    `x` begins with position and velocity where sectors are used. `e` has a column a channel, `c` a row. Errors of the
    hold (`hold`) drive x' through the columns of `d`; `bounds` are their sums of squares, over (x, y(t - h), errors),
    each at least zero in the integral.
    """

    a: tuple[Row, ...]
    e: tuple[Row, ...]
    c: tuple[Row, ...]
    d: tuple[Row, ...] = ()
    bounds: tuple[Square, ...] = ()


class Channel(NamedTuple):
    """What one proof is about.

    Attributes
    ----------
    corners
        By corner of the response, then by corner of the weights: four in the order (lower, lower), (lower, upper),
        (upper, lower), (upper, upper), of position and velocity; any number where there are no sectors.
    delays_s
        Ends of the interval of the delay; (0,) for none.
    held
        By corner of the response, the further corners of a hold: all of them count in every sector. Empty without one.
    tick_s
        The longest tick of a hold; zero without one.
    """

    corners: tuple[tuple[Loop, ...], ...]
    delays_s: tuple[Fraction, ...]
    held: tuple[tuple[Loop, ...], ...] = ()
    tick_s: Fraction = ZERO


class Scale(NamedTuple):
    """Units in which an inequality is written: time in s, and each state of x and error of a hold."""

    time_s: Fraction
    states: Row


class Sector(NamedTuple):
    """Two neighbouring rays as columns (position; velocity) in scaled units, and where a sector's coordinates stand.

    `places` and `signs` are those in z of its local coordinates.
    """

    basis: tuple[tuple[Fraction, Fraction], tuple[Fraction, Fraction]]
    places: tuple[int, ...]
    signs: tuple[int, ...]


class Inequality(NamedTuple):
    """`-He(G' P H) - sum_k m_k Q_k - u (b1 b2' + b2 b1') > 0`, or `P + ... > 0` where `rate` is empty.

    Attributes
    ----------
    sector
        Index.
    state, rate
        G and H by rows.
    squares
        Q of each multiplier: S and R of each channel in turn, none without a delay; then of each error of a hold.
    """

    sector: int
    state: tuple[Row, ...]
    rate: tuple[Row, ...]
    squares: tuple[Square, ...]


def multipliers(channel: Channel) -> tuple[int, int]:
    """How many S and R there are, and how many multipliers of errors of a hold."""
    loop = channel.corners[0][0]
    return (2 * len(loop.c) if delayed(channel) else 0), len(loop.bounds)


def delayed(channel: Channel) -> bool:
    """Whether there is a delay."""
    return channel.delays_s[-1] > 0


def whole(loop: Loop) -> tuple[Row, ...]:
    """The corner without a delay: y(t) itself drives it."""
    n = len(loop.a)
    columns = [[row[j] for row in loop.c] for j in range(n)]
    return tuple(
        tuple(x + _dot(inlet, columns[j]) for j, x in enumerate(row)) for row, inlet in zip(loop.a, loop.e, strict=True)
    )


def size(channel: Channel) -> int:
    """Length of z in a sector."""
    loop = channel.corners[0][0]
    return len(loop.a) + (ORDER * len(loop.c) if delayed(channel) else 0)


def sectors(channel: Channel, rays: Sequence[tuple[Fraction, Fraction]]) -> list[Sector]:
    """The sectors between rays given in scaled units; one that is everything where there are no rays.

    Raises
    ------
    ValueError
        If the rays do not begin with the position's axis, have not the velocity's among them, or do not turn
        counterclockwise through less than half a turn.
    """
    n, count = size(channel), len(rays)
    if not count:
        return [Sector(((ONE, ZERO), (ZERO, ONE)), tuple(range(n)), (1,) * n)]
    turning = all(_cross(a, b) > 0 for a, b in zip(rays, [*rays[1:], (-rays[0][0], -rays[0][1])], strict=True))
    upward = rays[0][1] == 0 and rays[0][0] > 0 and all(v > 0 for _, v in rays[1:])
    if not (turning and upward and any(p == 0 for p, _ in rays)):
        raise ValueError("rays must turn counterclockwise from the position axis, with the velocity axis among them")
    others = tuple(range(count, count + n - 2))
    result = []
    for k, (p, v) in enumerate(rays):
        after, sign = (k + 1) % count, -1 if k == count - 1 else 1
        basis = ((p, sign * rays[after][0]), (v, sign * rays[after][1]))
        result.append(Sector(basis, (k, after, *others), (1, sign, *(1 for _ in others))))
    return result


def pattern(sectors_: Sequence[Sector]) -> dict[tuple[int, int], int]:
    """The entries of T that are not zero by definition, (i, j) with i <= j, in the order of a proof."""
    found: dict[tuple[int, int], int] = {}
    for sector in sectors_:
        for i, first in enumerate(sector.places):
            for second in sector.places[i:]:
                found.setdefault((min(first, second), max(first, second)), len(found))
    return found


def falls(channel: Channel, sectors_: Sequence[Sector], scale: Scale) -> Iterator[Inequality]:
    """V falls: one inequality a sector, corner and end of the delay."""
    everywhere = len(sectors_) == 1
    for index, sector in enumerate(sectors_):
        (p1, p2), (v1, v2) = sector.basis
        alike = (p1 + p2) * (v1 + v2) > 0  # of the middle of the sector
        for number, corner in enumerate(channel.corners):
            chosen = corner if everywhere else (corner[0], corner[3]) if alike else (corner[1], corner[2])
            for loop in (*chosen, *(channel.held[number] if channel.held else ())):
                scaled = _scaled(loop, sector, scale)
                for delay in channel.delays_s:
                    yield _falls(index, scaled, delay / scale.time_s)


def positive(channel: Channel, sectors_: Sequence[Sector], scale: Scale) -> Iterator[Inequality]:
    """V is positive: one inequality a sector."""
    n, longest = size(channel), channel.delays_s[-1] / scale.time_s
    channels = len(channel.corners[0][0].c) if delayed(channel) else 0
    first = n - ORDER * channels
    squares = []
    for number in range(channels):
        terms = tuple((-(2 * i + 1) / longest, _unit(n, first + i * channels + number)) for i in range(ORDER))
        squares += [Square(terms), Square(())]
    squares += [Square(())] * len(channel.corners[0][0].bounds)
    state = tuple(_unit(n, i) for i in range(n))
    for index in range(len(sectors_)):
        yield Inequality(index, state, (), tuple(squares))


def _falls(index: int, loop: Loop, delay: Fraction) -> Inequality:
    """In scaled units; zeta is x, Phi_i and y(t - h) where there is a delay, and the errors of a hold."""
    a, e, c, d, bounds = loop
    n, channels, errors = len(a), len(c), len(bounds)
    late = n + ORDER * channels  # the first of y(t - h)
    width = n + errors if not delay else late + channels + errors

    def over(row: Row, delayed: Row, error: Row) -> Row:
        """A row over (x, y(t - h), errors) in zeta; without a delay y is itself a row of x."""
        if delay:
            return (*row, *(ZERO for _ in range(n, late)), *delayed, *error)
        undelayed = zip(
            *(tuple(factor * entry for entry in y) for factor, y in zip(delayed, c, strict=True)), strict=True
        )
        return (*(x + sum(more) for x, more in zip(row, undelayed, strict=True)), *error)

    nothing = ((ZERO,) * channels, (ZERO,) * errors)
    rate = [over(row, inlet, drive) for row, inlet, drive in zip(a, e, d or [()] * n, strict=True)]
    state = [_unit(width, i) for i in range(n)]
    held = [
        Square(tuple((f, over(row[:n], row[n : n + channels], row[n + channels :])) for f, row in bound.terms))
        for bound in bounds
    ]
    if not delay:
        return Inequality(index, tuple(state), tuple(rate), tuple(held))
    phi = [[n + i * channels + number for number in range(channels)] for i in range(ORDER)]
    state += [tuple(delay * entry for entry in _unit(width, place)) for row in phi for place in row]
    squares: list[Square] = []
    omegas: list[list[Row]] = []
    for number in range(channels):
        y = over(c[number], *nothing)
        yd = tuple(_dot(c[number], [row[j] for row in rate[:n]]) for j in range(width))
        omega = []
        for i in range(ORDER + 1):
            entries = list(y)
            entries[late + number] -= (-1) ** i
            for j in range(i):
                entries[phi[j][number]] -= (2 * j + 1) * (1 - (-1) ** (i + j))
            omega.append(tuple(entries))
        omegas.append(omega)
        squares.append(Square(((ONE, y), (-ONE, _unit(width, late + number)))))
        bessel = tuple((Fraction(-(2 * i + 1)), row) for i, row in enumerate(omega))
        squares.append(Square(((delay * delay, yd), *bessel)))
    rate += [omegas[number][i] for i in range(ORDER) for number in range(channels)]
    return Inequality(index, tuple(state), tuple(rate), (*squares, *held))


def _scaled(loop: Loop, sector: Sector, scale: Scale) -> Loop:
    """The corner in scaled time, states and errors, its position and velocity in the coordinates of the sector."""
    n, channels, t = len(loop.a), len(loop.c), scale.time_s
    s, units = scale.states[:n], scale.states[n:]
    a = [[t * entry * s[j] / s[i] for j, entry in enumerate(row)] for i, row in enumerate(loop.a)]
    e = [[t * entry / s[i] for entry in row] for i, row in enumerate(loop.e)]
    d = [[t * entry * units[j] / s[i] for j, entry in enumerate(row)] for i, row in enumerate(loop.d)]
    c = [[entry * s[j] for j, entry in enumerate(row)] for row in loop.c]
    both = (*s, *(ONE for _ in range(channels)), *units)
    bounds = [
        [(f / unit**2, [x * y for x, y in zip(row, both, strict=True)]) for f, row in bound.terms]
        for unit, bound in zip(units, loop.bounds, strict=True)
    ]
    (p1, p2), (v1, v2) = sector.basis
    if sector.basis != ((ONE, ZERO), (ZERO, ONE)):
        for row in (*a, *c, *(row for bound in bounds for _, row in bound)):
            row[0], row[1] = row[0] * p1 + row[1] * v1, row[0] * p2 + row[1] * v2
        determinant = p1 * v2 - p2 * v1
        for matrix in (a, e, d) if d else (a, e):
            first, second = matrix[0], matrix[1]
            matrix[0] = [(v2 * x - p2 * y) / determinant for x, y in zip(first, second, strict=True)]
            matrix[1] = [(p1 * y - v1 * x) / determinant for x, y in zip(first, second, strict=True)]
    return Loop(
        _rows(a), _rows(e), _rows(c), _rows(d), tuple(Square(tuple((f, tuple(row)) for f, row in b)) for b in bounds)
    )


def _rows(matrix: list[list[Fraction]]) -> tuple[Row, ...]:
    return tuple(map(tuple, matrix))


def _cross(a: tuple[Fraction, Fraction], b: tuple[Fraction, Fraction]) -> Fraction:
    return a[0] * b[1] - a[1] * b[0]


def _dot(left: Sequence[Fraction], right: Sequence[Fraction]) -> Fraction:
    return sum((x * y for x, y in zip(left, right, strict=True) if x and y), ZERO)


def _unit(n: int, place: int) -> Row:
    return tuple(ONE if i == place else ZERO for i in range(n))
