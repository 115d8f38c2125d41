"""How the figures look. Their colours are told apart by the colour-blind too: Okabe and Ito, Color Universal Design."""

from __future__ import annotations

from typing import Any, Final

GREEN: Final = "#009E73"
RED: Final = "#D55E00"
BLUE: Final = "#0072B2"
CONTROLLERS: Final = {"hedged": GREEN, "standard": RED, "px4": BLUE}
STYLE: Any = {"font.size": 11, "axes.grid": True, "grid.alpha": 0.35, "legend.framealpha": 0.9, "figure.dpi": 140}
