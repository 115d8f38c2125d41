"""What `companion identify` says: the table, the sentences under it, and the machine-readable object."""

from __future__ import annotations

import math
from typing import Any, Final

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from companion.attitude_response.kinds import MODELS
from companion.identify.fit import ModelFit
from companion.identify.identification import MANOEUVRES, AxisIdentification, Identification
from companion.identify.series import OURS

_COLUMNS: Final = {"rad/s": (" rad/s", 1.0, 2, 2), "1": ("", 1.0, 2, 2), "s": (" ms", 1e3, 1, 0)}
"""By unit of a parameter: unit shown, its size, and decimals of value and of interval."""
_NEXT_LINE: Final = "\n"


def to_json(identification: Identification) -> dict[str, Any]:
    """The object that `--json` prints; numbers in SI, by the names of the config."""
    axes = {}
    for name, axis in identification.axes.items():
        axes[name] = {
            "chosen": axis.chosen.model.name,
            "models": {model: {**fit.named(), "fit": fit.fit} for model, fit in axis.models.items()},
            "interval_95": {key: list(ends) for key, ends in axis.chosen.intervals().items()},
            "method": axis.method,
            "manoeuvres": len(axis.manoeuvres),
            "gain": axis.gain,
            "setpoint_lateness_s": axis.lateness_s,
            "delay": None if axis.delay is None else axis.delay._asdict(),
        }
    return {
        "axes": axes,
        "refused": identification.refused,
        "logs": [str(path) for path in identification.paths],
        "system_id": identification.system_id,
        "clock": identification.clock,
        "gains": identification.gains,
        "px4_version": identification.px4_version,
        "warnings": warnings(identification),
    }


def fitted(axis: AxisIdentification) -> str:
    """What was fitted, in words."""
    number = len(axis.manoeuvres)
    if axis.method == MANOEUVRES:
        return f"{number} manoeuvres"
    flown_s = sum(m.end_s - m.start_s for m in axis.manoeuvres)
    return f"{number} stretches of any flight, {flown_s:.0f} s"


def warnings(identification: Identification) -> list[str]:
    """What a user must know before he believes the numbers."""
    lateness = max(axis.lateness_s for axis in identification.axes.values())
    if not lateness:
        return [*identification.notes]
    return [
        *identification.notes,
        f"This log keeps a set-point only every {1e3 * lateness:.0f} ms, so each was in force up to that long before: "
        f"the delay is a lower bound, the truth may be {1e3 * lateness:.0f} ms more and is likely half that. "
        "Give the tlog of the same flight, or log vehicle_attitude_setpoint at its full rate.",
    ]


def show(identification: Identification, console: Console) -> None:
    """Print tables and sentences."""
    for name, axis in identification.axes.items():
        console.print(_table(name, axis))
    ours = identification.clock == OURS
    what = "set-point sent to attitude received, our clock" if ours else "set-point logged to attitude, vehicle's clock"
    console.print(f"delay: {what}")
    console.print("fit: R², 1 - |error|² / |motion|²; unseen: error on one left out")
    if any(axis.method != MANOEUVRES for axis in identification.axes.values()):
        console.print("stretches: fitted with a model of what disturbs them, which is in their error too")
    for name, axis in identification.axes.items():
        if axis.delay is not None:
            total, own, link, low, high = (1e3 * v for v in (*axis.delay[:3], *axis.delay.link_95_s))
            console.print(
                f"{name}: {total:.1f} ms in all, the vehicle's own {own:.1f} ms, the link's both ways {link:.1f} ms "
                f"({low:.1f} to {high:.1f})"
            )
    if ours and not any(axis.delay for axis in identification.axes.values()):
        console.print("The link's share of the delay is not in this log: give the ULog of the same flight beside it.")
    for warning in warnings(identification):
        console.print(warning, style="yellow", markup=False, highlight=False, soft_wrap=True)


def _table(name: str, axis: AxisIdentification) -> Table:
    title = f"{name}, {fitted(axis)}; below each value its interval (95 %, all together)"
    table = Table(title=title, title_justify="left", box=SIMPLE_HEAD, pad_edge=False)
    table.add_column("model", no_wrap=True)
    for heading in (*map(_heading, _COLUMNS), "fit", "unseen °"):
        table.add_column(heading, justify="right", no_wrap=True)
    for fit in axis.models.values():
        taken = fit is axis.chosen
        table.add_row(
            f"{fit.model.title}{_NEXT_LINE + '(chosen)' if taken else ''}",
            *(_cell(fit, unit) for unit in _COLUMNS),
            f"{fit.fit:.4f}",
            f"{math.degrees(fit.prediction_rad):.2f}",
            style="bold" if taken else None,
        )
    return table


def _heading(unit: str) -> str:
    """The symbols of all parameters in a unit, and the unit."""
    symbols = dict.fromkeys(p.symbol for model in MODELS for p in model.described if p.unit == unit)
    return ", ".join(symbols) + _COLUMNS[unit][0]


def _cell(fit: ModelFit, unit: str) -> str:
    """The parameters in a unit, each with its interval below; nothing for a model without one."""
    _, scale, places, end_places = _COLUMNS[unit]
    lines = []
    for parameter, value, (low, high) in zip(fit.model.described, fit.values, fit.interval_95, strict=True):
        if parameter.unit == unit:
            ends = f"{scale * low:.{end_places}f}–{scale * high:.{end_places}f}"
            lines.append(f"{scale * value:.{places}f}{_NEXT_LINE}{ends}")
    return _NEXT_LINE.join(lines)
