"""Picture of a comparison: a row an axis, the step responses before and after, and both bandwidths with intervals."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np

from companion.attitude_response.simulation import respond
from companion.identify.comparison.compare import AxisComparison, Comparison
from companion.identify.fit import ModelFit
from companion.identify.identification import Identification

_BEFORE: Final = ("#0072b2", "--", "o", "before")  # Okabe and Ito's blue and orange: told apart by any eye, and in grey
_AFTER: Final = ("#d55e00", "-", "s", "after")
_SHOWN_S: Final = 1.2
_BEGINS_S: Final = 0.1


def plot_comparison(comparison: Comparison, before: Identification, after: Identification, path: Path) -> None:
    """Draw into a PNG file. Raises `OSError` or `ValueError` when it cannot be written."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg  # noqa: PLC0415
    from matplotlib.figure import Figure  # noqa: PLC0415

    rows = len(comparison.axes)
    figure = Figure(figsize=(9.0, 2.9 * rows + 0.9), dpi=150, layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(rows, 2, squeeze=False, sharex="col", width_ratios=(3, 2))
    for (steps, bands), (name, axis) in zip(panels, comparison.axes.items(), strict=True):
        fits = [found.axes[name].models[axis.model] for found in (before, after)]
        _draw_steps(steps, name, fits)
        _draw_bandwidths(bands, axis)
    panels[-1][0].set_xlabel("time after the set-point's step (s)")
    panels[-1][1].set_xlabel("bandwidth, -3 dB (rad/s)")
    names = [", ".join(path.name for path in found.paths) for found in (before, after)]
    figure.suptitle(f"Attitude response: {names[0]} (before), {names[1]} (after)", fontsize=11)
    handles, labels = panels[0][0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False, fontsize=9)
    figure.savefig(path)


def _draw_steps(panel: Any, name: str, fits: list[ModelFit]) -> None:
    time_s = np.linspace(-_BEGINS_S, _SHOWN_S, 600)
    setpoint_s, setpoint = np.array([-1.0, 0.0]), np.array([0.0, 1.0])
    panel.step([-_BEGINS_S, 0.0, _SHOWN_S], [0.0, 1.0, 1.0], where="post", color="#9a9a9a", lw=1.0, label="set-point")
    for fit, (color, line, _, label) in zip(fits, (_BEFORE, _AFTER), strict=True):
        panel.plot(
            time_s, respond(fit.model, fit.values, setpoint_s, setpoint, time_s), line, color=color, lw=2.0, label=label
        )
    panel.set_ylabel(f"{name}, share of the step (1)")
    panel.grid(alpha=0.3)
    panel.spines[["top", "right"]].set_visible(False)


def _draw_bandwidths(panel: Any, axis: AxisComparison) -> None:
    for height, found, (color, _, marker, label) in ((1, axis.before, _BEFORE), (0, axis.after, _AFTER)):
        low, high = found.interval_rad_s
        middle = found.bandwidth_rad_s
        panel.errorbar(
            [middle], [height], xerr=[[middle - low], [high - middle]], fmt=marker, color=color, capsize=5, lw=2.0
        )
        panel.annotate(label, (middle, height), xytext=(0, 9), textcoords="offset points", ha="center", fontsize=9)
    panel.set_yticks([])
    panel.set_ylim(-0.6, 1.6)
    panel.set_title(f"{axis.verdict}, {100.0 * (axis.ratio - 1.0):+.1f} %; bars: 95 %", fontsize=10)
    panel.grid(alpha=0.3, axis="x")
    panel.spines[["top", "right", "left"]].set_visible(False)
