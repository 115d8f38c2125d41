"""Put an identified response into a config's `attitude` section and leave every other character where it was."""

from __future__ import annotations

import contextlib
import os
import shutil
from decimal import ROUND_CEILING, ROUND_FLOOR, Context, Decimal
from pathlib import Path
from typing import Any, Final

from companion.config import ConfigError, load_config
from companion.config.edit import KeyPath, edited, flow
from companion.config.numbers import NOT_YAML, read_yaml
from companion.config.vehicles import ANGLES
from companion.identify.identification import AxisIdentification, Identification
from companion.identify.report import fitted

_KEPT: Final = "pade_order"  # of a response: how the certificate takes the delay, not what it is
_DIGITS: Final = 4
_SMALLEST: Final = Decimal("0.0001")  # the certificate wants parameters above zero


def response(axis: AxisIdentification) -> dict[str, list[float]]:
    """The chosen response by the config's keys: intervals `[lower, upper]`, rounded outwards.

    The delay's lower end is the vehicle's own where it is known: what lies above it is the link's, and a link may be
    as quick as it likes.
    """
    intervals = axis.chosen.intervals()
    if axis.delay is not None:
        low, high = intervals["delay_s"]
        intervals["delay_s"] = (max(min(low, axis.delay.vehicle_s), 0.0), high)
    down, up = Context(prec=_DIGITS, rounding=ROUND_FLOOR), Context(prec=_DIGITS, rounding=ROUND_CEILING)
    return {
        key: [
            float(max(down.create_decimal(repr(low)), _SMALLEST)),
            float(max(up.create_decimal(repr(high)), 2 * _SMALLEST)),
        ]
        for key, (low, high) in intervals.items()
    }


def note(identification: Identification, axis: AxisIdentification) -> str:
    """What the comment above a written response says; its first word marks it as ours."""
    names = ", ".join(path.name for path in identification.paths)
    late = f", delay up to {1e3 * axis.lateness_s:.0f} ms more" if axis.lateness_s else ""
    chosen = axis.chosen
    return f"identified from {names}: {chosen.model.title}, {fitted(axis)}, fit {chosen.fit:.4f}{late}"


def write(path: Path, identification: Identification) -> None:
    """Replace `attitude.x` by pitch and `attitude.y` by roll; a rig has no y.

    The new text is read back: it must be a valid config that differs in these responses alone. The file is replaced in
    one step. Raises `ConfigError`, and then the file is as it was.
    """
    target = path.resolve()
    try:
        with target.open(encoding="utf-8", newline="") as stream:
            text = stream.read()
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror}") from None
    try:
        before = read_yaml(text)
    except NOT_YAML:
        raise ConfigError(f"{path}: not valid YAML any more") from None
    wanted: dict[str, dict[str, Any]] = {}
    for key, axis in ANGLES.items():
        if before["attitude"].get(key) is not None and axis in identification.axes:
            kept = {k: int(v) for k, v in before["attitude"][key].items() if k == _KEPT}
            wanted[key] = {**response(identification.axes[axis]), **kept}
    try:
        said: dict[KeyPath, str] = {
            ("attitude", key): note(identification, identification.axes[ANGLES[key]]) for key in wanted
        }
        text = edited(text, {("attitude", key): flow(values) for key, values in wanted.items()}, said)
        same = read_yaml(text) == {**before, "attitude": {**before["attitude"], **wanted}}
    except (KeyError, *NOT_YAML):
        same = False
    if not same:
        raise ConfigError(f"{path}: attitude cannot be replaced without disturbing the rest: write it out in full")
    _replace(path, target, text)


def _replace(path: Path, target: Path, text: str) -> None:
    """The file in one step, if it is a config."""
    new = target.with_name(f".{target.name}.new")
    try:
        with new.open("w", encoding="utf-8", newline="") as stream:
            stream.write(text)
            stream.flush()
            os.fsync(stream.fileno())
        shutil.copymode(target, new)
        load_config(new)
        new.replace(target)
    except ConfigError as error:
        raise ConfigError(f"{path}: with this response it would be no config: {error}") from None
    except OSError as error:
        raise ConfigError(f"{path}: cannot write: {error.strerror}") from None
    finally:
        with contextlib.suppress(OSError):
            new.unlink(missing_ok=True)
