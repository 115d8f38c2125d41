"""Put an identified response into a config's `attitude` section and leave every other character where it was."""

from __future__ import annotations

import contextlib
import os
import re
import shutil
from decimal import ROUND_CEILING, ROUND_FLOOR, Context, Decimal
from pathlib import Path
from typing import Any, Final

import yaml

from companion.config import ConfigError, load_config
from companion.identify.identification import AxisIdentification, Identification

CONFIG_AXES: Final = {"x": "pitch", "y": "roll"}  # control frame to attitude
_KEPT: Final = "pade_order"  # of a response: how the certificate takes the delay, not what it is
_DIGITS: Final = 4
_SMALLEST: Final = Decimal("0.0001")  # the certificate wants parameters above zero
_MARK: Final = "# identified from "


def section(axis: AxisIdentification) -> dict[str, list[float]]:
    """The chosen response as the config writes it: intervals `[lower, upper]`, rounded outwards."""
    down, up = Context(prec=_DIGITS, rounding=ROUND_FLOOR), Context(prec=_DIGITS, rounding=ROUND_CEILING)
    return {
        key: [float(max(down.create_decimal(repr(low)), _SMALLEST)), float(up.create_decimal(repr(high)))]
        for key, (low, high) in axis.chosen.intervals().items()
    }


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
    before = yaml.safe_load(text)
    wanted: dict[str, dict[str, Any]] = {}
    for key, axis in CONFIG_AXES.items():
        if key in before["attitude"] and axis in identification.axes:
            kept = {k: v for k, v in before["attitude"][key].items() if k == _KEPT}
            wanted[key] = {**section(identification.axes[axis]), **kept}
    for key, response in wanted.items():
        text = _replaced(path, text, key, response, _comment(identification, identification.axes[CONFIG_AXES[key]]))
    _check(path, text, {**before, "attitude": {**before["attitude"], **wanted}})
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


def _comment(identification: Identification, axis: AxisIdentification) -> str:
    names = ", ".join(path.name for path in identification.paths)
    late = f", delay up to {1e3 * axis.lateness_s:.0f} ms more" if axis.lateness_s else ""
    chosen = axis.chosen
    return f"{_MARK}{names}: {chosen.model.title}, {len(axis.manoeuvres)} manoeuvres, fit {chosen.fit:.4f}{late}"


def _replaced(path: Path, text: str, key: str, response: dict[str, Any], comment: str) -> str:
    """The text with one response and the comment above it; comments inside the old one stay, on own lines."""
    key_node, node = _find(path, text, key)
    start, end = node.start_mark.index, _end(node)
    values = ", ".join(f"{k}: {_plain(v)}" for k, v in response.items())
    old = text[start:end]
    newline = "\r\n" if "\r\n" in text else "\n"
    line_start = text.rfind("\n", 0, key_node.start_mark.index) + 1
    indent = re.match(r"[ \t]*", text[line_start:]).group()  # type: ignore[union-attr]
    inside = re.findall(r"(?:^|(?<=\s))#[^\r\n]*", old)
    text = text[:start] + f"{{{values}}}" + text[end:]
    kept = "".join(f"{indent}{remark.rstrip()}{newline}" for remark in inside)
    above = text[:line_start]
    previous = above.rstrip("\r\n").rfind("\n") + 1
    if above[previous:].lstrip().startswith(_MARK):  # ours, from the time before
        above = above[:previous]
    return f"{above}{indent}{comment}{newline}{kept}{text[line_start:]}"


def _find(path: Path, text: str, key: str) -> tuple[Any, Any]:
    root: Any = yaml.compose(text, Loader=yaml.SafeLoader)
    for name, node in root.value:
        if name.value == "attitude" and isinstance(node, yaml.MappingNode):
            for inner, value in node.value:
                if inner.value == key and value.start_mark.index > inner.start_mark.index:
                    return inner, value
    raise ConfigError(f"{path}: attitude.{key} is written elsewhere (a YAML alias): write it out where it belongs")


def _end(node: Any) -> int:
    """Where a node's own text ends: a block mapping's mark lies behind the comments that follow it."""
    if isinstance(node, yaml.CollectionNode) and not node.flow_style and node.value:
        last = node.value[-1]
        return _end(last[1] if isinstance(last, tuple) else last)
    return int(node.end_mark.index)


def _plain(value: Any) -> str:
    return f"[{', '.join(format(v, 'g') for v in value)}]" if isinstance(value, list) else f"{value}"


def _check(path: Path, text: str, wanted: dict[str, Any]) -> None:
    """Nothing but the responses may have changed."""
    try:
        same = yaml.safe_load(text) == wanted
    except yaml.YAMLError:
        same = False
    if not same:
        raise ConfigError(f"{path}: attitude cannot be replaced without disturbing the rest: write it plainly")
