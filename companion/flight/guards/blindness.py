"""What a guard looks at may stop coming, and a last value that stays would look healthy for ever.

Each source has an age at which what it told is forgotten; it stands in the guard's row. A guard that could see and
cannot any more says so once; where it is the estimator that no longer answers for itself, control ends.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import NamedTuple

from companion.config.guards.rows import GUARDS, Reason
from companion.config.schema import Config
from companion.flight.guards.look import Told
from companion.flight.guards.measures import MEASURES
from companion.flight.guards.table import Limits


class GoneBlind(NamedTuple):
    """A guard that could see and cannot any more; `ends_control`, why control is to end, if it is."""

    reason: Reason
    text: str
    ends_control: str | None


class Blindness:
    """Which guards cannot see.

    `forget`, by guard: make a source forget what it told before a time. Where a source has no memory of its own, the
    age counts from when the guard could last see.
    """

    def __init__(self, config: Config, limits: Limits, forget: Mapping[Reason, Callable[[float], None]]) -> None:
        self._config = config
        self._forget = forget
        self._can_be = {
            reason: (measured.blind, row)
            for reason, measured in MEASURES.items()
            if measured.blind is not None and (row := GUARDS[reason].row.blind) and math.isfinite(limits[reason])
        }
        self._seen_s = dict.fromkeys(self._can_be, -math.inf)
        self._known: set[Reason] = set()
        self._told: set[Reason] = set()

    def settle(self, told: Told) -> list[str]:
        """At stand-by: what cannot be seen, for the pilot. It is not missed later, until it has been seen."""
        self._known = {reason for reason, (blind, _) in self._can_be.items() if blind(self._config, told)}
        return [_text(reason) for reason in self._can_be if reason in self._known]

    def forget(self, now_s: float) -> None:
        """Let every source forget what is too old."""
        for reason, forget in self._forget.items():
            row = GUARDS[reason].row.blind
            if row is not None and row.age_s is not None:
                forget(now_s - row.age_s)

    def look(self, told: Told, now_s: float, *, ready: bool) -> list[GoneBlind]:
        """Which guards have gone blind. `ready`: at stand-by or in control; before, nothing is missed."""
        gone = []
        for reason, (blind, row) in self._can_be.items():
            if row.age_s is None:
                continue
            if not (ready and blind(self._config, told)):
                self._seen_s[reason] = now_s
                if ready:
                    self._known.discard(reason)
            elif reason not in self._forget and now_s - self._seen_s[reason] <= row.age_s:
                continue  # one message without it is nothing
            elif reason not in self._known and reason not in self._told:
                self._told.add(reason)
                ends = None if row.ends_control is None else f"{row.ends_control} for {row.age_s:g} s"
                gone.append(GoneBlind(reason, _text(reason), ends))
        return gone


def _text(reason: Reason) -> str:
    """For the screen, the log and the ground station."""
    key, _, row = GUARDS[reason]
    return f"guard cannot see: {key} ({row.blind.why if row.blind else ''})"
