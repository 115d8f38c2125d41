"""The `companion` command. One function a sub-command, and nothing but wiring.

Exit codes: 0 done; 1 a flight that failed or was not stable; 2 bad input, or nothing to fly with. Whatever is wrong
ends as one line on stderr.
"""

from __future__ import annotations

import argparse
import contextlib
import sys
from pathlib import Path
from typing import NoReturn

from companion import __version__
from companion.config import ConfigError, load_config
from companion.mavlink.link import LinkError


class _Parser(argparse.ArgumentParser):
    """Argparse whose complaints are one line."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: {message} (see {self.prog} --help)\n")


def default_config() -> Path:
    """`config/antx_rig.yaml` of the checkout, or the copy inside an installed package."""
    package = Path(__file__).parent
    shipped = package / "shipped_config" / "antx_rig.yaml"
    return shipped if shipped.exists() else package.parent / "config" / "antx_rig.yaml"


def _overrides(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--set",
        dest="overrides",
        metavar="KEY=VALUE",
        action="append",
        default=[],
        help="override one key of the config, as in --set controller.axes.x.adaptation_rate.standard=200",
    )


def _shared(parser: argparse.ArgumentParser) -> None:
    _overrides(parser)
    parser.add_argument(
        "--hedging",
        action=argparse.BooleanOptionalAction,
        default=None,
        help="fly only the hedged or only the standard controller",
    )


def _identifying(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--identify",
        action="store_true",
        help="fly attitude doublets for `companion identify` instead of the mission",
    )


def _add_identification(commands: argparse._SubParsersAction[_Parser]) -> None:
    """From logs to a config."""
    identify = commands.add_parser("identify", help="the attitude response from a flight log")
    identify.add_argument("logs", type=Path, nargs="+", metavar="LOG", help="PX4 ULog, tlog or flight folder")
    identify.add_argument("--config", type=Path, help="the vehicle: its system id and whether it rolls")
    identify.add_argument("--write", action="store_true", help="put the response into the config's attitude section")
    identify.add_argument("--plot", type=Path, metavar="FILE.png", help="draw measured against fitted")
    identify.add_argument("--json", action="store_true", help="one JSON object on stdout and nothing else")
    identify.set_defaults(function=_identify)

    design = commands.add_parser("design", help="from a flight log to a certified config: the fastest it allows")
    design.add_argument("logs", type=Path, nargs="+", metavar="LOG", help="PX4 ULog, tlog or flight folder")
    design.add_argument("--template", type=Path, required=True, metavar="CONFIG", help="everything but the response")
    design.add_argument("--out", type=Path, required=True, metavar="CONFIG", help="the config to write")
    design.add_argument("--margin", type=float, default=0.1, help="in hand, of bandwidth and delay (default: 0.1)")
    design.add_argument("--intervals", action="store_true", help="certify the whole of the identified intervals")
    design.add_argument("--link-delay", type=float, default=0.0, metavar="S", help="both ways, where no log has it")
    design.add_argument("--degree", type=int, default=6, help="highest degree of the certificate (default: 6)")
    design.add_argument("--force", action="store_true", help="replace what --out names")
    design.add_argument("--json", action="store_true", help="one JSON object on stdout and nothing else")
    design.set_defaults(function=_design)


def _add_services(commands: argparse._SubParsersAction[_Parser]) -> None:
    """What asks the vehicle and changes nothing."""
    vehicle = commands.add_parser("vehicle", help="the vehicle's firmware, health and settings: fit to be flown?")
    vehicle.add_argument("--json", action="store_true", help="one JSON object on stdout and nothing else")
    vehicle.set_defaults(function=_vehicle)
    logs = commands.add_parser("logs", help="fetch the vehicle's logs: resumed, and checked for completeness")
    which = logs.add_mutually_exclusive_group()
    which.add_argument("--list", action="store_true", help="only list them")
    which.add_argument("--latest", action="store_true", help="only the newest; default: all that are not here yet")
    logs.add_argument("--out", type=Path, default=Path("logs"), help="folder for the logs (default: logs)")
    logs.set_defaults(function=_logs)
    for parser in (vehicle, logs):
        parser.add_argument("config", type=Path)
        parser.add_argument(
            "--link", help="as for run, or unix://PATH; default: the config's, or what `run` shares of it"
        )
        _overrides(parser)


def _build_parser() -> _Parser:
    parser = _Parser(prog="companion", description="Adaptive position control for PX4 from a companion computer.")
    parser.add_argument("--version", action="version", version=f"companion {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")

    run = commands.add_parser("run", help="fly a vehicle: the real thing")
    run.add_argument("config", type=Path)
    run.add_argument("--link", help="udpin://host:port, udpout://host:port or serial:///dev/...:baud")
    run.add_argument(
        "--certificate", type=Path, metavar="FILE", help="default: beside the config, NAME.certificate.json"
    )
    run.add_argument("--uncertified", action="store_true", help="fly without a certificate, loudly")
    _identifying(run)
    run.add_argument("--engage", action="store_true", help="arm, take off and ask for OFFBOARD")
    run.add_argument("--out", type=Path, default=Path("flights"), help="where flight folders go (default: flights)")
    _shared(run)
    run.set_defaults(function=_run)

    check = commands.add_parser("check", help="prove, before flight, that the attitude loop is fast enough")
    check.add_argument("config", type=Path)
    check.add_argument("--degree", type=int, default=8, help="highest degree of the Lyapunov function (default: 8)")
    check.add_argument("--all-degrees", action="store_true", help="the needed bandwidth of every degree up to --degree")
    check.add_argument("--fastest", action="store_true", help="also find the fastest certified reference model")
    check.add_argument("--out", type=Path, metavar="FILE", help="write the certificate, if there is one")
    check.add_argument("--verify", type=Path, metavar="FILE", help="only verify this certificate against the config")
    check.add_argument("--plot", type=Path, metavar="FILE.png", help="draw the needed bandwidth against delay")
    check.add_argument("--json", action="store_true", help="one JSON object on stdout and nothing else")
    _overrides(check)
    check.set_defaults(function=_check)

    _add_identification(commands)
    _add_services(commands)

    sitl = commands.add_parser("sitl", help="fly the paper's experiment on the simulated plant")
    sitl.add_argument("config", type=Path, nargs="?", default=default_config())
    sitl.add_argument("--realtime", action="store_true", help="by the wall clock instead of in lockstep")
    sitl.add_argument("--out", type=Path, help="folder for figures and flights (default: a new one in flights)")
    _identifying(sitl)
    sitl.add_argument("--json", action="store_true", help="one JSON object on stdout and nothing else")
    sitl.add_argument("--serve", action="store_true", help="the plant alone, for any MAVLink client")
    sitl.add_argument("--port", type=int, help="UDP port of the plant (default: any free one; with --serve 14580)")
    sitl.add_argument("--gcs-port", type=int, help="with --serve: UDP port for a ground station (default 18570)")
    sitl.add_argument("--link", help="with --serve: a serial line instead of UDP, serial:///dev/...:baud")
    sitl.add_argument(
        "--log", type=Path, action="append", metavar="FILE", help="with --serve: a log for `companion logs` to find"
    )
    sitl.add_argument(
        "--scenarios",
        nargs="*",
        metavar="NAME",
        help="fly scenarios of wind, faults and failing links instead: those named (* and ? allowed), or all",
    )
    sitl.add_argument("--lockstep", action="store_true", help="with --serve: wait for a set-point after every odometry")
    _shared(sitl)
    sitl.set_defaults(function=_sitl)
    return parser


def _run(arguments: argparse.Namespace) -> int:
    from companion.commands.run import run_flight  # noqa: PLC0415 - imports only what the command needs

    config = load_config(arguments.config, tuple(arguments.overrides))
    return run_flight(config, arguments)


def _check(arguments: argparse.Namespace) -> int:
    from companion.commands.check import check  # noqa: PLC0415

    return check(load_config(arguments.config, tuple(arguments.overrides)), arguments)


def _identify(arguments: argparse.Namespace) -> int:
    from companion.commands.identify import run  # noqa: PLC0415

    return run(arguments)


def _design(arguments: argparse.Namespace) -> int:
    from companion.commands.design import run  # noqa: PLC0415

    return run(arguments)


def _vehicle(arguments: argparse.Namespace) -> int:
    from companion.commands.vehicle import vehicle  # noqa: PLC0415

    return vehicle(load_config(arguments.config, tuple(arguments.overrides)), arguments)


def _logs(arguments: argparse.Namespace) -> int:
    from companion.commands.logs import logs  # noqa: PLC0415

    return logs(load_config(arguments.config, tuple(arguments.overrides)), arguments)


def _sitl(arguments: argparse.Namespace) -> int:
    if arguments.scenarios is not None:
        from companion.commands.scenarios import run_scenarios  # noqa: PLC0415 - imports only what the command needs

        for option in ("serve", "lockstep", "realtime"):
            if getattr(arguments, option):
                raise ConfigError(f"--scenarios brings its own plant and its own clock: leave out --{option}")
        return run_scenarios(arguments, default_config().parent)
    config = load_config(arguments.config, tuple(arguments.overrides))
    if config.plant is None:
        raise ConfigError(f"{arguments.config}: no plant section: there is nothing to simulate")
    for option, port in (("--port", arguments.port), ("--gcs-port", arguments.gcs_port)):
        if port is not None and not 0 <= port < 65536:
            raise ConfigError(f"{option} {port}: not a UDP port")
    from companion.commands.sitl import run_experiment, serve_plant  # noqa: PLC0415

    return serve_plant(config, arguments) if arguments.serve else run_experiment(config, arguments)


def main(argv: list[str] | None = None) -> None:
    """Entry point of the `companion` command. Exits."""
    arguments = _build_parser().parse_args(argv)
    if getattr(arguments, "identify", False):  # first: what --set says of it counts more
        arguments.overrides.insert(0, "mission={identification: {}}")
    try:
        code: int = arguments.function(arguments)
    except (ConfigError, LinkError) as error:
        print(f"companion: {error}", file=sys.stderr)
        code = 2
    except KeyboardInterrupt:
        code = 130
    except BrokenPipeError:
        code = 1
    with contextlib.suppress(BrokenPipeError):
        sys.stdout.flush()
    sys.exit(code)
