"""What a row says of a reason to end control, and of a guard. The rows themselves stand in `config/guards/rows.py`."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import Final, NamedTuple, Self

_SI: Final = {"deg": math.pi / 180.0}  # of a unit; all others are ours already


class Group(StrEnum):
    """What a reason is about, for the reader of a table."""

    OVER = "Somebody else took it, or it was over"
    TOLD = "What the companion is told"
    ESTIMATOR = "Where the estimator thinks the vehicle is"
    FLIGHT = "How it flies"
    ITSELF = "The companion itself"
    NEVER_BEGAN = "Control never began (exit code 2)"


class ReasonRow(StrEnum):
    """A reason's row: its name, which is its value, and the attributes below."""

    group: Group
    meaning: str  # to the person who reads it on the screen or in the log
    look_at: str  # in a table; Markdown

    def __new__(cls, name: str, group: Group, meaning: str, look_at: str) -> Self:
        """Build a member from its row."""
        reason = str.__new__(cls, name)
        reason._value_ = name
        reason.group, reason.meaning, reason.look_at = group, meaning, look_at
        return reason


@dataclass(frozen=True)
class Blind:
    """How a guard goes blind: what it looks at is not told, or not modelled.

    `why`, for the pilot. `age_s`: how old what it looks at may get before it is forgotten, s; None where that is
    settled at stand-by. `ends_control`: why control ends when it goes blind in flight; None where it is only told.
    """

    why: str
    age_s: float | None = None
    ends_control: str | None = None


@dataclass(frozen=True)
class Row:
    """What of a guard stands beside its schema, its default and its description.

    `unit` of its limit, as its key ends. `least`: the limit is the least that may be, and not the most. `certified`:
    the certificate takes for granted what it watches.
    """

    reason: ReasonRow
    unit: str = ""
    blind: Blind | None = None
    least: bool = False
    certified: bool = False

    @property
    def scale(self) -> float:
        """The unit of its limit in ours."""
        return _SI.get(self.unit, 1.0)


class Guard(NamedTuple):
    """A guard as `Guards` declares it: its key there, what its limit is of, its row."""

    key: str
    about: str
    row: Row
