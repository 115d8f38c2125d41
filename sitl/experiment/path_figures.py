"""Figures of flights along a trajectory: the path from above, and the distance from it over time and over speed."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt

from sitl.experiment.against import TITLES, Track
from sitl.experiment.figure_style import CONTROLLERS, STYLE

_BINS: Final = 8


def draw_path_figures(tracks: dict[str, Track], folder: Path) -> list[Path]:
    """All three, by the truth. Returns the paths written; none without a flight."""
    if not tracks:
        return []
    written = []
    with plt.rc_context(STYLE):
        for name, draw, size in (
            ("path_from_above", _from_above, (9.0, 4.4)),
            ("error_over_time", _over_time, (9.0, 4.5)),
            ("error_over_speed", _over_speed, (9.0, 4.5)),
        ):
            figure, axes = plt.subplots(figsize=size)
            draw(axes, tracks)
            figure.tight_layout()
            written.append(folder / f"{name}.png")
            figure.savefig(written[-1])
            plt.close(figure)
    return written


def _error_m(track: Track) -> npt.NDArray[np.float64]:
    """Horizontal distance of the vehicle from where it is wanted."""
    off = track.truth_ned_m - track.wanted_ned_m
    return np.asarray(np.hypot(off[:, 0], off[:, 1]))


def _moving(track: Track) -> slice:
    moving = np.flatnonzero(track.wanted_speed_m_s > 0.0)
    return slice(moving[0], moving[-1] + 1) if len(moving) else slice(None)


def _from_above(axes: Any, tracks: dict[str, Track]) -> None:
    first = next(iter(tracks.values()))
    wanted = first.wanted_ned_m[_moving(first)] - first.wanted_ned_m[0]
    axes.plot(wanted[:, 0], wanted[:, 1], color="0.75", lw=6.0, solid_capstyle="round", label="trajectory")
    for controller, track in reversed(tracks.items()):  # ours on top
        at = track.truth_ned_m[_moving(track)] - track.wanted_ned_m[0]
        axes.plot(at[:, 0], at[:, 1], color=CONTROLLERS[controller], lw=1.1, alpha=0.85, label=TITLES[controller])
    axes.set_aspect("equal")
    axes.set_xlabel("north [m]")
    axes.set_ylabel("east [m]")
    axes.set_title("The path from above, by the truth")
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=9)


def _over_time(axes: Any, tracks: dict[str, Track]) -> None:
    for controller, track in tracks.items():
        error = _error_m(track)
        rms = np.sqrt(np.mean(error[_moving(track)] ** 2))
        label = f"{TITLES[controller]}: RMS {rms:.3f} m"
        axes.plot(track.time_s, error, color=CONTROLLERS[controller], lw=1.2, label=label)
    axes.set_xlabel("time in control [s]")
    axes.set_ylabel("distance from the trajectory [m]")
    axes.set_ylim(0.0, 1.25 * axes.get_ylim()[1])  # room for the legend
    axes.set_title("Distance over time, by the truth; RMS while the trajectory moves")
    axes.legend(loc="upper right", ncols=len(tracks), fontsize=9)


def _over_speed(axes: Any, tracks: dict[str, Track]) -> None:
    """RMS of the distance in classes of the speed wanted."""
    for controller, track in tracks.items():
        part = _moving(track)
        speed, error = track.wanted_speed_m_s[part], _error_m(track)[part]
        edges = np.linspace(0.0, speed.max() * (1.0 + 1e-9), _BINS + 1)
        places = np.clip(np.digitize(speed, edges) - 1, 0, _BINS - 1)
        known = [k for k in range(_BINS) if np.any(places == k)]
        rms = [float(np.sqrt(np.mean(error[places == k] ** 2))) for k in known]
        middle = [0.5 * (edges[k] + edges[k + 1]) for k in known]
        axes.plot(middle, rms, "o-", color=CONTROLLERS[controller], lw=1.4, label=TITLES[controller])
    axes.set_xlabel("speed of the trajectory [m/s]")
    axes.set_ylabel("RMS distance [m]")
    axes.set_ylim(bottom=0.0)
    axes.set_title("Distance over speed, by the truth")
    axes.legend(loc="best", fontsize=9)
