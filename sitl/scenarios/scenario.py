"""What a scenario says: what is flown, what happens when, and what must hold."""

from __future__ import annotations

from typing import Final, NamedTuple

from companion.flight.authority.states import Reason
from sitl.autopilot.modes import FlightMode
from sitl.scenarios.run import Happening

QUADROTOR: Final = "px4_quadrotor.yaml"
RIG: Final = "antx_rig.yaml"
PLAIN_ADAPTATION: Final = (
    "controller.estimate_correction=null",
    "controller.axes.x.lyapunov_q=[1, 1]",
    "controller.axes.y.lyapunov_q=[1, 1]",
    "controller.bias.adaptation_rate.hedged=3",
)
"""Overrides of the quadrotor: as if nothing were wrong with an estimate."""
BY_A_TRUE_ESTIMATE: Final = {
    QUADROTOR: ("plant.sensors=null", "estimator=null", *PLAIN_ADAPTATION),
    RIG: (),
}
"""What is overridden of a base: an estimator's own error would hide what a scenario brings about."""


class Scenario(NamedTuple):
    """One flight and its verdict. Times in s since OFFBOARD began; distances from there, of the true vehicle."""

    name: str
    about: str  # one line
    reason: Reason  # why control must end
    happens: tuple[tuple[float, Happening], ...] = ()
    # what is flown
    base: str = QUADROTOR
    overrides: tuple[str, ...] = ()  # section.key=value
    before: tuple[Happening, ...] = ()  # before the companion is there
    airborne: bool = True  # hovering in Hold, armed, from the start; otherwise on the ground
    engage: bool = False  # the companion arms, takes off and asks for OFFBOARD; otherwise a pilot switches
    pilot: bool = True
    own_clock: bool = False  # the companion goes by its own clock instead of the samples', for what only that can tell
    limit_s: float = 15.0  # the operator ends it then, and the scenario has failed
    coast_s: float = 2.0  # for how long the plant flies on alone
    # what must hold, beside the reason
    engaged: bool = True  # control began at all
    ends_in: tuple[FlightMode, ...] = (FlightMode.HOLD,)
    armed: bool = True  # at the end
    stays_within_m: float = 1.0  # across and vertical, in control
    margin_m: float = 2.0  # and so much more after it, in the autopilot's hands
    error_m: float = 0.5  # worst distance from the tracked reference, in control
    by_s: float | None = None  # control has ended by then, and never before anything happens
    events: tuple[str, ...] = ()  # of the flight log, that must be there
    least_thrust: float | None = None  # told in OFFBOARD; by default the limit, or none where control never began
    streams: bool = True  # whether any set-point comes at all


class Flown(NamedTuple):
    """How a scenario went."""

    name: str
    expected: str
    reason: str  # `-` where the flight could not be flown
    worst_error_m: float | None  # None where control never began
    problems: tuple[str, ...]
    wall_s: float
    in_control_m: float | None = None  # the farthest that it truly went in control; None as above
    in_control_s: float | None = None

    @property
    def passed(self) -> bool:
        """Whether everything held."""
        return not self.problems
