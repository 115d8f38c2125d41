"""An attitude response with its delay, as the certificate is about it. Standard library only."""

from __future__ import annotations

from dataclasses import dataclass
from decimal import Decimal
from typing import Final

from companion.attitude_response.exact import NO_DELAY, Interval, check_order, ends
from companion.attitude_response.kind import Kind
from companion.attitude_response.realisation import StateSpace, delay_line, series

MAX_PADE_ORDER: Final = 4
SHORTEST_DELAY_S: Final = Decimal("0.00001")


@dataclass(frozen=True)
class AttitudeResponse:
    """Closed-loop attitude dynamics from commanded to reached tilt, eq. (16).

    Parameters
    ----------
    dynamics
        Response without delay.
    delay_s
        Transport delay in s, zero or an interval above zero.
    pade_order
        Order of the Pade approximant that stands for the delay, 1 to `MAX_PADE_ORDER`.

    Raises
    ------
    ValueError
        One line, if it is no stable, strictly proper response of unit gain, or the delay or its order is impossible.
    """

    dynamics: Kind
    delay_s: Interval = NO_DELAY
    pade_order: int = 1

    def __post_init__(self) -> None:
        self.dynamics.check()
        delay = self.delay_s
        if not isinstance(self.pade_order, int) or not 1 <= self.pade_order <= MAX_PADE_ORDER:
            raise ValueError(f"pade_order must be 1 to {MAX_PADE_ORDER}, not {self.pade_order}")
        check_order("delay", delay)
        if 0 < delay.upper < SHORTEST_DELAY_S:
            raise ValueError(f"delay {delay.upper} s is too short to tell from none: write 0")
        if delay.lower < 0 or (delay.lower == 0 < delay.upper):
            raise ValueError(f"delay must be zero or an interval above zero, not {delay.lower} to {delay.upper} s")


def corners(response: AttitudeResponse) -> list[StateSpace]:
    """Realisations at every corner of the parameter box, one if all parameters are plain values.

    Returns
    -------
    list of StateSpace
        Strictly proper, unit gain at rest; the state has the order of the dynamics, plus `pade_order` if there is a
        delay.
    """
    delays = [delay_line(delay, response.pade_order) for delay in ends(response.delay_s)]
    dynamics = response.dynamics.corners()
    return [series(line, one) for line in delays for one in dynamics]
