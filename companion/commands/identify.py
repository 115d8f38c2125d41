"""`companion identify`: logs in; table, picture, JSON and the config's attitude section out."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import yaml
from rich.console import Console

from companion.config import Config, ConfigError, load_config
from companion.identify.identification import Identification, identify_log
from companion.identify.report import show, to_json
from companion.identify.series import LogError


def run(arguments: argparse.Namespace) -> int:
    """Run the command. 0 done, 2 when an axis that the vehicle has is missing. Raises `ConfigError`."""
    if arguments.write and arguments.config is None:
        raise ConfigError("--write: give the config to write into, --config FILE")
    config = None if arguments.config is None else load_config(arguments.config)
    system_id, wanted = _vehicle(arguments.logs, config)
    try:
        identification = identify_log(arguments.logs, system_id)
    except LogError as error:
        raise ConfigError(str(error)) from None
    missing = [identification.refused[axis] for axis in wanted if axis in identification.refused]
    console = Console(stderr=arguments.json)
    if arguments.json:
        print(json.dumps(to_json(identification)))
    else:
        show(identification, console)
    if arguments.plot is not None:
        _plot(identification, arguments.plot)
    if missing:
        print(f"companion: {missing[0]}", file=sys.stderr)
        return 2
    if arguments.write:
        from companion.identify.write import write  # noqa: PLC0415

        write(arguments.config, identification)
        console.print(f"written into the attitude section of {arguments.config}")
    return 0


def _vehicle(logs: list[Path], config: Config | None) -> tuple[int | None, tuple[str, ...]]:
    """The vehicle's system id, if it is known, and the axes it has: by the config, or the one in the flight folder."""
    if config is not None:
        return config.vehicle.system_id, _axes(config.vehicle.kind)
    for log in logs:
        flown = log / "config.yaml"
        if flown.is_file():
            try:
                vehicle = yaml.safe_load(flown.read_text(encoding="utf-8"))["vehicle"]
                return int(vehicle.get("system_id", 1)), _axes(str(vehicle["kind"]))
            except (OSError, ValueError, TypeError, KeyError, AttributeError, yaml.YAMLError):
                continue
    return None, _axes("quadrotor")


def _axes(kind: str) -> tuple[str, ...]:
    return ("pitch",) if kind == "rig" else ("roll", "pitch")


def _plot(identification: Identification, path: Path) -> None:
    from companion.identify.plot import plot  # noqa: PLC0415

    try:
        plot(identification, path)
    except (OSError, ValueError) as error:
        raise ConfigError(f"{path}: cannot write the picture: {error}") from None
