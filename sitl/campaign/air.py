"""Wind and battery in the compiled loop: `sitl.world.environment` without faults."""

from __future__ import annotations

from typing import NamedTuple

from sitl.campaign.mersenne import Floats, Words, normal
from sitl.vehicles.body import Vector
from sitl.world.wind import Dryden, DrydenState, Gust, dryden_step, gusty, turbulent


class Air(NamedTuple):
    """What blows, and how fast the battery runs down; each part only where it is switched on."""

    used: bool
    windy: bool
    mean_ned_m_s: Vector
    gusts: bool
    gust: Gust
    turbulence: bool
    dryden: Dryden
    along: tuple[float, float]
    sag_1_s: float


def blow(
    air: Air, turbulence: DrydenState, before: Vector, now_us: int, words: Words, kept: Floats
) -> tuple[DrydenState, Vector]:
    """The turbulence and the wind of the next ten milliseconds."""
    if not air.windy:
        return turbulence, before
    blowing = air.mean_ned_m_s
    if air.gusts:
        blowing = gusty(air.mean_ned_m_s, air.gust, 1e-6 * now_us)
    if air.turbulence:
        n1 = normal(words, kept)
        n2 = normal(words, kept)
        n3 = normal(words, kept)
        n4 = normal(words, kept)
        n5 = normal(words, kept)
        turbulence, upon = dryden_step(air.dryden, turbulence, (n1, n2, n3, n4, n5))
        blowing = turbulent(blowing, air.along, upon)
    return turbulence, blowing
