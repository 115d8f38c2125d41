"""`companion campaign`: many flights of one config in the compiled closed loop, drawn from distributions."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any, NamedTuple

from companion.commands.options import ConfigFile, add_config, add_json, config_file
from companion.config import ConfigError


class Arguments(NamedTuple):
    """Of `companion campaign`."""

    config: ConfigFile
    flights: int
    vary: Path | None
    seed: int
    workers: int
    hedging: bool | None
    out: Path | None
    json: bool


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what the command takes."""
    add_config(parser)
    parser.add_argument("--flights", type=int, default=1000, metavar="N", help="how many (default: 1000)")
    parser.add_argument("--vary", type=Path, metavar="FILE", help="YAML: distributions of keys of the config")
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="of all that is drawn (default: 1)")
    parser.add_argument("--workers", type=int, default=1, metavar="N", help="processes that fly (default: 1)")
    parser.add_argument(
        "--hedging", action=argparse.BooleanOptionalAction, default=None, help="the hedged or the standard controller"
    )
    parser.add_argument("--out", type=Path, metavar="DIR", help="where the table is; one begun there is gone on with")
    add_json(parser)


def parse(namespace: argparse.Namespace) -> Arguments:
    """The arguments as a record. Raises `ConfigError`."""
    for name, least in (("flights", 1), ("workers", 1), ("seed", 0)):
        if getattr(namespace, name) < least:
            raise ConfigError(f"--{name} {getattr(namespace, name)}: at least {least} is wanted")
    return Arguments(
        config_file(namespace),
        namespace.flights,
        namespace.vary,
        namespace.seed,
        namespace.workers,
        namespace.hedging,
        namespace.out,
        namespace.json,
    )


def run(arguments: Arguments) -> int:
    """Fly what is missing, and tell. Raises `CompanionError`."""
    from companion.commands.campaign.report import report_of, tell  # noqa: PLC0415
    from companion.record.folder import new_folder  # noqa: PLC0415 - `--help` needs none of it
    from sitl.campaign.compiled import require  # noqa: PLC0415
    from sitl.campaign.draws import read_distributions  # noqa: PLC0415
    from sitl.campaign.results import Results  # noqa: PLC0415
    from sitl.campaign.run import Campaign  # noqa: PLC0415

    require()
    path, overrides, _ = arguments.config
    vary = () if arguments.vary is None else read_distributions(arguments.vary)
    campaign = Campaign(path, overrides, vary, arguments.seed, arguments.hedging)
    identity = campaign.identity()
    campaign.config(0)  # whatever is wrong with a key is said before anything is written
    folder = arguments.out or new_folder(Path("flights"), "campaign")
    results = Results(folder, identity)
    flown, cpu_s = _fly(campaign, results, arguments)
    report = report_of(results, arguments.flights, flown / cpu_s if flown else None)
    if arguments.json:
        print(json.dumps(report))
    else:
        tell(report)
    return 0


def _fly(campaign: Any, results: Any, arguments: Arguments) -> tuple[int, float]:
    """How many were flown, and the processor time that they took."""
    from rich.console import Console  # noqa: PLC0415
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn  # noqa: PLC0415

    from sitl.campaign.run import fly_all  # noqa: PLC0415

    batches = results.missing(arguments.flights)
    flown, cpu_s, left = 0, 0.0, sum(map(len, batches))
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), refresh_per_second=4) as progress:
        task = progress.add_task("flights", total=arguments.flights, completed=arguments.flights - left)
        for batch in fly_all(campaign, batches, arguments.workers):
            results.add(batch.batch, batch.rows)
            flown, cpu_s = flown + len(batch.rows), cpu_s + batch.cpu_s
            progress.advance(task, len(batch.rows))
    return flown, cpu_s
