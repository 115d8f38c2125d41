"""Estimates that are wrong in one quantity, or in several, while all the others are right: a catalogue of lies.

A quantity is a coordinate of position or velocity, local NED, or the whole attitude. Pure but for its own memory: the
same reports give the same lies.
"""

from __future__ import annotations

from collections import deque
from enum import StrEnum
from random import Random
from typing import Final, NamedTuple

from sitl.vehicles.rotation import euler, quaternion
from sitl.vehicles.vehicle import VehicleState

QUANTITIES: Final = ("x", "y", "z", "vx", "vy", "vz", "attitude")
_PLACES: Final = {name: (n,) for n, name in enumerate(QUANTITIES[:6])} | {"attitude": (6, 7, 8)}  # roll, pitch, yaw
_PARTNER: Final = {0: 3, 1: 4, 2: 5, 3: 0, 4: 1, 5: 2}  # position of a velocity, velocity of a position
_OTHER: Final = {0: 1, 1: 0, 2: 0, 3: 4, 4: 3, 5: 3, 6: 7, 7: 6, 8: 8}  # what a quantity is mixed up with
_LONGEST_DELAY_S: Final = 5.0


class Kind(StrEnum):
    """What is wrong with a quantity. `size` of a lie, in the quantity's SI unit where nothing else is said."""

    STUCK = "stuck"  # it keeps the value that it had
    NOISE = "noise"  # it is noise about zero, of a standard deviation `size`
    STILL = "still"  # it keeps the value that it had, with noise of a standard deviation `size`
    DRIFT = "drift"  # it goes away by `size` a second, and position and velocity agree about it
    SLIDE = "slide"  # it goes away by `size` a second, alone
    STEP = "step"  # it steps by `size` every second
    SCALE = "scale"  # what it changes by is `size` times what is true
    DELAY = "delay"  # it grows `size` seconds old, half a second in each
    MIX = "mix"  # it is swapped with that of another axis


class Lie(NamedTuple):
    """A kind of lie about quantities, as `QUANTITIES` names them. Of an attitude, roll and pitch drift, slide, step."""

    kind: Kind
    of: tuple[str, ...]
    size: float = 0.0


class Liar:
    """Tells one lie from the first report on that it is given."""

    def __init__(self, lie: Lie, random: Random) -> None:
        self._lie, self._random = lie, random
        self._places = [place for name in lie.of for place in _PLACES[name]]
        self._began: tuple[float, list[float]] | None = None
        self._past: deque[tuple[float, list[float]]] = deque()

    def __call__(self, state: VehicleState, time_s: float) -> VehicleState:
        true = [*state.position_ned_m, *state.velocity_ned_m_s, *euler(*state.q_wxyz)]
        began_s, began = self._began = self._began or (time_s, true)
        told = self._told(true, began, time_s, time_s - began_s)
        x, y, z, vx, vy, vz, roll, pitch, yaw = told
        turned = told[6:] != true[6:]
        return state._replace(
            position_ned_m=(x, y, z),
            velocity_ned_m_s=(vx, vy, vz),
            q_wxyz=quaternion(roll, pitch, yaw) if turned else state.q_wxyz,
        )

    def _told(self, true: list[float], began: list[float], time_s: float, passed_s: float) -> list[float]:
        kind, _, size = self._lie
        told = list(true)
        past = self._delayed(true, time_s, min(size, 0.5 * passed_s)) if kind is Kind.DELAY else true
        for place in self._places:
            leans = place < 8  # the heading does not go away
            if kind is Kind.STUCK:
                told[place] = began[place]
            elif kind is Kind.NOISE:
                told[place] = self._random.gauss(0.0, size)
            elif kind is Kind.STILL:
                told[place] = began[place] + self._random.gauss(0.0, size)
            elif kind in (Kind.DRIFT, Kind.SLIDE) and leans:
                told[place] += size * passed_s
                if kind is Kind.DRIFT and place in _PARTNER:
                    told[_PARTNER[place]] += size if place < 3 else 0.5 * size * passed_s * passed_s
            elif kind is Kind.STEP and leans:
                told[place] += size * int(passed_s)
            elif kind is Kind.SCALE:
                told[place] = began[place] + size * (true[place] - began[place])
            elif kind is Kind.DELAY:
                told[place] = past[place]
            elif kind is Kind.MIX:
                told[place], told[_OTHER[place]] = true[_OTHER[place]], true[place]
        return told

    def _delayed(self, true: list[float], time_s: float, age_s: float) -> list[float]:
        past = self._past
        past.append((time_s, true))
        while len(past) > 1 and past[1][0] <= time_s - min(age_s, _LONGEST_DELAY_S):
            past.popleft()
        return past[0][1]
