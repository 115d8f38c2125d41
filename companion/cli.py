"""The `companion` command: a table of commands, each with a file of its own in `companion/commands/`.

Exit codes: 0 done; 1 a flight that failed or was not stable; 2 bad input, or nothing to fly with. Whatever is wrong
ends as one line on stderr.
"""

from __future__ import annotations

import argparse
import importlib
import sys
from typing import Any, Final, NamedTuple, NoReturn, Protocol

from companion import __version__
from companion.errors import CompanionError, printable
from companion.safe_path import leave_current_directory
from companion.standard_streams import FULL, end_output, open_missing, output_lost


class Command(NamedTuple):
    """One row: its name, what it does in one line, and the module that does it."""

    name: str
    summary: str
    module: str


COMMANDS: Final = (
    Command("run", "fly a vehicle: the real thing", "companion.commands.run"),
    Command("check", "prove, before flight, that the attitude loop is fast enough", "companion.commands.check"),
    Command("identify", "the attitude response from a flight log", "companion.commands.identify"),
    Command("design", "from a flight log to a certified config: the fastest it allows", "companion.commands.design"),
    Command("report", "flights as one page: why they ended, what came near its limit", "companion.commands.report"),
    Command("vehicle", "the vehicle's firmware, health and settings: fit to be flown?", "companion.commands.vehicle"),
    Command("logs", "fetch the vehicle's logs: resumed, and checked for completeness", "companion.commands.logs"),
    Command("sitl", "fly the paper's experiment on the simulated plant", "companion.commands.sitl"),
    Command("campaign", "many flights on the plant, drawn from distributions", "companion.commands.campaign"),
)


class CommandModule(Protocol):
    """What the module of a command offers."""

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare the command's own arguments."""

    def parse(self, namespace: argparse.Namespace) -> Any:
        """The arguments as the command's typed record."""

    def run(self, arguments: Any) -> int:
        """Do it. Returns the exit code; raises `CompanionError`."""


class _Parser(argparse.ArgumentParser):
    """Argparse whose complaints are one line."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: {message} (see {self.prog} --help)\n")


def read_command_line(argv: list[str]) -> tuple[CommandModule, Any]:
    """The command asked for and its arguments, as its own record. Exits when there is nothing to run.

    Only the module of the command asked for is imported: `companion run` starts without what the others need.
    """
    parser = _Parser(prog="companion", description="Adaptive position control for PX4 from a companion computer.")
    parser.add_argument("--version", action="version", version=f"companion {__version__}")
    parsers = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    module: Any = None
    for command in COMMANDS:
        own = parsers.add_parser(command.name, help=command.summary)
        if argv[:1] == [command.name]:
            module = importlib.import_module(command.module)
            module.add_arguments(own)
    namespace = parser.parse_args(argv)
    if module is None:  # as in `companion -- run`
        parser.error("the command comes first")
    return module, module.parse(namespace)


def main(argv: list[str] | None = None) -> None:
    """Entry point of the `companion` command. Exits."""
    open_missing()
    if argv is None:  # this process is the command's own
        leave_current_directory()
        argv = sys.argv[1:]
    try:
        module, arguments = read_command_line(argv)
        code = module.run(arguments)
    except CompanionError as error:
        print(f"companion: {printable(str(error))}", file=sys.stderr)
        code = 2
    except KeyboardInterrupt:
        code = 130
    except BrokenPipeError:
        code = 1
    except OSError as error:
        if error.errno not in FULL or error.filename is not None:
            raise
        code = output_lost(error)
    sys.exit(end_output() or code)
