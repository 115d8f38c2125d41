"""Reports as one self-contained page: no network, decimated to what a screen can show, under 3 MB."""

from __future__ import annotations

import base64
import html
import json
import math
from collections.abc import Sequence
from importlib.resources import files
from typing import Any, Final

import numpy as np
from tsdownsample import MinMaxDownsampler

from companion.report.model import Array, Panel, Report

MOST_FLIGHTS: Final = 6
LARGEST_BYTES: Final = 3_000_000
_POINTS: Final = 1200  # a line, of one flight; peaks are kept
_HEAT_CELLS: Final = 400


def page(reports: Sequence[Report]) -> str:
    """The page of these flights, side by side."""
    points = 2 * (_POINTS // len(reports) // 2)
    data = {"flights": [_flight(report, points) for report in reports]}
    text = json.dumps(data, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")
    names = " and ".join(report.name for report in reports)
    parts = {
        "TITLE": html.escape(names),
        "STYLE": _static("uplot.css") + _static("page.css"),
        "LICENCE": html.escape(_static("uplot.LICENSE")),
        "UPLOT": _static("uplot.js"),
        "DATA": text,
        "SCRIPT": _static("page.js"),
    }
    made = _static("page.html")
    first, *rest = made.split("{{")
    return first + "".join(parts[key] + after for key, after in (piece.split("}}", 1) for piece in rest))


def _static(name: str) -> str:
    return files("companion.report").joinpath("page", name).read_text(encoding="utf-8")


def _flight(report: Report, points: int) -> dict[str, Any]:
    path = report.path
    return {
        "name": report.name,
        "kind": report.kind,
        "verdict": report.verdict,
        "facts": [(name, _number(value), unit) for name, value, unit in report.facts],
        "panels": [_heat(panel) if panel.kind == "heat" else _lines(panel, points) for panel in report.panels],
        "path": None if path is None else [_packed(each) for each in path],
        "events": [(round(event.time_s, 3), event.name, event.detail) for event in report.events],
        "guards": [(g.guard, _number(g.share), round(g.time_s, 2), _number(g.value), _number(g.limit), g.unit)
                   for g in report.guards],
        "missing": report.missing,
        "zero": report.zero,
    }  # fmt: skip


def _number(value: float) -> float | None:
    return float(f"{value:.5g}") if math.isfinite(value) else None


def _panel(panel: Panel, time_s: Array, columns: Sequence[Array]) -> dict[str, Any]:
    return {
        "id": panel.id,
        "title": panel.title,
        "unit": panel.unit,
        "kind": panel.kind,
        "labels": [series.label for series in panel.series],
        "roles": [series.role for series in panel.series],
        "limits": panel.limits,
        "band": panel.band,
        "time": _packed(time_s),
        "columns": [_packed(column) for column in columns],
    }


def _lines(panel: Panel, points: int) -> dict[str, Any]:
    kept = np.unique(np.concatenate([decimated(series.values, points) for series in panel.series]))
    return _panel(panel, panel.time_s[kept], [series.values[kept] for series in panel.series])


def decimated(values: Array, points: int) -> Array:
    """Places of about so many values: least and largest of each stretch, first and last, and both ends of each gap."""
    if len(values) <= points:
        return np.arange(len(values))
    finite = np.isfinite(values)
    edges = np.flatnonzero(np.diff(finite))
    edges = np.concatenate([edges, edges + 1])[: 2 * points]
    filled = np.ascontiguousarray(np.where(finite, values, np.nanmean(values) if finite.any() else 0.0), dtype=float)
    extremes = MinMaxDownsampler().downsample(filled, n_out=points).astype(np.int64)
    return np.unique(np.concatenate([[0, len(values) - 1], edges, extremes]))


def _heat(panel: Panel) -> dict[str, Any]:
    """The largest share in each of some hundred stretches of time."""
    starts = np.unique(np.linspace(0, len(panel.time_s), _HEAT_CELLS, endpoint=False).astype(int))
    columns = [np.maximum.reduceat(np.nan_to_num(series.values), starts) for series in panel.series]
    return _panel(panel, panel.time_s[starts], columns)


def _packed(values: Array) -> str:
    return base64.b64encode(np.ascontiguousarray(values, dtype="<f4").tobytes()).decode()
