"""How an autopilot takes a request: at once, late, never, or only in words."""

from __future__ import annotations

from enum import Enum, auto
from typing import NamedTuple

from sitl.autopilot.modes import FlightMode


class Answer(Enum):
    """What becomes of a request for a mode, or to arm."""

    REFUSED = auto()  # a denial, and nothing is done
    EMPTY = auto()  # acceptance, and nothing is done
    LATE = auto()  # acceptance, and it is done later


class Pending(NamedTuple):
    """A mode that is to follow."""

    due_us: int
    mode: FlightMode


class RequestFaults:
    """What an autopilot does with requests that a healthy one would grant.

    Attributes: `answers` by mode, `arming` for arming; the rest is decided as ever. `late_us` of the late ones.
    `requests`, every mode asked for so far.
    """

    def __init__(self) -> None:
        self.answers: dict[FlightMode, Answer] = {}
        self.arming: Answer | None = None
        self.late_us = 1_000_000
        self.requests: list[FlightMode] = []
        self._pending: list[Pending] = []

    def asked(self, mode: FlightMode, now_us: int) -> Answer | None:
        """A request for a mode; what becomes of it, `None` where the commander is to decide."""
        self.requests.append(mode)
        answer = self.answers.get(mode)
        if answer is Answer.LATE:
            self._pending.append(Pending(now_us + self.late_us, mode))
        return answer

    def due(self, now_us: int) -> list[FlightMode]:
        """The modes whose time has come."""
        due = [pending.mode for pending in self._pending if pending.due_us <= now_us]
        self._pending = [pending for pending in self._pending if pending.due_us > now_us]
        return due
