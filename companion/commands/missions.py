"""`--mission NAME|FILE`, `--speed` and `--stretch`: a mission from the command line, as overrides of the config."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any, Final

from companion.config import ConfigError

_BEGIN_S: Final = 5.0  # held first, while the disturbance is found, and last
_END_S: Final = 2.0
_LONG_S: Final = 30.0  # of a curve between its holds, at least
_SPEED_M_S: Final = 1.0
_LENGTH_M, _WIDTH_M, _RADIUS_M = 4.0, 2.0, 2.0
NAMES: Final = ("hold", "circle", "lemniscate")
FILES: Final = {".csv": "samples", ".parquet": "samples", ".plan": "plan"}


def overrides(name: str | None, speed: float | None, *, stretch: bool, identify: bool) -> list[str]:
    """What the options say of the config. Raises `ConfigError`."""
    slow = ["mission.stretch=true"] if stretch else []
    if name is None:
        if speed is not None:
            raise ConfigError("--speed is that of a --mission circle or lemniscate: name one")
        return slow
    if identify:
        raise ConfigError("--identify flies doublets: leave out --mission")
    curve = name in ("circle", "lemniscate")
    if speed is not None and not (curve and math.isfinite(speed) and speed > 0.0):
        raise ConfigError(f"--speed {speed:g}: a positive speed of --mission circle or lemniscate")
    if name in NAMES:
        return [_text({"trajectories": _named(name, speed or _SPEED_M_S)}), *slow]
    path = Path(name).expanduser()
    kind = FILES.get(path.suffix.lower())
    if path.suffix.lower() in (".yaml", ".yml"):
        return [_text({"file": str(path.absolute())}), *slow]
    if kind is None:
        raise ConfigError(f"--mission {name}: none of {', '.join(NAMES)}, and no file that ends in .yaml, "
                          f"{', '.join(FILES)}")  # fmt: skip
    return [_text({"trajectories": [{"hold_s": _BEGIN_S}, {kind: {"file": str(path.absolute())}}]}), *slow]


def _named(name: str, speed_m_s: float) -> list[dict[str, Any]]:
    begin, end = {"hold_s": _BEGIN_S}, {"hold_s": _END_S}
    if name == "hold":
        return [{"hold_s": _LONG_S}]
    if name == "circle":
        lap_m = 2.0 * math.pi * _RADIUS_M
        curve: dict[str, Any] = {"radius_m": _RADIUS_M}
    else:
        lap_m = 2.0 * math.pi * math.hypot(0.5 * _LENGTH_M, _WIDTH_M)  # at the speed in the middle, all of it
        curve = {"length_m": _LENGTH_M, "width_m": _WIDTH_M}
    laps = float(math.ceil(_LONG_S * speed_m_s / lap_m))
    return [begin, {name: {**curve, "speed_m_s": speed_m_s, "laps": laps}}, end]


def _text(mission: dict[str, Any]) -> str:
    return f"mission={json.dumps(mission)}"
