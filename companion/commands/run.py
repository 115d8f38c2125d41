"""`companion run`: open the link and the log, fly, and say how it ended."""

from __future__ import annotations

import argparse
import sys
import time

from companion.certify.from_config import certificate_path
from companion.config import Config, ConfigError
from companion.flight.authority.states import ORDINARY, Reason
from companion.flight.host.service import Notifier, prepare_process
from companion.flight.host.terminal import Speaker
from companion.flight.process import FlightProcess
from companion.flight.readiness.certificate import uncovered, unwatched
from companion.mavlink.link import Link, LinkError, open_link
from companion.mavlink.log_protocol import ON_A_LINE, ON_A_NETWORK
from companion.mavlink.tool_client import door_of
from companion.mavlink.tool_server import ToolServer
from companion.record.folder import new_folder, open_folder
from companion.record.recorder import EVENT
from companion.record.schema import pack_event

_WANTED = (Reason.MISSION_COMPLETE, Reason.OPERATOR)


def run_flight(config: Config, arguments: argparse.Namespace) -> int:
    """Fly a vehicle. Exit code 0 for an ordinary end, 1 for a fault or a failsafe, 2 when control never began."""
    hedging = config.controller.hedging if arguments.hedging is None else arguments.hedging
    certificate = arguments.certificate or certificate_path(arguments.config)
    warning = uncovered(config, certificate, hedging=hedging)
    if warning is not None and not arguments.uncertified:
        raise ConfigError(
            f"{warning}: run `companion check {arguments.config} --out {certificate}`, or fly --uncertified"
        )
    if warning is not None:
        print(f"companion: UNCERTIFIED FLIGHT: {warning}", file=sys.stderr)
    link = open_link(arguments.link or config.link.url)
    try:
        folder = new_folder(arguments.out, arguments.config.stem)
        recorder = open_folder(folder, arguments.config, config, blocking=False)
        speaker = Speaker()
        notifier = Notifier()
        door = _door(link, speaker)
        try:
            speaker.say(f"link {link.name}, log {folder}")
            for name, lines in (("process", prepare_process(config.service)), ("unwatched", _unwatched(config))):
                for line in lines:
                    speaker.say(line)
                    recorder.add(EVENT, time.time_ns() // 1000, pack_event(name, line))
            summary = FlightProcess(
                config,
                link,
                recorder,
                hedging=hedging,
                engage=arguments.engage,
                warning=warning,
                uncertified=arguments.uncertified,
                tools=door,
                notifier=notifier,
                print_line=speaker.say,
            ).run()
        finally:
            notifier.close()
            if door is not None:
                door.close()
            speaker.close()
            complaint = recorder.close()
            if complaint is not None:
                print(f"companion: {complaint}", file=sys.stderr)
    finally:
        link.close()
    if not summary.engaged and summary.reason not in _WANTED:
        print(f"companion: {summary.detail}", file=sys.stderr)
        return 2
    print(f"in control for {summary.engaged_s:.1f} s, {summary.ticks} ticks")
    return 0 if summary.reason in ORDINARY and not summary.failsafe else 1


def _door(link: Link, speaker: Speaker) -> ToolServer | None:
    """A door for `companion vehicle` and `companion logs`; without one the flight is none the worse."""
    try:
        return ToolServer(door_of(link.name), ON_A_LINE if link.stream else ON_A_NETWORK)
    except LinkError as error:
        speaker.say(str(error))
        return None


def _unwatched(config: Config) -> list[str]:
    return [
        f"guards.{name} is off: nobody watches what the certificate takes for granted" for name in unwatched(config)
    ]
