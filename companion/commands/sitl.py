"""`companion sitl`: fly the experiment, fly scenarios, or serve the plant alone; each of the three has its own file."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import NamedTuple

from companion.commands.options import (
    ConfigFile,
    add_anyway,
    add_config,
    add_flight,
    add_json,
    config_file,
    shipped_config,
)
from companion.config import ConfigError


class Arguments(NamedTuple):
    """Of `companion sitl`."""

    config: ConfigFile
    hedging: bool | None
    realtime: bool
    out: Path | None
    json: bool
    serve: bool
    lockstep: bool
    port: int | None
    gcs_port: int | None
    link: str | None
    logs: tuple[Path, ...]
    end_with_input: bool
    against: str | None  # whom to compare with
    scenarios: list[str] | None  # None: not asked for; empty: all of them


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `companion sitl`."""
    add_anyway(parser)
    add_config(parser, shipped_config() / "antx_rig.yaml")
    add_flight(parser)
    parser.add_argument("--realtime", action="store_true", help="by the wall clock instead of in lockstep")
    parser.add_argument("--out", type=Path, help="folder for figures and flights (default: a new one in flights)")
    add_json(parser)
    parser.add_argument("--serve", action="store_true", help="the plant alone, for any MAVLink client")
    parser.add_argument(
        "--lockstep", action="store_true", help="with --serve: wait for a set-point after every odometry"
    )
    parser.add_argument("--port", type=int, help="UDP port of the plant (default: any free one; with --serve 14580)")
    parser.add_argument("--gcs-port", type=int, help="with --serve: UDP port for a ground station (default 18570)")
    parser.add_argument("--link", help="with --serve: a serial line instead of UDP, serial:///dev/...:baud")
    parser.add_argument(
        "--log", type=Path, action="append", metavar="FILE", help="with --serve: a log for `companion logs` to find"
    )
    parser.add_argument(
        "--end-with-input",
        action="store_true",
        help="with --serve: end when standard input does",
    )
    parser.add_argument(
        "--against",
        choices=["px4"],
        help="fly PX4's own position control too, score all by the truth",
    )
    parser.add_argument(
        "--scenarios",
        nargs="*",
        metavar="NAME",
        help="fly scenarios of wind, faults and failing links instead: those named (* and ? allowed), or all",
    )


def parse(namespace: argparse.Namespace) -> Arguments:
    """The arguments as a typed record."""
    return Arguments(
        config_file(namespace),
        namespace.hedging,
        namespace.realtime,
        namespace.out,
        namespace.json,
        namespace.serve,
        namespace.lockstep,
        namespace.port,
        namespace.gcs_port,
        namespace.link,
        tuple(namespace.log or ()),
        namespace.end_with_input,
        namespace.against,
        namespace.scenarios,
    )


def run(arguments: Arguments) -> int:
    """Fly or serve. 0 done, 1 when a flight failed or was not stable. Raises `ConfigError` for bad input.

    Each way imports only what it needs: a plant that is served starts without numpy.
    """
    if arguments.scenarios is not None:
        _refuse(arguments, "--scenarios", "serve", "lockstep", "realtime", "against")
        return _run_scenarios(arguments, arguments.scenarios)
    if arguments.against is not None:
        _refuse(arguments, "--against", "serve", "lockstep", "realtime")
        if arguments.hedging is not None:
            raise ConfigError("--against flies both controllers: leave out --hedging and --no-hedging")
    config = arguments.config.load()
    if config.plant is None:
        raise ConfigError(f"{arguments.config.path}: no plant section: there is nothing to simulate")
    for option, port in (("--port", arguments.port), ("--gcs-port", arguments.gcs_port)):
        if port is not None and not 0 <= port < 65536:
            raise ConfigError(f"{option} {port}: not a UDP port")
    if arguments.serve:
        from companion.commands import serve  # noqa: PLC0415

        served = serve.Arguments(
            config,
            arguments.config.path,
            arguments.lockstep,
            arguments.port,
            arguments.gcs_port,
            arguments.link,
            arguments.logs,
            arguments.end_with_input,
        )
        return serve.run(served)
    if arguments.against is not None:
        from companion.commands import against  # noqa: PLC0415

        return against.run(against.Arguments(config, arguments.config, arguments.out, arguments.json))
    from companion.commands import experiment  # noqa: PLC0415

    flown = experiment.Arguments(
        config,
        arguments.config,
        arguments.hedging,
        arguments.realtime,
        arguments.port or 0,
        arguments.out,
        arguments.json,
    )
    return experiment.run(flown)


def _refuse(arguments: Arguments, by: str, *options: str) -> None:
    """What does not go together. Raises `ConfigError`."""
    for option in options:
        if getattr(arguments, option):
            raise ConfigError(f"{by} brings its own plant and its own clock: leave out --{option}")


def _run_scenarios(arguments: Arguments, names: list[str]) -> int:
    from companion.commands import scenarios  # noqa: PLC0415

    return scenarios.run(
        scenarios.Arguments(names, arguments.config, arguments.hedging, arguments.out, arguments.json), shipped_config()
    )
