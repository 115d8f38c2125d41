"""`companion identify`: logs in; table, picture, JSON and the config's attitude section out."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import NamedTuple

from companion.commands.options import add_json
from companion.config import ConfigError, load_config
from companion.errors import printable


class Arguments(NamedTuple):
    """Of `companion identify`."""

    logs: list[Path]
    compare: list[Path] | None
    config: Path | None
    write: bool
    plot: Path | None
    json: bool


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `companion identify`."""
    parser.add_argument("logs", type=Path, nargs="*", metavar="LOG", help="PX4 ULog, tlog or flight folder")
    parser.add_argument(
        "--compare",
        type=Path,
        nargs=2,
        metavar=("BEFORE", "AFTER"),
        help="whether the response of each axis became faster or slower from one log to the other",
    )
    parser.set_defaults(refuse=parser.error)  # argparse cannot say that one of the two is required
    parser.add_argument("--config", type=Path, help="the vehicle: its system id and whether it rolls")
    parser.add_argument("--write", action="store_true", help="put the response into the config's attitude section")
    parser.add_argument("--plot", type=Path, metavar="FILE.png", help="draw measured against fitted")
    add_json(parser)


def parse(namespace: argparse.Namespace) -> Arguments:
    """The arguments as a typed record."""
    if not namespace.logs and namespace.compare is None:
        namespace.refuse("the following arguments are required: LOG, or --compare BEFORE AFTER")
    return Arguments(
        namespace.logs, namespace.compare, namespace.config, namespace.write, namespace.plot, namespace.json
    )


def run(arguments: Arguments) -> int:
    """Run the command. 0 done, 2 when an axis that the vehicle has is missing. Raises `ConfigError` or `LogError`."""
    if arguments.compare is not None:
        return _compare(arguments, arguments.compare)
    if arguments.write and arguments.config is None:
        raise ConfigError("--write: give the config to write into, --config FILE")
    config = None if arguments.config is None else load_config(arguments.config)
    # numpy, scipy and the readers of logs: `--help` and a mistyped argument need not wait for them
    from rich.console import Console  # noqa: PLC0415

    from companion.identify.identification import identify_log  # noqa: PLC0415
    from companion.identify.report import show, to_json  # noqa: PLC0415
    from companion.identify.vehicle import vehicle_of  # noqa: PLC0415
    from companion.identify.write import write  # noqa: PLC0415

    vehicle = vehicle_of(arguments.logs, config)
    identification = identify_log(arguments.logs, vehicle.system_id)
    missing = [identification.refused[axis] for axis in vehicle.axes if axis in identification.refused]
    console = Console(stderr=arguments.json)
    if arguments.json:
        print(json.dumps(to_json(identification)))
    else:
        show(identification, console)
    if arguments.plot is not None:
        from companion.identify.plot import plot  # noqa: PLC0415 - matplotlib takes its time

        try:
            plot(identification, arguments.plot)
        except (OSError, ValueError) as error:
            raise ConfigError(f"{arguments.plot}: cannot write the picture: {error}") from None
    if missing:
        print(f"companion: {printable(missing[0])}", file=sys.stderr)
        return 2
    if arguments.write and arguments.config is not None:
        write(arguments.config, identification)
        console.print(f"written into the attitude section of {printable(str(arguments.config))}")
    return 0


def _compare(arguments: Arguments, logs: list[Path]) -> int:
    """0 done, 2 when an axis that the vehicle has is missing in one of the logs."""
    if arguments.logs or arguments.write:
        raise ConfigError("--compare takes two logs and writes nothing: leave LOG and --write out")
    config = None if arguments.config is None else load_config(arguments.config)
    from companion.identify.comparison.compare import compare, sentences, to_json  # noqa: PLC0415 - see `run`
    from companion.identify.identification import identify_log  # noqa: PLC0415
    from companion.identify.vehicle import vehicle_of  # noqa: PLC0415

    vehicle = vehicle_of(logs, config)
    before, after = (identify_log([log], vehicle.system_id) for log in logs)
    comparison = compare(before, after)
    if arguments.json:
        print(json.dumps(to_json(comparison, before, after)))
    else:
        print("\n".join([*sentences(comparison), "95 %, all axes together; bandwidth: -3 dB, without the delay"]))
    if arguments.plot is not None:
        from companion.identify.comparison.plot import plot_comparison  # noqa: PLC0415 - matplotlib takes its time

        try:
            plot_comparison(comparison, before, after, arguments.plot)
        except (OSError, ValueError) as error:
            raise ConfigError(f"{arguments.plot}: cannot write the picture: {error}") from None
    missing = [comparison.missing[axis] for axis in vehicle.axes if axis in comparison.missing]
    if missing:
        print(f"companion: {missing[0]}", file=sys.stderr)
        return 2
    return 0
