"""`companion sitl --scenarios`: fly the list, show what was expected and what happened."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from pathlib import Path
from typing import NamedTuple

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from companion.commands.options import ConfigFile
from companion.config import ConfigError
from companion.record.folder import new_folder
from sitl.scenarios.campaign import fly_all
from sitl.scenarios.flight import Bases
from sitl.scenarios.index import by_name, pick
from sitl.scenarios.scenario import QUADROTOR, RIG, Flown

_WIDE = 130  # a terminal that has room for what happens in each


class Arguments(NamedTuple):
    """Of `companion sitl --scenarios`."""

    names: list[str]  # * and ? allowed; empty: all
    config: ConfigFile
    hedging: bool | None
    out: Path | None
    json: bool


def run(arguments: Arguments, shipped: Path) -> int:
    """Fly the scenarios named, or all. `shipped`: where the configs they build on are. 1 when one fails.

    With `--out` every flight folder stays there; without it those of failed scenarios stay, in a new folder.
    """
    try:
        names = pick(arguments.names)
    except KeyError as error:
        raise ConfigError(f"--scenarios {error.args[0]}: no such scenario (without a name all are flown)") from None
    given = arguments.config.path
    quadrotor = given if given.parent != shipped else shipped / QUADROTOR
    overrides = list(arguments.config.overrides)
    if arguments.hedging is not None:
        overrides.append(f"controller.hedging={str(arguments.hedging).lower()}")
    bases = Bases({QUADROTOR: quadrotor, RIG: shipped / RIG}, tuple(overrides))
    console = Console(stderr=arguments.json)
    with tempfile.TemporaryDirectory(prefix="companion-scenarios-") as temporary:
        folder = arguments.out or Path(temporary)
        flown = _fly(names, bases, folder, console)
        kept = folder if arguments.out else _keep_failed(flown, folder)
    if arguments.json:
        print(json.dumps(report(flown)))
    else:
        _print_table(flown, console)
    if kept is not None:
        console.print(f"flight folders in [bold]{kept}[/bold]")
    return 0 if all(one.passed for one in flown) else 1


def report(flown: list[Flown]) -> dict[str, object]:
    """The machine-readable contract of `companion sitl --scenarios --json`."""
    return {
        "passed": sum(one.passed for one in flown),
        "failed": sum(not one.passed for one in flown),
        "scenarios": [
            {
                "name": one.name,
                "passed": one.passed,
                "reason": one.reason,
                "worst_error_m": None if one.worst_error_m is None else round(one.worst_error_m, 6),
            }
            for one in flown
        ],
    }


def _fly(names: list[str], bases: Bases, folder: Path, console: Console) -> list[Flown]:
    workers = min(len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 2, len(names))
    columns = (TextColumn("{task.description:<28}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, refresh_per_second=4) as progress:
        task = progress.add_task("scenarios", total=len(names))

        def on_flown(one: Flown) -> None:
            progress.update(task, advance=1, description=one.name)
            if not one.passed:
                progress.console.print(f"[bold red]{one.name}[/bold red]: {'; '.join(one.problems)}", highlight=False)

        return fly_all(names, bases, folder, on_flown, workers)


def _keep_failed(flown: list[Flown], folder: Path) -> Path | None:
    failed = [folder / one.name for one in flown if not one.passed and (folder / one.name).exists()]
    if not failed:
        return None
    kept = new_folder(Path("flights"), "scenarios")
    for each in failed:
        shutil.move(str(each), str(kept / each.name))
    return kept


def _print_table(flown: list[Flown], console: Console) -> None:
    explained = console.width >= _WIDE
    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False, show_edge=False)
    table.add_column("scenario", no_wrap=True)
    if explained:
        table.add_column("what happens")
    table.add_column("expected", no_wrap=True)
    table.add_column("happened", no_wrap=True)
    table.add_column("err, m", justify="right", no_wrap=True)
    table.add_column("verdict", min_width=7)
    for one in flown:
        table.add_row(
            one.name,
            *([by_name(one.name).about] if explained else []),
            one.expected,
            one.reason,
            "-" if one.worst_error_m is None else f"{one.worst_error_m:.3f}",
            "passed" if one.passed else f"[bold red]failed[/bold red]: {'; '.join(one.problems)}",
        )
    console.print(table)
    passed = sum(one.passed for one in flown)
    console.print(f"{passed} of {len(flown)} scenarios passed")
