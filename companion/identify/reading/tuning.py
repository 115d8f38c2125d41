"""The parameters that were in force while an axis was excited: those of the header may have been changed since."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Final

import numpy as np

from companion.identify import clock
from companion.identify.series import GAINS, OURS, ClockMap, LogError, ParameterValue, Recording

_OTHERS: Final = {"roll": "PITCH", "pitch": "ROLL"}  # what the names of the other axis' parameters have in them


def at(tuning: Iterable[ParameterValue], time_s: float) -> dict[str, float]:
    """Every parameter that was known by then, at its latest value."""
    known = {p.name: p.value for p in tuning if p.time_s <= time_s}
    return {name: known[name] for name in GAINS if name in known}


def in_force(
    axis: str,
    stretches: Iterable[tuple[Recording, float, float]],
    views: Mapping[Path, tuple[ClockMap, Recording | None]],
) -> dict[str, float]:
    """The gains of an axis while it was excited.

    Parameters
    ----------
    axis
        "roll" or "pitch".
    stretches
        Recording, start and end of each in s, in the clock of its track.
    views
        By a recording's path how to see it in another clock, and the log of the same flight in that.

    Raises
    ------
    LogError
        One line, for stretches that were not all flown with one tuning.
    """
    found: dict[str, tuple[ParameterValue, Recording]] = {}
    for recording, start_s, end_s in stretches:
        _take(axis, recording, start_s, end_s, found)
        applied, log = views.get(recording.path, (None, None))
        if applied is not None and log is not None:
            start, end = clock.to_vehicle(applied, np.array([start_s, end_s]))
            _take(axis, log, float(start), float(end), found)
    return {name: p.value for name, (p, _) in found.items()}


def _take(
    axis: str, recording: Recording, start_s: float, end_s: float, found: dict[str, tuple[ParameterValue, Recording]]
) -> None:
    for name in GAINS:
        if _OTHERS[axis] in name:
            continue
        changes = [p for p in recording.tuning if p.name == name and p.time_s < end_s]
        before = [p for p in changes if p.time_s <= start_s]
        for change in before[-1:] + changes[len(before) :]:
            known, where = found.setdefault(name, (change, recording))
            if known.value != change.value:
                raise LogError(_mixed(axis, known, where, change, recording))


def _mixed(axis: str, known: ParameterValue, where: Recording, change: ParameterValue, recording: Recording) -> str:
    old, new = (str(np.float32(p.value)) for p in (known, change))  # as many digits as it takes to tell them apart
    if where is not recording:
        return f"{recording.path}: {change.name} is {new}, in {where.path} it is {old}: give logs of one tuning"
    shown = "our clock, from the first record" if recording.track.clock == OURS else "vehicle's clock"
    return (
        f"{recording.path}: {change.name} was changed from {old} to {new} at {change.time_s:.2f} s ({shown}), among "
        f"the manoeuvres in {axis}: fly them all with one tuning"
    )
