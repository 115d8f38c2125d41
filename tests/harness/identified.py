"""What `companion identify` makes of a log: its numbers or its one line, and whether they can be believed."""

from __future__ import annotations

from pathlib import Path

from companion.identify.identification import Identification, identify_log
from companion.identify.series import LogError


def outcome(path: Path) -> Identification | str:
    """The numbers, or the line that says why there are none."""
    try:
        return identify_log([path])
    except LogError as error:
        return str(error)


def complaints(path: Path, found: Identification | str, clean: Identification) -> list[str]:
    """What is wrong with an outcome: a message of more than a line, or a number that is not that of the clean log.

    The numbers of the clean log must be inside the intervals given, or those given inside the clean log's.
    """
    if isinstance(found, str):
        whole = found.startswith(str(path)) and len(found.splitlines()) == 1
        return [] if whole else [f"no line that names the file: {found!r}"]
    wrong = [f"a note of more than a line: {note!r}" for note in found.notes if len(note.splitlines()) != 1]
    for axis, identified in found.axes.items():
        known = clean.axes[axis].models[identified.chosen.model.name]
        for name, value, ends, of_clean, clean_ends in zip(
            known.model.parameters,
            identified.chosen.values,
            identified.chosen.interval_95,
            known.values,
            known.interval_95,
            strict=True,
        ):
            if not (ends[0] <= of_clean <= ends[1] or clean_ends[0] <= value <= clean_ends[1]):
                wrong.append(f"{axis} {name}: {value:.4g} in {ends}, of the clean log {of_clean:.4g} in {clean_ends}")
    return wrong
