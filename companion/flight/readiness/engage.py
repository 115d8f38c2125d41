"""`--engage`: arm, take off where the vehicle can, and ask for OFFBOARD; each step believed only when it is seen.

The pilot comes first here too: a mode that was not asked for, or a disarm, ends it, and nothing more is asked. So does
the mode in which it began, once the vehicle has been in one that was asked for.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from companion.flight.vehicle_link.messages import Command
from companion.flight.vehicle_link.modes import Mode, Result
from companion.flight.vehicle_link.requests import Arm, SetMode

_RETRY_S = 0.5
_HOVER_SPEED_M_S = 0.3  # reported velocity may be off by 0.2 m/s with GPS
_HOVER_CLIMB_M = 0.3


class Seen(NamedTuple):
    """What of the vehicle the sequence looks at."""

    mode: int
    armed: bool
    speed_m_s: float
    climbed_m: float
    settled: bool = True  # the estimate


class Step(NamedTuple):
    """One request, when it is fulfilled, how long that may take, and what the vehicle may be doing meanwhile."""

    name: str
    request: Arm | SetMode | None
    command: Command | None  # whose answer counts
    fulfilled: Callable[[Seen], bool]
    timeout_s: float
    modes: frozenset[int]  # besides the mode in which the sequence began, until one that was asked for is seen
    wanted: int | None  # the mode that it asks for
    armed: bool  # whether the vehicle must be armed all the while


def plan(*, can_fly: bool) -> list[Step]:
    """The steps for a vehicle that can take off, or for a rig that cannot."""

    def mode_step(name: str, mode: Mode, while_in: Mode | None) -> Step:
        modes = frozenset({int(mode)} if while_in is None else {int(mode), int(while_in)})
        return Step(name, SetMode(mode), Command.SET_MODE, lambda seen: seen.mode == mode, 5.0, modes, mode, True)

    armed = Step(
        "arm",
        Arm(),
        Command.ARM,
        lambda seen: seen.armed,
        5.0,
        frozenset({Mode.HOLD}),
        None,
        False,
    )
    if not can_fly:
        return [armed, mode_step("change to OFFBOARD", Mode.OFFBOARD, Mode.HOLD)]
    hover = Step(
        "hover",
        None,
        None,
        lambda seen: (
            seen.mode == Mode.HOLD
            and seen.climbed_m > _HOVER_CLIMB_M
            and seen.speed_m_s < _HOVER_SPEED_M_S
            and seen.settled
        ),
        40.0,
        frozenset({Mode.TAKEOFF, Mode.HOLD}),
        None,
        True,
    )
    return [
        armed,
        mode_step("take off", Mode.TAKEOFF, Mode.HOLD),
        hover,
        mode_step("change to OFFBOARD", Mode.OFFBOARD, Mode.HOLD),
    ]


class Engagement:
    """Walks through the steps: what to send now, and whether one has failed."""

    def __init__(self, steps: list[Step]) -> None:
        self._steps = steps
        self._first_mode: int | None = None
        self._left = False  # it has been in a mode that was asked for
        self._begun_s: float | None = None
        self._asked_s = 0.0
        self._answer: int | None = None

    def on_answer(self, command: int, result: int) -> None:
        """A COMMAND_ACK. PX4 accepts a mode first and decides afterwards, so the last answer counts."""
        if self._steps and command == self._steps[0].command:
            self._answer = result

    def advance(self, now_s: float, seen: Seen) -> tuple[Arm | SetMode | None, str | None]:
        """(what to ask now, what the vehicle did not do); both None while it waits or when it is done."""
        if self._first_mode is None:
            self._first_mode = seen.mode
            if seen.armed:
                return None, "wait: it is armed already, so --engage leaves it to its pilot"
            if seen.mode == Mode.OFFBOARD:  # what it reads after it has landed by itself: armed, it would fly on
                return None, "wait: it is in OFFBOARD already; choose another mode first"
        if self._steps and self._begun_s is not None:
            taken = self._taken(self._steps[0], seen)
            if taken is not None:
                return None, taken
            self._left = self._left or seen.mode == self._steps[0].wanted
        while self._steps and self._steps[0].fulfilled(seen):
            self._steps.pop(0)
            self._begun_s = None
        if not self._steps:
            return None, None
        step = self._steps[0]
        if self._begun_s is not None:
            if now_s - self._begun_s > step.timeout_s:
                return None, f"{step.name} within {step.timeout_s:g} s: {self._answered()}"
            # Asked again only while it has not agreed: repeated after that, a request would overrule the pilot.
            waiting = self._answer == Result.ACCEPTED or now_s - self._asked_s < _RETRY_S
            if step.request is None or waiting:
                return None, None
        else:
            self._begun_s, self._answer = now_s, None
        self._asked_s = now_s
        return step.request, None

    def _taken(self, step: Step, seen: Seen) -> str | None:
        """What somebody else has done meanwhile; looked at before the step may count as fulfilled."""
        if seen.mode not in step.modes and (self._left or seen.mode != self._first_mode):
            return f"{step.name}: somebody chose another mode"
        if step.armed and not seen.armed:
            return f"{step.name}: somebody disarmed it"
        return None

    def _answered(self) -> str:
        if self._answer is None:
            return "no answer"
        return Result(self._answer).name.lower() if self._answer in set(Result) else f"result {self._answer}"
