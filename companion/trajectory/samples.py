"""A trajectory from a table of samples: CSV, or Parquet where pyarrow is installed.

Columns: `time_s`, `x_m`, `y_m`, `z_m` (north, east, down); `vx_m_s` ... `az_m_s2`, all six or none; `yaw_deg`. With
velocities and accelerations the way between two samples is the polynomial of degree 5 that both have; with positions
alone it is the smoothest way through all of them (`minimum_snap`), its ends free.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Final

from companion.trajectory.polynomial import Piece, Piecewise, quintic
from companion.trajectory.waypoints import piecewise

_PLACES: Final = ("time_s", "x_m", "y_m", "z_m")
_MOTION: Final = ("vx_m_s", "vy_m_s", "vz_m_s", "ax_m_s2", "ay_m_s2", "az_m_s2")
_YAW: Final = "yaw_deg"
_MOST: Final = 100_000

Table = Mapping[str, Sequence[float]]


def read_samples(path: Path, *, along_path: bool = False) -> Piecewise:
    """The trajectory of a file, its time counted from its first sample. Raises `ValueError`, one line."""
    table = _parquet(path) if path.suffix.lower() == ".parquet" else _csv(path)
    try:
        return from_table(table, along_path=along_path)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def from_table(table: Table, *, along_path: bool = False) -> Piecewise:
    """The trajectory through the samples of a table. Raises `ValueError`."""
    unknown = sorted(set(table) - {*_PLACES, *_MOTION, _YAW})
    missing = [name for name in _PLACES if name not in table]
    motion = [name for name in _MOTION if name in table]
    if unknown:
        raise ValueError(f"unknown column {unknown[0]!r}: there are {', '.join((*_PLACES, *_MOTION, _YAW))}")
    if missing:
        raise ValueError(f"no column {missing[0]!r}")
    if motion and len(motion) < len(_MOTION):
        raise ValueError(f"{motion[0]!r} without {next(n for n in _MOTION if n not in table)!r}: all six, or none")
    times = table["time_s"]
    if len(times) < 2:
        raise ValueError("fewer than two samples")
    if not motion and len(times) < 4:
        raise ValueError("fewer than four samples: without velocities and accelerations they say too little")
    if len(times) > _MOST:
        raise ValueError(f"more than {_MOST} samples")
    for number, row in enumerate(zip(*table.values(), strict=True), 1):
        if not all(map(math.isfinite, row)):
            raise ValueError(f"sample {number} holds what is no finite number")
    for number, (before, now) in enumerate(pairwise(times), 2):
        if now - before < 1e-4:
            raise ValueError(f"sample {number} at {now:g} s does not come after the one before, at {before:g} s")
    durations = [now - before for before, now in pairwise(times)]
    turns = [math.radians(value) for value in table[_YAW]] if _YAW in table else [0.0] * len(times)
    places = list(zip(table["x_m"], table["y_m"], table["z_m"], turns, strict=True))
    if not motion:
        return piecewise(places, durations, along_path=along_path, at_rest=False)
    states = [
        [(table[f"{c}_m"][k], table[f"v{c}_m_s"][k], table[f"a{c}_m_s2"][k]) for c in "xyz"] for k in range(len(times))
    ]
    pieces = []
    for t, (begin, end), (turn, to) in zip(durations, pairwise(states), pairwise(turns), strict=True):
        north, east, down = (quintic(a, b, t) for a, b in zip(begin, end, strict=True))
        pieces.append(Piece(t, north, east, down, _short(turn, to)))
    return Piecewise(tuple(pieces), along_path)


def _short(turn: float, to: float) -> tuple[float, float]:
    return turn, turn + math.atan2(math.sin(to - turn), math.cos(to - turn))


def _csv(path: Path) -> Table:
    try:
        with path.open(encoding="utf-8", newline="") as stream:
            rows = [row for row in csv.reader(stream) if row]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ValueError(f"{path}: {_reason(error)}") from None
    if not rows:
        raise ValueError(f"{path}: empty")
    names = [name.strip() for name in rows[0]]
    if len(set(names)) < len(names):
        raise ValueError(f"{path}: a column is there twice")
    columns: dict[str, list[float]] = {name: [] for name in names}
    for number, row in enumerate(rows[1:], 2):
        if len(row) != len(names):
            raise ValueError(f"{path}: row {number} has {len(row)} values for {len(names)} columns")
        for name, text in zip(names, row, strict=True):
            try:
                columns[name].append(float(text))
            except ValueError:
                raise ValueError(f"{path}: row {number}, {name}: {text!r} is not a number") from None
    return columns


def _parquet(path: Path) -> Table:
    try:
        import pyarrow  # noqa: PLC0415 - an extra
        from pyarrow import parquet  # noqa: PLC0415
    except ImportError:
        raise ValueError(
            f"{path}: Parquet needs pyarrow: pip install 'companion[parquet]', or write it as CSV"
        ) from None
    try:
        columns = parquet.read_table(path).to_pydict()
    except (OSError, pyarrow.ArrowException) as error:
        raise ValueError(f"{path}: {_reason(error)}") from None
    for name, values in columns.items():
        if not all(isinstance(value, int | float) for value in values):
            raise ValueError(f"{path}: column {name!r} holds what is not a number")
    return {name: [float(value) for value in values] for name, values in columns.items()}


def _reason(error: Exception) -> str:
    """In one line."""
    if isinstance(error, FileNotFoundError):
        return "no such file"
    text = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
    return "not a text file" if isinstance(error, UnicodeDecodeError) else (text.splitlines() or ["unreadable"])[0]
