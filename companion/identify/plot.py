"""Picture: measured against fitted angle, one panel a manoeuvre, one row an axis."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np

from companion.identify.fit import error
from companion.identify.identification import AxisIdentification, Identification
from companion.identify.manoeuvres import Manoeuvre

_COLUMNS: Final = 6  # the first so many manoeuvres of an axis are drawn
_SETPOINT: Final = "#9a9a9a"
_MEASURED: Final = "#1a1a1a"
_FITTED: Final = "#d1495b"


def plot(identification: Identification, path: Path) -> None:
    """Draw every axis into a PNG file. Raises `OSError` or `ValueError` when it cannot be written."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg  # noqa: PLC0415
    from matplotlib.figure import Figure  # noqa: PLC0415

    rows = len(identification.axes)
    columns = min(max(len(a.manoeuvres) for a in identification.axes.values()), _COLUMNS)
    figure = Figure(figsize=(max(3.1 * columns, 7.5), 2.5 * rows + 1.1), dpi=150, layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(rows, columns, sharex=True, sharey="row", squeeze=False)
    for row, (name, axis) in zip(panels, identification.axes.items(), strict=True):
        for panel, manoeuvre in zip(row, axis.manoeuvres, strict=False):
            _draw(panel, axis, manoeuvre)
        for panel in row[len(axis.manoeuvres) :]:
            panel.set_visible(False)
        row[0].set_ylabel(f"{name} (deg)")
    for panel in panels[-1]:
        panel.set_xlabel("time from its start (s)")
    figure.suptitle(_title(identification), fontsize=11)
    handles, labels = panels[0][0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False, fontsize=9)
    figure.savefig(path)


def _title(identification: Identification) -> str:
    worst = min(axis.chosen.fit for axis in identification.axes.values())
    titles = sorted({axis.chosen.model.title for axis in identification.axes.values()})
    names = ", ".join(path.name for path in identification.paths)
    return f"A {' / '.join(titles)} follows what was flown: fit at least {worst:.3f}  ({names})"


def _draw(panel: Any, axis: AxisIdentification, manoeuvre: Manoeuvre) -> None:
    start = manoeuvre.start_s
    missed = error(axis.chosen.model, np.array(axis.chosen.values), manoeuvre)
    begin = np.searchsorted(manoeuvre.setpoint_time_s, start, side="right") - 1
    times = np.append(np.maximum(manoeuvre.setpoint_time_s[max(begin, 0) :], start), manoeuvre.end_s)
    held = np.append(manoeuvre.setpoint_rad[max(begin, 0) :], manoeuvre.setpoint_rad[-1])
    panel.step(times - start, np.degrees(held), where="post", color=_SETPOINT, linewidth=1.0, label="set-point")
    panel.plot(
        manoeuvre.time_s - start,
        np.degrees(manoeuvre.measured_rad),
        color=_MEASURED,
        linewidth=2.2,
        alpha=0.8,
        label="measured",
    )
    panel.plot(
        manoeuvre.time_s - start,
        np.degrees(manoeuvre.measured_rad - missed),
        "--",
        color=_FITTED,
        linewidth=1.6,
        label=f"fitted: {axis.chosen.model.title}",
    )
    root = np.degrees(np.sqrt(np.mean(missed**2)))
    panel.set_title(f"at {start:.1f} s, error {root:.2f} deg RMS", fontsize=9)
    panel.grid(alpha=0.3)
    panel.spines[["top", "right"]].set_visible(False)
