"""A flight in words: why it ended, what came near its limit, what to look at."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from companion.config import Config
from companion.config.guards.declaration import Group
from companion.config.guards.rows import GUARDS, Reason
from companion.report.guards import weights_on_bound
from companion.report.model import Array, Happened, Nearness

_NEAR = 0.5  # of a limit: worth a line
_RELEASED = "released_"
_OFTEN = 0.05  # share of the time that a weight may rest on its bound before it is told
_WORTH_TELLING = ("uncertified", "unwatched", "blind", "second_companion", "reseated", "parameter_changed", "traceback")

Paragraphs = tuple[tuple[str, tuple[str, ...]], ...]


def of_flight(
    events: Sequence[Happened],
    facts: Sequence[tuple[str, float, str]],
    guards: Sequence[Nearness],
    ticks: Array,
    config: Config,
) -> Paragraphs:
    """Paragraphs of (heading, lines). `ticks` are those in control."""
    reason, ended = _ending(events)
    return (
        ("Why it ended", ended),
        ("What came near its limit", _near(guards, reason)),
        ("What to look at", tuple(_look_at(reason, events, ticks, config))),
        ("In figures", tuple(f"{name}: {value:.3g} {unit}" for name, value, unit in facts)),
    )


def _ending(events: Sequence[Happened]) -> tuple[Reason | None, tuple[str, ...]]:
    released = next((event for event in events if event.name.startswith(_RELEASED)), None)
    if released is None:
        return None, ("No release is recorded: the log ends before control did, or control never began.",)
    name = released.name.removeprefix(_RELEASED)
    reason = next((reason for reason in Reason if reason.value == name), None)
    if reason is None:
        return None, (f"{name} at {released.time_s:.1f} s: {released.detail}",)
    kind = "Control never began" if reason.group is Group.NEVER_BEGAN else f"Control ended at {released.time_s:.1f} s"
    return reason, (f"{kind}: {released.detail or reason.meaning} ({name}).", f"Kind: {reason.group.value}.")


def _near(guards: Sequence[Nearness], reason: Reason | None) -> tuple[str, ...]:
    ended_by = GUARDS[reason].key if reason in GUARDS else None
    lines = [
        f"{near.guard}: {near.value:.3g} {near.unit} of {near.limit:.3g} ({near.share:.0%}) at {near.time_s:.1f} s"
        + (", for less than its timeout" if near.share > 1.0 and near.guard != ended_by else "")
        for near in guards
        if near.share >= _NEAR
    ]
    return tuple(lines) or (f"Nothing of what can be computed passed {_NEAR:.0%} of its limit.",)


def _look_at(reason: Reason | None, events: Sequence[Happened], ticks: Array, config: Config) -> list[str]:
    lines = [reason.look_at.replace("`", "")] if reason is not None and reason.look_at else []
    lines += [f"{event.name}: {event.detail}" for event in events if event.name in _WORTH_TELLING]
    if len(ticks):
        share = float(np.mean(weights_on_bound(config, ticks) > 0))
        if share > _OFTEN:
            lines.append(f"a weight rested on its bound in {share:.0%} of the time: load, wind, or a narrow box")
        limited = float(np.mean(ticks["limited"] > 0))
        if limited > _OFTEN:
            lines.append(f"tilt, thrust or acceleration limits cut the force in {limited:.0%} of the time")
    return lines or ["Nothing stands out."]
