"""`--engage`: arm, take off where the vehicle can, and ask for OFFBOARD; each step believed only when it is seen."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import development as mavlink

from companion.mavlink import px4
from companion.mavlink.px4 import Mode

_RETRY_S = 0.5


class Seen(NamedTuple):
    """What of the vehicle the sequence looks at."""

    mode: int
    armed: bool
    speed_m_s: float
    climbed_m: float


class Step(NamedTuple):
    """One request, when it is fulfilled, and how long that may take."""

    name: str
    request: Any | None
    acknowledged_as: int
    fulfilled: Callable[[Seen], bool]
    timeout_s: float


def plan(system_id: int, component_id: int, *, can_fly: bool) -> list[Step]:
    """The steps for a vehicle that can take off, or for a rig that cannot."""
    do_set_mode = mavlink.MAV_CMD_DO_SET_MODE
    arm = Step(
        "arm", px4.arm(system_id, component_id), mavlink.MAV_CMD_COMPONENT_ARM_DISARM, lambda seen: seen.armed, 5.0
    )
    offboard = Step(
        "OFFBOARD",
        px4.set_mode(system_id, component_id, Mode.OFFBOARD),
        do_set_mode,
        lambda seen: seen.mode == Mode.OFFBOARD,
        5.0,
    )
    if not can_fly:
        return [arm, offboard]
    take_off = Step(
        "take-off",
        px4.set_mode(system_id, component_id, Mode.TAKEOFF),
        do_set_mode,
        lambda seen: seen.mode == Mode.TAKEOFF,
        5.0,
    )
    hover = Step(
        "hover",
        None,
        0,
        lambda seen: seen.mode == Mode.HOLD and seen.climbed_m > 0.3 and seen.speed_m_s < 0.05,
        40.0,
    )
    return [arm, take_off, hover, offboard]


class Engagement:
    """Walks through the steps: what to send now, and whether one has failed."""

    def __init__(self, steps: list[Step]) -> None:
        self._steps = steps
        self._begun_s: float | None = None
        self._asked_s = 0.0
        self._answer = "no answer"

    def acknowledged(self, command: int, result: int) -> None:
        """A COMMAND_ACK: kept for the refusal's text. Acceptance is never believed: only what is seen counts."""
        if self._steps and command == self._steps[0].acknowledged_as and result != px4.Result.ACCEPTED:
            self._answer = px4.Result(result).name.lower() if result <= px4.Result.CANCELLED else f"result {result}"

    def advance(self, now_s: float, seen: Seen) -> tuple[Any | None, str | None]:
        """(message to send now, why the sequence has failed); both None while it waits or when it is done."""
        while self._steps and self._steps[0].fulfilled(seen):
            self._steps.pop(0)
            self._begun_s = None
        if not self._steps:
            return None, None
        step = self._steps[0]
        if self._begun_s is None:
            self._begun_s, self._asked_s, self._answer = now_s, now_s, "no answer"
            return step.request, None
        if now_s - self._begun_s > step.timeout_s:
            return None, f"{step.name} within {step.timeout_s:g} s: {self._answer}"
        if step.request is not None and now_s - self._asked_s >= _RETRY_S:
            self._asked_s = now_s
            return step.request, None
        return None, None
