"""The table of commands: each row works, starts light, and keeps argparse to itself."""

from __future__ import annotations

import importlib
import subprocess
import sys
from pathlib import Path
from typing import Any, get_type_hints

import pytest

from companion.cli import COMMANDS, read_command_line

ROOT = Path(__file__).resolve().parents[3]
HEAVY = {"numpy", "scipy", "cvxpy", "clarabel", "matplotlib", "mavsdk", "pyulog", "mcap"}
LIGHT = (
    "run",
    "check",
    "identify",
    "vehicle",
    "logs",
    "sitl",
    "campaign",
)  # `design` still imports its work at its top


def imported(code: str, *arguments: str) -> set[str]:
    """The modules imported by a fresh interpreter that runs `code`, which may exit."""
    shown = f"import sys\ntry:\n {code}\nexcept SystemExit: pass\nprint(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", shown, *arguments], capture_output=True, text=True, check=True, cwd=ROOT
    )
    return {name.split(".")[0] for name in done.stdout.splitlines()[-1].split()}


MAIN = "from companion.cli import main; main()"


def test_help_lists_every_command_and_imports_nothing_to_speak_of() -> None:
    assert not imported(MAIN, "--help") & (HEAVY | {"pydantic", "pymavlink", "rich", "serial", "yaml"})
    done = subprocess.run(
        [sys.executable, "-m", "companion", "--help"], capture_output=True, text=True, check=True, cwd=ROOT
    )
    for command in COMMANDS:
        assert f" {command.name} " in done.stdout
        assert command.summary in done.stdout


@pytest.mark.parametrize("name", LIGHT)
def test_a_command_imports_its_work_when_there_is_work(name: str) -> None:
    assert not imported(MAIN, name, "--help") & HEAVY


def test_run_imports_neither_numpy_nor_a_solver() -> None:
    assert not imported("import companion.commands.run") & HEAVY


def test_a_served_plant_imports_neither_numpy_nor_plots() -> None:
    assert not imported("import companion.commands.serve") & HEAVY


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command.name)
def test_a_command_reads_its_arguments_into_a_record_of_its_own(command: Any) -> None:
    module = importlib.import_module(command.module)
    record = get_type_hints(module.parse)["return"]
    assert record is module.Arguments
    assert get_type_hints(module.run) == {"arguments": record, "return": int}


def test_what_was_typed_arrives_in_the_record() -> None:
    _, arguments = read_command_line(
        ["run", "a.yaml", "--set", "b.c=1", "--identify", "--no-hedging", "--link", "udpin://0.0.0.0:1"]
    )
    assert arguments.config == (Path("a.yaml"), ("mission={identification: {}}", "b.c=1"), False)
    assert (arguments.hedging, arguments.link, arguments.engage) == (False, "udpin://0.0.0.0:1", False)


def test_argparse_is_known_to_the_commands_alone() -> None:
    knowing = {
        path.relative_to(ROOT).as_posix()
        for package in ("companion", "sitl")
        for path in (ROOT / package).rglob("*.py")
        if "argparse" in path.read_text(encoding="utf-8")
    }
    assert knowing == {
        "companion/cli.py",
        "companion/commands/options.py",
        *(Path(str(importlib.import_module(row.module).__file__)).relative_to(ROOT).as_posix() for row in COMMANDS),
    }
