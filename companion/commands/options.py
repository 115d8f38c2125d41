"""Options that several commands share, each declared once."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import NamedTuple

from companion.commands.missions import NAMES, overrides
from companion.config import Config, ConfigError, load_config
from companion.config.plausible import slips


class ConfigFile(NamedTuple):
    """The config a command was given: the file, and the keys that the command line overrides, `section.key=value`."""

    path: Path
    overrides: tuple[str, ...]
    anyway: bool = True  # whether implausible values are taken: by whom they do not concern, or who is told to

    def load(self) -> Config:
        """The config as overridden. Raises `ConfigError`, for values that only a slip of unit explains too."""
        config = load_config(self.path, self.overrides)
        if not self.anyway:
            refuse_slips(config, self.path)
        return config


def refuse_slips(config: Config, path: Path) -> None:
    """Raises `ConfigError` for values that only a slip of unit explains, with a line for the first."""
    first, *more = [*slips(config), ""]
    if first:
        further = f" (and {len(more) - 1} more)" if len(more) > 1 else ""
        raise ConfigError(f"{path}: {first}{further}; --anyway if it is meant so")


def shipped_config() -> Path:
    """`config/` of the checkout, or its copy inside an installed package."""
    package = Path(__file__).parents[1]
    shipped = package / "shipped_config"
    return shipped if shipped.exists() else package.parent / "config"


def add_config(parser: argparse.ArgumentParser, default: Path | None = None) -> None:
    """The config file, optional where there is a default, and `--set`."""
    parser.add_argument("config", type=Path, nargs="?" if default else None, default=default)
    parser.add_argument(
        "--set",
        dest="overrides",
        metavar="KEY=VALUE",
        action="append",
        default=[],
        help="override one key of the config, as in --set controller.axes.x.adaptation_rate.standard=200",
    )


def config_file(namespace: argparse.Namespace) -> ConfigFile:
    """What `add_config` declared; `--identify` and `--mission` are overrides too, and what `--set` says counts more.

    Raises `ConfigError`.
    """
    identify = getattr(namespace, "identify", False)
    first = ["mission={identification: {}}"] if identify else []
    if hasattr(namespace, "mission"):
        first += overrides(namespace.mission, namespace.speed, stretch=namespace.stretch, identify=identify)
    return ConfigFile(namespace.config, (*first, *namespace.overrides), getattr(namespace, "anyway", True))


def add_anyway(parser: argparse.ArgumentParser) -> None:
    """`--anyway`, of the commands that act on the numbers."""
    parser.add_argument("--anyway", action="store_true", help="take values too that only a slip of unit explains")


def add_flight(parser: argparse.ArgumentParser) -> None:
    """`--identify`, `--mission` and `--hedging`: what is flown, and by which controller."""
    parser.add_argument(
        "--mission",
        metavar="NAME|FILE",
        help=f"fly {', '.join(NAMES)}, a mission in YAML, samples (CSV, Parquet), or a .plan instead of the config's",
    )
    parser.add_argument(
        "--speed", type=float, metavar="M_S", help="largest speed of a circle or lemniscate (default: 1)"
    )
    parser.add_argument("--stretch", action="store_true", help="slow a trajectory that asks for too much until it fits")
    parser.add_argument(
        "--identify",
        action="store_true",
        help="fly attitude doublets for `companion identify` instead of the mission",
    )
    parser.add_argument(
        "--hedging",
        action=argparse.BooleanOptionalAction,
        default=None,
        help="fly only the hedged or only the standard controller",
    )


def add_tool_link(parser: argparse.ArgumentParser) -> None:
    """`--link` of the commands that ask the vehicle and change nothing."""
    parser.add_argument("--link", help="as for run, or unix://PATH; default: the config's, or what `run` shares of it")


def add_json(parser: argparse.ArgumentParser) -> None:
    """`--json`."""
    parser.add_argument("--json", action="store_true", help="one JSON object on stdout and nothing else")


def add_logs(parser: argparse.ArgumentParser) -> None:
    """The logs to identify from."""
    parser.add_argument("logs", type=Path, nargs="+", metavar="LOG", help="PX4 ULog, tlog or flight folder")
