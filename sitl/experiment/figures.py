"""The paper's figures from our flights: one PNG a figure, and one that sets both controllers side by side."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt

from companion.config import Config
from companion.record.reader import Flight
from sitl.experiment.figure_style import BLUE, CONTROLLERS, GREEN, RED, STYLE
from sitl.metrics import in_control, tracking_error_m

_COMMAND, _IDEAL, _HEDGED, _MEASURED = "0.55", BLUE, GREEN, RED
TITLES = {"hedged": "Proposed (hedged MRAC)", "standard": "Standard MRAC"}


def _drawn(flight: Flight) -> npt.NDArray[Any]:
    ticks = in_control(flight)
    return ticks[:: max(1, len(ticks) // 8000)]  # more points than pixels only make the file large


def _position(axes: Any, ticks: npt.NDArray[Any], axis: int, *, hedged: bool) -> None:
    t = ticks["time_s"] - ticks["time_s"][0]
    axes.plot(t, ticks["command_m"][:, axis], color=_COMMAND, lw=1.2, ls="--", label="set-point")
    axes.plot(t, ticks["ideal_position_m"][:, axis], color=_IDEAL, lw=1.6, label="ideal reference")
    if hedged:
        axes.plot(t, ticks["reference_position_m"][:, axis], color=_HEDGED, lw=1.6, ls="-.", label="hedged reference")
    axes.plot(t, ticks["position_m"][:, axis], color=_MEASURED, lw=1.3, label="vehicle")


def draw_axis(flight: Flight, axis: int, controller: str, name: str, path: Path, *, with_velocity: bool) -> None:
    """One axis (0 is x, 1 is y) of one flight: position, velocity where asked, and the actuator against its command."""
    ticks = _drawn(flight)
    t = ticks["time_s"] - ticks["time_s"][0]
    hedged, letter = controller == "hedged", "xy"[axis]
    with plt.rc_context(STYLE):
        figure, panels = plt.subplots(
            3 if with_velocity else 2, 1, sharex=True, figsize=(9, 7 if with_velocity else 5.6)
        )
        _position(panels[0], ticks, axis, hedged=hedged)
        panels[0].set_ylabel(f"position {letter} [m]")
        panels[0].legend(loc="best", fontsize=9)
        if with_velocity:
            panels[1].plot(t, ticks["ideal_velocity_m_s"][:, axis], color=_IDEAL, lw=1.4)
            if hedged:
                panels[1].plot(t, ticks["reference_velocity_m_s"][:, axis], color=_HEDGED, lw=1.4, ls="-.")
            panels[1].plot(t, ticks["velocity_m_s"][:, axis], color=_MEASURED, lw=1.2)
            panels[1].set_ylabel(f"velocity {letter} [m/s]")
        angle = "pitch" if axis == 0 else "roll"
        sign = -1.0 if axis == 0 else 1.0  # u and w are specific forces over g; pitch is minus the one along x
        degrees = [np.degrees(np.arctan(sign * ticks[key][:, axis])) for key in ("control", "actuator")]
        panels[-1].plot(t, degrees[0], color=_COMMAND, lw=1.0, label=f"{angle} commanded")
        panels[-1].plot(t, degrees[1], color=_MEASURED, lw=1.2, label=f"{angle} measured")
        panels[-1].set_ylabel(f"{angle} [deg]")
        panels[-1].margins(y=0.3)  # room for the legend
        panels[-1].legend(loc="upper left", ncols=2, fontsize=9)
        panels[-1].set_xlabel("time [s]")
        panels[0].set_title(f"{name}: {TITLES[controller]}, {letter} direction")
        figure.tight_layout()
        figure.savefig(path)
        plt.close(figure)


def draw_comparison(flights: dict[str, Flight], config: Config, path: Path) -> None:
    """Both controllers over the same stairs: x position, and the tracking error of (26) or (29)."""
    with plt.rc_context(STYLE):
        figure, (above, below) = plt.subplots(2, 1, sharex=True, figsize=(9, 6))
        for controller, flight in flights.items():
            ticks = _drawn(flight)
            t = ticks["time_s"] - ticks["time_s"][0]
            if controller == next(iter(flights)):
                above.plot(t, ticks["command_m"][:, 0], color=_COMMAND, lw=1.2, ls="--", label="set-point")
                above.plot(t, ticks["ideal_position_m"][:, 0], color=_IDEAL, lw=1.6, label="ideal reference")
            error = ticks["position_m"] - ticks["ideal_position_m"]
            distance = np.abs(error[:, 0]) if config.vehicle_kind.one_axis else np.hypot(error[:, 0], error[:, 1])
            label = f"{TITLES[controller]}: RMS {1e3 * np.sqrt(np.mean(distance**2)):.1f} mm"
            above.plot(t, ticks["position_m"][:, 0], color=CONTROLLERS[controller], lw=1.3, label=TITLES[controller])
            below.plot(t, 1e3 * distance, color=CONTROLLERS[controller], lw=1.3, label=label)
        above.set_ylabel("position x [m]")
        below.set_ylabel("tracking error [mm]")
        below.set_xlabel("time [s]")
        above.legend(loc="best", fontsize=9)
        below.set_ylim(0.0, 1.3 * below.get_ylim()[1])  # room for the legend
        below.legend(loc="upper right", fontsize=9)
        above.set_title("Same slow attitude loop, same stairs: hedging tracks better")
        figure.tight_layout()
        figure.savefig(path)
        plt.close(figure)


def draw_free_flight(flights: dict[str, Flight], config: Config, path: Path) -> None:
    """North, east and altitude against the target, and the tracking error in space, of every controller."""
    with plt.rc_context(STYLE):
        figure, panels = plt.subplots(4, 1, sharex=True, figsize=(9, 9))
        for controller, flight in flights.items():
            ticks = _drawn(flight)
            t = ticks["time_s"] - ticks["time_s"][0]
            for place, (panel, sign) in enumerate(zip(panels[:3], (1.0, 1.0, -1.0), strict=True)):
                if controller == next(iter(flights)):
                    panel.plot(
                        t, sign * ticks["target_ned_m"][:, place], color=_COMMAND, lw=1.2, ls="--", label="target"
                    )
                panel.plot(
                    t, sign * ticks["position_ned_m"][:, place], color=CONTROLLERS[controller], lw=1.3,
                    label=TITLES[controller],
                )  # fmt: skip
            distance = tracking_error_m(config, ticks)
            label = f"{TITLES[controller]}: RMS {1e3 * np.sqrt(np.mean(distance**2)):.0f} mm"
            panels[3].plot(t, 1e3 * distance, color=CONTROLLERS[controller], lw=1.3, label=label)
        for panel, text in zip(
            panels, ("north [m]", "east [m]", "altitude [m]", "off its reference [mm]"), strict=True
        ):
            panel.set_ylabel(text)
        panels[0].legend(loc="upper right", fontsize=9)
        panels[3].set_ylim(0.0, 1.35 * panels[3].get_ylim()[1])  # room for the legend
        panels[3].legend(loc="upper right", fontsize=9, ncols=2)
        panels[3].set_xlabel("time [s]")
        panels[0].set_title("Free flight: the same mission, wind and load for both controllers")
        figure.tight_layout()
        figure.savefig(path)
        plt.close(figure)


def draw_figures(config: Config, flights: dict[str, Flight], folder: Path) -> list[Path]:
    """Every figure of the paper that the config names, and one of both controllers. Returns the paths written."""
    paths = []
    for key, name in (config.paper.figures if config.paper else {}).items():
        controller, _, letter = key.rpartition("_")
        if controller in flights:
            path = folder / f"{name.lower().replace(' ', '_')}.png"
            with_velocity = not config.vehicle_kind.one_axis
            draw_axis(flights[controller], "xy".index(letter), controller, name, path, with_velocity=with_velocity)
            paths.append(path)
    if flights and config.controller.anchor == "setpoint":  # its control frame moves: NED is what shows a flight
        path = folder / "free_flight.png"
        draw_free_flight(flights, config, path)
        paths.append(path)
    elif len(flights) > 1:
        path = folder / "comparison.png"
        draw_comparison(flights, config, path)
        paths.append(path)
    return paths
