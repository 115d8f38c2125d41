"""`companion run`: open the link and the log, fly, and say how it ended."""

from __future__ import annotations

import argparse
import contextlib
import sys
import time
from pathlib import Path
from typing import NamedTuple

from companion.certify.from_config import certificate_path
from companion.commands.options import ConfigFile, add_anyway, add_config, add_flight, config_file
from companion.config import Config, ConfigError
from companion.config.mission.identifying import as_flown, in_a_line
from companion.errors import printable
from companion.flight.authority.states import ORDINARY, Reason
from companion.flight.host.runtime import Summary, stop_signals
from companion.flight.host.service import Notifier, prepare_process
from companion.flight.host.terminal import Terminal
from companion.flight.process import FlightProcess
from companion.flight.readiness.certificate import cover, unwatched
from companion.mavlink.link import Link, LinkError, open_link
from companion.mavlink.logs.protocol import ON_A_LINE, ON_A_NETWORK
from companion.mavlink.tool_client import tool_socket
from companion.mavlink.tool_server import ToolServer
from companion.record.folder import new_folder, open_folder
from companion.record.recorder import EVENT, Recorder
from companion.record.schema import pack_event

_WANTED = (Reason.MISSION_COMPLETE, Reason.OPERATOR)
_NEVER_ENGAGED = 2


class Arguments(NamedTuple):
    """Of `companion run`."""

    config: ConfigFile
    link: str | None
    certificate: Path | None
    uncertified: bool
    engage: bool
    bench: bool
    hedging: bool | None
    out: Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `companion run`."""
    add_anyway(parser)
    add_config(parser)
    parser.add_argument("--link", help="udpin://host:port, udpout://host:port or serial:///dev/...:baud")
    parser.add_argument(
        "--certificate", type=Path, metavar="FILE", help="default: beside the config, NAME.certificate.json"
    )
    parser.add_argument("--uncertified", action="store_true", help="fly without a certificate, loudly")
    beginning = parser.add_mutually_exclusive_group()
    beginning.add_argument("--engage", action="store_true", help="arm, take off and ask for OFFBOARD")
    beginning.add_argument("--bench", action="store_true", help="propellers off: take control on the ground too")
    parser.add_argument("--out", type=Path, default=Path("flights"), help="where flight folders go (default: flights)")
    add_flight(parser)


def parse(namespace: argparse.Namespace) -> Arguments:
    """The arguments as a typed record."""
    return Arguments(
        config_file(namespace),
        namespace.link,
        namespace.certificate,
        namespace.uncertified,
        namespace.engage,
        namespace.bench,
        namespace.hedging,
        namespace.out,
    )


def run(arguments: Arguments) -> int:
    """Fly a vehicle. Exit code 0 for an ordinary end, 1 for a fault or a failsafe, 2 when control never began."""
    config = as_flown(arguments.config.load())
    config_path = arguments.config.path
    hedging = config.controller.hedging if arguments.hedging is None else arguments.hedging
    certificate = arguments.certificate or certificate_path(config_path)
    identifying = config.mission.identification is not None
    warning = None
    if not identifying:
        config, warning = cover(config, certificate, hedging=hedging)
    if warning is not None and not arguments.uncertified:
        raise ConfigError(f"{warning}: run `companion check {config_path} --out {certificate}`, or fly --uncertified")
    if warning is not None:
        print(f"companion: UNCERTIFIED FLIGHT: {printable(warning)}", file=sys.stderr)
    with contextlib.ExitStack() as open_things:
        link = open_link(arguments.link or config.link.url)
        open_things.callback(link.close)
        folder = new_folder(arguments.out, config_path.stem)
        recorder = open_folder(folder, config_path, config, blocking=False)
        open_things.callback(_end_log, recorder)
        terminal = Terminal()
        open_things.callback(terminal.close)
        tools = _tool_server(link, terminal)
        if tools is not None:
            open_things.callback(tools.close)
        notifier = Notifier()
        open_things.callback(notifier.close)
        terminal.print_line(f"link {link.name}, log {folder}")
        said = [in_a_line(config)] if identifying else []
        for name, lines in (
            ("identification", said),
            ("process", prepare_process(config.service)),
            ("unwatched", _unwatched(config)),
        ):
            for line in lines:
                terminal.print_line(line)
                recorder.add(EVENT, time.time_ns() // 1000, pack_event(name, line))
        process = FlightProcess(
            config,
            link,
            recorder,
            hedging=hedging,
            engage=arguments.engage,
            bench=arguments.bench,
            warning=warning,
            uncertified=arguments.uncertified,
            anyway=arguments.config.anyway,
            tools=tools,
            notifier=notifier,
            print_line=terminal.print_line,
        )
        with stop_signals(process.stop):  # until the log is closed: a second signal must not end it before it says why
            summary = process.run()
            open_things.close()
    code = exit_code(summary)
    if code == _NEVER_ENGAGED:
        print(f"companion: {printable(summary.detail)}", file=sys.stderr)
    else:
        print(f"in control for {summary.engaged_s:.1f} s, {summary.ticks} ticks")
    return code


def exit_code(summary: Summary) -> int:
    """0 for an ordinary end, 1 for a fault or a failsafe, 2 when control never began and was not to."""
    if not summary.engaged and summary.reason not in _WANTED:
        return _NEVER_ENGAGED
    return 0 if summary.reason in ORDINARY and not summary.failsafe else 1


def _end_log(recorder: Recorder) -> None:
    complaint = recorder.close()
    if complaint is not None:
        print(f"companion: {printable(complaint)}", file=sys.stderr)


def _tool_server(link: Link, terminal: Terminal) -> ToolServer | None:
    """Serves `companion vehicle` and `companion logs`; without one the flight is none the worse."""
    try:
        return ToolServer(tool_socket(link.name), ON_A_LINE if link.stream else ON_A_NETWORK)
    except LinkError as error:
        terminal.print_line(str(error))
        return None


def _unwatched(config: Config) -> list[str]:
    return [
        f"guards.{name} is off: nobody watches what the certificate takes for granted" for name in unwatched(config)
    ]
