"""Waypoints to a trajectory: the smoothest way through them, and the times that limits leave for it. Before flight."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Final

from companion.control.types import GRAVITY_M_S2
from companion.trajectory.feasibility import Limits
from companion.trajectory.minimum_snap import minimum_snap
from companion.trajectory.polynomial import MOVING_M_S, Piece, Piecewise
from companion.trajectory.trajectory import Place

if TYPE_CHECKING:
    import numpy as np

_ROUNDS: Final = 10
_SHIFT: Final = 0.3  # of the time in hand, as a power: pieces beside a short one overshoot
_MARGIN: Final = 1.01  # between two probes
_PROBES: Final = 25  # of a piece, its middle among them
_SHORTEST_S: Final = 0.1
_TURN_PEAK: Final = 1.875  # largest rate of a turn of one in one second


def through(places: Sequence[Place], limits: Limits, *, along_path: bool = False) -> Piecewise:
    """From rest at the first place to rest at the last, about as fast as the limits allow. Raises `ValueError`."""
    _check(places)
    return piecewise(places, allocate(places, limits, along_path=along_path), along_path=along_path)


def piecewise(
    places: Sequence[Place], durations_s: Sequence[float], *, along_path: bool = False, at_rest: bool = True
) -> Piecewise:
    """The minimum-snap trajectory through the places in the times given."""
    import numpy as np  # noqa: PLC0415 - flying does without

    pieces = minimum_snap(np.array(places)[:, :3], np.array(durations_s, dtype=float), at_rest=at_rest)
    turns = _headings(places)
    rows = zip(pieces.transpose(0, 2, 1).tolist(), durations_s, turns[:-1], turns[1:], strict=True)
    return Piecewise(
        tuple(
            Piece(float(duration), tuple(north), tuple(east), tuple(down), (begin, end))
            for (north, east, down), duration, begin, end in rows
        ),
        along_path,
    )


def _check(places: Sequence[Place]) -> None:
    if len(places) < 2:
        raise ValueError("a way needs two places at least")
    for number, (one, other) in enumerate(pairwise(places), 2):
        if math.dist(one[:3], other[:3]) < 1e-3:
            raise ValueError(f"place {number} is where place {number - 1} is: leave it out, or hold in between")


def _headings(places: Sequence[Place]) -> list[float]:
    """Of the places, each the short way round from the one before."""
    found = [places[0][3]]
    for place in places[1:]:
        turn = place[3] - found[-1]
        found.append(found[-1] + math.atan2(math.sin(turn), math.cos(turn)))
    return found


def allocate(places: Sequence[Place], limits: Limits, *, along_path: bool = False) -> list[float]:
    """Time for each piece, s.

    It begins with what each would take alone. All of them are made slower together until the whole fits; then, a few
    times over, those that are farther from the limits than others give up some of theirs. The shortest whole counts.
    """
    import numpy as np  # noqa: PLC0415

    points = np.array(places)[:, :3]
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    acceleration = min(limits.acceleration_m_s2, GRAVITY_M_S2 * math.tan(limits.tilt_rad))
    durations = np.maximum(lengths / limits.speed_m_s + np.sqrt(lengths / acceleration), _SHORTEST_S)
    turns = np.abs(np.diff(_headings(places)))
    least = 0.0 * turns if along_path else _TURN_PEAK * turns / limits.yaw_rate_rad_s
    best: list[float] = []
    for _ in range(_ROUNDS):
        used = _used(minimum_snap(points, durations), durations, limits, along_path)
        used = np.maximum(used, least / durations)
        most = used.max()
        fitting = durations * (_MARGIN * most)
        if not best or fitting.sum() < sum(best):
            best = fitting.tolist()
        durations = fitting * np.clip(used / most, 0.5, 1.0) ** _SHIFT
    return best


def _used(
    pieces: np.typing.NDArray[np.float64], durations_s: np.typing.NDArray[np.float64], limits: Limits, along_path: bool
) -> np.typing.NDArray[np.float64]:
    """How much slower each piece would have to be for every limit, (n - 1,); below one it has time in hand."""
    import numpy as np  # noqa: PLC0415

    times = np.linspace(0.0, 1.0, _PROBES)[None, :] * durations_s[:, None]
    velocity, acceleration, jerk = (_derivative(pieces, times, order) for order in (1, 2, 3))
    speed, across = np.linalg.norm(velocity, axis=2), np.linalg.norm(acceleration[:, :, :2], axis=2)
    down = acceleration[:, :, 2]
    lift = np.hypot(across, GRAVITY_M_S2 - down) / GRAVITY_M_S2 - 1.0
    asked = [
        speed / limits.speed_m_s,
        np.sqrt(across / limits.acceleration_m_s2),
        np.cbrt(np.linalg.norm(jerk, axis=2) / limits.jerk_m_s3),
        np.sqrt(np.maximum(across / math.tan(limits.tilt_rad) + down, 0.0) / GRAVITY_M_S2),
        np.sqrt(np.maximum(lift, 0.0) / (limits.lift_highest - 1.0)),
        np.sqrt(np.maximum(down, 0.0) / (GRAVITY_M_S2 * (1.0 - limits.lift_lowest))),
    ]
    if along_path:
        turning = velocity[:, :, 0] * acceleration[:, :, 1] - velocity[:, :, 1] * acceleration[:, :, 0]
        square = np.maximum(velocity[:, :, 0] ** 2 + velocity[:, :, 1] ** 2, MOVING_M_S**2)
        asked.append(np.abs(turning) / square / limits.yaw_rate_rad_s)
    found: np.typing.NDArray[np.float64] = np.max(asked, axis=(0, 2))
    return found


def _derivative(
    pieces: np.typing.NDArray[np.float64], times_s: np.typing.NDArray[np.float64], order: int
) -> np.typing.NDArray[np.float64]:
    """(pieces, probes, axes)."""
    import numpy as np  # noqa: PLC0415

    powers = np.arange(order, pieces.shape[1])
    factors = np.array([math.perm(int(power), order) for power in powers], dtype=float)
    values: np.typing.NDArray[np.float64] = (times_s[:, :, None] ** (powers - order) * factors) @ pieces[:, order:, :]
    return values
