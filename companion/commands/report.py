"""`companion report`: flights in, one page out."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import NamedTuple

from companion.config import ConfigError
from companion.errors import printable


class Arguments(NamedTuple):
    """Of `companion report`."""

    flights: list[Path]
    out: Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `companion report`."""
    parser.add_argument("flights", type=Path, nargs="+", metavar="FLIGHT", help="flight folder, or PX4 ULog")
    parser.add_argument("--out", type=Path, default=Path("report.html"), help="the page (default: report.html)")


def parse(namespace: argparse.Namespace) -> Arguments:
    """The arguments as a typed record."""
    return Arguments(namespace.flights, namespace.out)


def run(arguments: Arguments) -> int:
    """Write the page. 0 done. Raises `CompanionError` for what cannot be read or written."""
    # numpy and the readers of logs: `--help` need not wait for them
    try:
        from companion.report.page import LARGEST_BYTES, MOST_FLIGHTS, page  # noqa: PLC0415
    except ModuleNotFoundError as error:
        raise ConfigError(f"a report needs {error.name}: pip install 'companion[report]'") from None
    from companion.report.reading import read  # noqa: PLC0415

    if len(arguments.flights) > MOST_FLIGHTS:
        raise ConfigError(f"{len(arguments.flights)} flights: a page has room for {MOST_FLIGHTS} side by side")
    made = page([read(path) for path in arguments.flights]).encode()
    if len(made) > LARGEST_BYTES:
        raise ConfigError(f"{len(made)} bytes of page, at most {LARGEST_BYTES}: give fewer flights")
    try:
        arguments.out.write_bytes(made)
    except OSError as error:
        raise ConfigError(f"{arguments.out}: cannot write the page: {error.strerror}") from None
    print(f"{printable(str(arguments.out))}: {len(made) / 1e6:.2f} MB, open it in a browser")
    return 0
