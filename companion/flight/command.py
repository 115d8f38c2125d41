"""`companion run`: open the link and the log, fly, and say how it ended."""

from __future__ import annotations

import argparse
import sys

from companion.config import Config, ConfigError
from companion.config.certification import certificate_path
from companion.flight.authority import Reason
from companion.flight.covered import uncovered
from companion.flight.process import FlightProcess
from companion.flight.say import Speaker
from companion.mavlink.link import open_link
from companion.record.folder import new_folder, open_folder

_ORDINARY = (Reason.MISSION_COMPLETE, Reason.OPERATOR)
_GOOD_ENDS = (*_ORDINARY, Reason.MODE_CHANGED, Reason.DISARMED)


def run_flight(config: Config, arguments: argparse.Namespace) -> int:
    """Fly a vehicle. Exit code 0 for an ordinary end, 1 for a failsafe, 2 when control never began."""
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
        try:
            speaker.say(f"link {link.name}, log {folder}")
            summary = FlightProcess(
                config,
                link,
                recorder,
                hedging=hedging,
                engage=arguments.engage,
                warning=warning,
                say=speaker.say,
            ).run()
        finally:
            speaker.close()
            complaint = recorder.close()
            if complaint is not None:
                print(f"companion: {complaint}", file=sys.stderr)
    finally:
        link.close()
    if not summary.engaged and summary.reason not in _ORDINARY:
        print(f"companion: {summary.detail}", file=sys.stderr)
        return 2
    print(f"in control for {summary.engaged_s:.1f} s, {summary.ticks} ticks")
    return 0 if summary.reason in _GOOD_ENDS else 1
