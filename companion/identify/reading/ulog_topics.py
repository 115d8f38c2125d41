"""Topics of a ULog with their times in order; a topic or field that is missing is named."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from companion.identify.reading import samples
from companion.identify.reading.ulog_file import Array, Topic, UlogFile
from companion.identify.series import Floats, LogError, ordered

_AFTER_S = 60.0  # a sample later than the attitude's last by more has no time


class UlogTopics:
    """What is whole and in order of the topics of one log. `notes` takes a line for what had to be dropped."""

    def __init__(self, path: Path, file: UlogFile, notes: list[str]) -> None:
        self._path, self._topics, self._notes = path, file.topics, notes
        self._end_s = np.inf
        self._indices: dict[str, Array] = {}
        self._times: dict[str, Floats] = {}

    def ends(self, time_s: float) -> None:
        """Say when the log ends: what comes long after it is no sample of it."""
        self._end_s = time_s + _AFTER_S

    def __contains__(self, name: str) -> bool:
        return name in self._topics

    def times(self, name: str) -> Floats:
        """Rising, in s; shape (n,)."""
        self._kept(name)
        return self._times[name]

    def places(self, name: str) -> Array:
        """Where the samples stand in the file, shape (n,)."""
        return self._topics[name].places[self._kept(name)]

    def has(self, name: str, *fields: str) -> bool:
        """Whether all of these fields were logged."""
        return name in self._topics and all(field in self._topics[name] for field in fields)

    def column(self, name: str, field: str, width: int | None = 0) -> Array:
        """One field, shape (n,) or (n, width); None: of any width. Raises `LogError` for one that was not logged so."""
        topic = self._topic(name)
        if field not in topic:
            raise LogError(
                f"{self._path}: no field {name}.{field} in it (the messages of another firmware?): it cannot be told "
                "without it"
            )
        values = topic[field]
        if width is not None and values.shape[1:] != ((width,) if width else ()):
            raise LogError(f"{self._path}: {name}.{field} is not of {width or 1} values as in PX4")
        return values[self._kept(name)]

    def rotations(self, name: str, field: str) -> tuple[Floats, Array, Array]:
        """Times, quaternions, shape (n, 4), and places of the samples whose quaternion is a rotation."""
        q = self.column(name, field, 4)
        good = samples.rotations(q)
        if not good.all():
            self._notes.append(
                f"{(~good).sum()} of {len(q)} samples dropped: {name}.{field} is not a number or no rotation"
            )
        return self.times(name)[good], q[good], self.places(name)[good]

    def _topic(self, name: str) -> Topic:
        if name not in self._topics:
            raise LogError(f"{self._path}: no {name} in it: it cannot be told without it: log it")
        return self._topics[name]

    def _kept(self, name: str) -> Array:
        if name not in self._indices:
            time_s = self._topic(name)["timestamp"].astype(np.float64) * 1e-6
            self._indices[name] = kept = ordered(self._path, time_s, name, self._notes, end_s=self._end_s)
            self._times[name] = time_s[kept]
        return self._indices[name]
