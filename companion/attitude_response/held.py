"""A response over one step with its set-point held, as plain numbers that CPython and numba both take."""

from __future__ import annotations

from typing import NamedTuple


class Held(NamedTuple):
    """The exact step of a kind without further states; of the first order only `phi11` and `stiffness` are used."""

    first_order: bool
    phi11: float
    phi12: float
    phi21: float
    phi22: float
    gamma1: float
    gamma2: float
    stiffness: float  # wn^2; of the first order M


def advance(over: Held, output: float, rate: float, wanted: float) -> tuple[float, float]:
    """Output and rate at the end of the step."""
    first_order, phi11, phi12, phi21, phi22, gamma1, gamma2, stiffness = over
    if first_order:
        output = wanted + (output - wanted) * phi11
        return output, stiffness * (wanted - output)  # the rate at the end of the step
    drive = stiffness * wanted
    return phi11 * output + phi12 * rate + gamma1 * drive, phi21 * output + phi22 * rate + gamma2 * drive
