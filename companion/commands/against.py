"""`companion sitl --against px4`: hedged, standard and PX4's own position control, side by side."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Final, NamedTuple

from rich.console import Console
from rich.table import Table

from companion.commands.options import ConfigFile
from companion.config import Config, ConfigError
from companion.record.folder import new_folder
from sitl.experiment.against import TITLES, Compared, compare

_STAIRS: Final = (
    "RMS distance from the ideal reference, m: by the truth less its mean, and by the estimate",
    ("truth along", "truth across", "estimate along", "estimate across"),
)
_PATH: Final = (
    "Distance from the trajectory while it moves, m: horizontal but for the last column",
    ("truth RMS", "truth peak", "estimate RMS", "truth RMS, height"),
)


class Arguments(NamedTuple):
    """Of `companion sitl --against`."""

    config: Config  # with a plant section
    config_file: ConfigFile
    out: Path | None
    json: bool


def run(arguments: Arguments) -> int:
    """Fly all three, print the table. 1 when one did not fly the mission to its end. Raises `ConfigError`."""
    config, path = arguments.config, arguments.config_file.path
    if config.plant is None or config.plant.quadrotor is None:
        raise ConfigError(f"{path}: --against px4 needs a quadrotor: PX4's position control does not fly a rig")
    ends = config.mission.duration_s is not None or config.mission.trajectories
    if not ends or config.mission.identification is not None:
        raise ConfigError(f"{path}: --against px4 needs a mission with a duration_s, or trajectories")
    folder = arguments.out or new_folder(Path("flights"), f"{path.stem}-against-px4")
    flown = compare(config, path, folder)
    report = {
        "config": str(path),
        "controllers": {c.controller: {"reason": c.reason, **(c.scores._asdict() if c.scores else {})} for c in flown},
    }
    folder.mkdir(parents=True, exist_ok=True)
    figures = []
    if config.mission.trajectories:
        from sitl.experiment.path_figures import draw_path_figures  # noqa: PLC0415 - matplotlib takes its time

        figures = draw_path_figures({c.controller: c.track for c in flown if c.track is not None}, folder)
    (folder / "summary.json").write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
    if arguments.json:
        print(json.dumps(report))
    else:
        console = Console()
        console.print(_table(flown, *(_PATH if config.mission.trajectories else _STAIRS)))
        if figures:
            console.print(f"{len(figures)} figures and summary.json in [bold]{folder}[/bold]", soft_wrap=True)
    return 0 if all(c.scores is not None for c in flown) else 1


def _table(flown: list[Compared], title: str, headings: tuple[str, ...]) -> Table:
    """A row a controller, its scores in the order of the headings."""
    table = Table(title=title)
    table.add_column("controller")
    for heading in headings:
        table.add_column(heading, justify="right")
    for c in flown:
        if c.scores is None:
            table.add_row(TITLES[c.controller], f"[bold red]{c.reason}[/bold red]", *["-"] * (len(headings) - 1))
        else:
            table.add_row(TITLES[c.controller], *(f"{value:.3f}" for value in c.scores))
    return table
