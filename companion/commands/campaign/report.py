"""What a campaign came to: its machine-readable contract, and a table for a screen."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from rich.console import Console
from rich.table import Table

from sitl.campaign.results import Results

_QUANTILES: Final = ("50", "95", "99.9")
_QUANTITIES: Final = ("truth_rms_m", "truth_peak_m", "rms_m", "peak_m", "tilt_deg")


def report_of(results: Results, flights: int, rate: float | None) -> dict[str, Any]:
    """The machine-readable contract. Quantiles are of the flights that came under control."""
    table = results.merge(flights)
    quantiles = {}
    for name in _QUANTITIES:
        values = np.asarray(table[name].to_pylist(), dtype=float)
        values = values[np.isfinite(values)]
        quantiles[name] = {q: float(np.quantile(values, float(q) / 100.0)) for q in _QUANTILES} if len(values) else {}
    endings = table["ending"].to_pylist()
    return {
        "flights": len(endings),
        "unstable": sum(table["unstable"].to_pylist()),
        "endings": {ending: endings.count(ending) for ending in sorted(set(endings))},
        "flights_per_s_per_core": rate,
        "quantiles": quantiles,
        "results": str(results.table),
    }


def tell(report: dict[str, Any]) -> None:
    """The same on a screen."""
    console, table = Console(), Table("", *(f"{q} %" for q in _QUANTILES))
    for name, values in report["quantiles"].items():
        table.add_row(name, *(f"{values[q]:.4f}" if values else "-" for q in _QUANTILES))
    console.print(table)
    rate = report["flights_per_s_per_core"]
    console.print(f"{report['flights']} flights, {report['unstable']} unstable: {report['endings']}")
    console.print("all of them were there" if rate is None else f"{rate:.1f} flights a second of a core")
    console.print(f"table in [bold]{report['results']}[/bold]")
