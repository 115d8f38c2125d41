"""`companion sitl`: fly the experiment and show the paper's numbers beside ours."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import NamedTuple

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from companion.commands.options import ConfigFile
from companion.config import Config
from companion.config.schema import PaperSection
from companion.flight.authority.states import Reason
from companion.flight.host.runtime import Status
from companion.record.folder import new_folder
from sitl.experiment.experiment import Job, Outcome, fly_all, realtime_factor, tick_rate_hz


class Arguments(NamedTuple):
    """Of `companion sitl` when it flies the experiment."""

    config: Config  # with a plant section
    config_file: ConfigFile
    hedging: bool | None
    realtime: bool
    port: int  # of the first plant; 0 any free one
    out: Path | None
    json: bool


def run(arguments: Arguments) -> int:
    """Fly one controller or both; print the table, draw the figures. 1 when a flight failed or was not stable."""
    config = arguments.config
    if arguments.hedging is None:
        controllers = ["hedged", "standard"]
    else:
        controllers = ["hedged" if arguments.hedging else "standard"]
    if config.mission.identification is not None:
        controllers = ["hedged"]  # it is the attitude loop that is measured
    folder = arguments.out or new_folder(Path("flights"), arguments.config_file.path.stem)
    console = Console(stderr=arguments.json)
    jobs = _jobs(arguments, folder, controllers)
    outcomes = {outcome.controller: outcome for outcome in _fly(jobs, console)}
    if any(o.summary.reason is Reason.OPERATOR for o in outcomes.values()):
        raise KeyboardInterrupt
    if config.mission.identification is not None:
        return _report_identification(outcomes["hedged"], arguments, console)
    flown = {name: outcome.flight for name, outcome in outcomes.items() if outcome.metrics is not None}
    from sitl.experiment.figures import draw_figures  # noqa: PLC0415 - matplotlib takes its time

    figures = draw_figures(config, flown, folder)
    report = _report(arguments.config_file.path, outcomes)
    (folder / "summary.json").write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
    if arguments.json:
        print(json.dumps(report))
    else:
        _print_table(config, outcomes, console)
        console.print(f"{len(figures)} figures, flight folders and summary.json in [bold]{folder}[/bold]")
    good = all(o.complete and o.metrics is not None and o.metrics.stable for o in outcomes.values())
    return 0 if good else 1


def _report_identification(outcome: Outcome, arguments: Arguments, console: Console) -> int:
    """Doublets are no stairs: there is no tracking to score, but a folder to go on with."""
    ended = outcome.summary.reason is Reason.MISSION_COMPLETE
    if arguments.json:
        told = {"complete": ended, "reason": outcome.summary.reason.value, "flights": [str(outcome.folder)]}
        print(json.dumps({"config": str(arguments.config_file.path), **told}))
    elif ended:
        console.print(
            f"doublets flown in {outcome.flown_s:.0f} s; next: companion identify {outcome.folder}", soft_wrap=True
        )
    return 0 if ended else 1


def _jobs(arguments: Arguments, folder: Path, controllers: list[str]) -> list[Job]:
    lockstep = not arguments.realtime
    cores = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else []
    return [
        Job(
            arguments.config,
            arguments.config_file.path,
            folder / controller,
            controller,
            arguments.config_file.overrides,
            lockstep,
            arguments.port + index if arguments.port else 0,
            cores[index % len(cores)] if lockstep and cores else None,
        )
        for index, controller in enumerate(controllers)
    ]


def _fly(jobs: list[Job], console: Console) -> list[Outcome]:
    """Fly them all, with a bar for each."""
    columns = (
        TextColumn("{task.description:<22}"),
        BarColumn(),
        TextColumn("{task.fields[note]}"),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=console, refresh_per_second=4) as progress:
        tasks = {
            job.controller: progress.add_task(
                f"{job.controller} MRAC", total=job.config.mission.duration_s, note="starting"
            )
            for job in jobs
        }

        def on_status(controller: str, status: Status) -> None:
            progress.update(tasks[controller], completed=status.elapsed_s, note=status.state.name.lower())

        outcomes = fly_all(jobs, on_status)
        for outcome in outcomes:
            pace = f"{outcome.flown_s / outcome.wall_s:.1f} x real time"
            progress.update(tasks[outcome.controller], completed=outcome.summary.engaged_s, note=pace)
    for outcome in outcomes:
        if not outcome.complete:
            console.print(f"[bold red]{outcome.controller} MRAC did not finish: {outcome.summary.detail}[/bold red]")
    return outcomes


def _report(config_path: Path, outcomes: dict[str, Outcome]) -> dict[str, object]:
    """The machine-readable contract of `companion sitl --json`."""
    return {
        "config": str(config_path),
        "realtime_factor": round(realtime_factor(list(outcomes.values())), 2),
        "controllers": {
            name: {
                "peak_error_m": o.metrics.peak_error_m if o.metrics else None,
                "rms_error_m": o.metrics.rms_error_m if o.metrics else None,
                "stable": bool(o.complete and o.metrics and o.metrics.stable),
                "tracking_rms_m": o.metrics.tracking_rms_m if o.metrics else None,
                "steady_error_m": o.metrics.steady_error_m if o.metrics and o.metrics.steady_error_m >= 0.0 else None,
            }
            for name, o in outcomes.items()
        },
        "flights": [str(o.folder) for o in outcomes.values()],
    }


def _print_table(config: Config, outcomes: dict[str, Outcome], console: Console) -> None:
    console.print(_own_table(outcomes) if config.paper is None else _paper_table(config.paper, outcomes))
    for name, outcome in outcomes.items():
        if outcome.metrics is not None and outcome.complete and not outcome.metrics.stable:
            console.print(
                f"[bold red]{name} MRAC is unstable:[/bold red] the error never settles and peaks at "
                f"{outcome.metrics.peak_error_m:.2f} m; lower its adaptation rate or tick faster"
            )
    flown = list(outcomes.values())
    console.print(
        f"flown at {realtime_factor(flown):.1f} x real time in all, {tick_rate_hz(flown):.0f} ticks a second over UDP"
    )


def _own_table(outcomes: dict[str, Outcome]) -> Table:
    """What a flight of one's own was like."""
    table = Table(title="Distance, m: from the ideal reference (x, y), the one tracked (x, y, z), the target at rest")
    table.add_column("controller")
    for heading in ("peak", "RMS", "tracking RMS", "at rest, worst stair"):
        table.add_column(heading, justify="right")
    for name, outcome in outcomes.items():
        metrics = outcome.metrics
        if metrics is None or not outcome.complete:
            table.add_row(name, f"[bold red]{outcome.summary.reason.value}[/bold red]", *["-"] * 3)
        elif not metrics.stable:
            table.add_row(name, "[bold red]UNSTABLE[/bold red]", *["-"] * 3)
        else:
            numbers = (metrics.peak_error_m, metrics.rms_error_m, metrics.tracking_rms_m, metrics.steady_error_m)
            table.add_row(name, *(f"{number:.3f}" for number in numbers))
    return table


def _paper_table(paper: PaperSection, outcomes: dict[str, Outcome]) -> Table:
    """The paper's figures and ours."""
    table = Table(title=f"{paper.table}: error against the ideal reference, m")
    table.add_column("controller")
    for metric in ("peak", "RMS"):
        for heading in (f"{metric} paper", f"{metric} ours", "off by"):
            table.add_column(heading, justify="right")
    for name, outcome in outcomes.items():
        row = [name]
        for metric in ("peak_error_m", "rms_error_m"):
            published = getattr(getattr(paper, name), metric)
            row.append(f"{published:.4f}")
            if outcome.metrics is None or not outcome.complete:
                row += ["failed", "-"]
            elif not outcome.metrics.stable:
                row += ["[bold red]UNSTABLE[/bold red]", "-"]
            else:
                ours = getattr(outcome.metrics, metric)
                row += [f"{ours:.4f}", f"{100.0 * (ours / published - 1.0):+.1f} %"]
        table.add_row(*row)
    return table
