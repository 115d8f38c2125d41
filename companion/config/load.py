"""Read a config file. Whatever is wrong with it ends as one line that names the file, the key and the reason."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

import yaml
from pydantic import ValidationError

from companion.config.mission import MissionSection
from companion.config.numbers import NOT_YAML, read_yaml
from companion.config.schema import Config
from companion.config.text.bounded_yaml import MOST_CHARACTERS
from companion.errors import CompanionError


class ConfigError(CompanionError):
    """A config that cannot be used; the message is one line for a person."""


_LONGEST_LINE = 400  # of a complaint: a word in a file may be as long as the file


def parse_override(text: str) -> tuple[list[str], Any]:
    """``a.b.c=value`` from the command line as the path of a key and its YAML value."""
    path, equals, value = text.partition("=")
    keys = [key.strip() for key in path.split(".")]
    if not equals or not all(keys):
        raise ConfigError(f"--set {text}: write it as section.key=value")
    try:
        return keys, read_yaml(value)
    except yaml.constructor.ConstructorError as error:
        raise ConfigError(f"--set {_cut(text)}: {error.problem}") from None
    except NOT_YAML:
        raise ConfigError(f"--set {_cut(text)}: {_cut(repr(value))} is not a YAML value") from None


def _unshared(value: Any) -> Any:
    """A copy in which no two keys share a mapping, as YAML aliases do: an override of one must not change the other."""
    if isinstance(value, dict):
        return {key: _unshared(below) for key, below in value.items()}
    return [_unshared(below) for below in value] if isinstance(value, list) else value


def _apply(data: dict[str, Any], path: list[str], value: Any) -> None:
    for key in path[:-1]:
        below = data.setdefault(key, {})
        if not isinstance(below, dict):
            raise ConfigError(f"--set {'.'.join(path)}: {key} is not a section")
        data = below
    data[path[-1]] = value


def _one_line(error: ValidationError) -> str:
    """The first thing wrong, and how many more there are."""
    problems = error.errors()
    # An unknown key explains a missing one; the deeper complaint about a union is the one about what was meant.
    first = next((p for p in problems if p["type"] == "extra_forbidden"), problems[0])
    stem = [part for part in first["loc"] if not str(part).startswith(("tuple[", "constrained", "float", "function-"))]
    first = max(
        (p for p in problems if list(p["loc"])[: len(stem)] == stem), key=lambda p: len(p["loc"]), default=first
    )
    key = ".".join(
        repr(part)[1:-1] if isinstance(part, str) else str(part)
        for part in first["loc"]
        if not str(part).startswith(("tuple[", "constrained", "float", "function-"))
    )
    if first["type"] == "extra_forbidden":
        text = f"{key}: unknown key"
    elif first["type"] == "missing":
        text = f"{key}: missing"
    else:
        reason = first["msg"].removeprefix("Value error, ")
        reason = reason[0].lower() + reason[1:]
        value = first.get("input")
        given = f" (it is {value!r})" if not isinstance(value, Mapping | list) else ""
        text = f"{key}: {reason}{given}" if key else reason
    more = len(problems) - 1
    return _cut(text) + (f" (and {more} more)" if more else "")


def _read(path: Path) -> Any:
    """The content of a YAML file. Raises `ConfigError`."""
    try:
        with path.open(encoding="utf-8") as stream:
            text = stream.read(MOST_CHARACTERS + 1)
    except FileNotFoundError:
        raise ConfigError(f"{path}: no such file") from None
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not a text file"
        raise ConfigError(f"{path}: {reason}") from None
    return _parse(text, path)


def _parse(text: str, path: Path) -> Any:
    try:
        return _unshared(_yaml(text))
    except NOT_YAML as error:
        mark = getattr(error, "problem_mark", None)
        where = f" line {mark.line + 1}" if mark else ""
        problem = getattr(error, "problem", None) or "not valid YAML"
        raise ConfigError(f"{path}{where}: {_cut(problem)}") from None


def _cut(line: str) -> str:
    return line if len(line) <= _LONGEST_LINE else f"{line[:_LONGEST_LINE]}..."


@lru_cache(maxsize=8)
def _yaml(text: str) -> Any:
    """A program that flies many flights loads the same file for each."""
    return read_yaml(text)


def _with_mission_file(data: dict[str, Any], folder: Path) -> dict[str, Any]:
    """The config with the content of `mission.file` in its place; the keys beside `file` count more."""
    mission = data.get("mission")
    if not isinstance(mission, dict) or mission.get("file") is None:
        return data
    if not isinstance(mission["file"], str):
        raise ConfigError(f"mission.file: a path is wanted (it is {mission['file']!r})")
    path = folder / mission["file"]
    content = _read(path)
    if not isinstance(content, dict):
        raise ConfigError(f"{path}: not a mission (duration_s and waypoints are expected)")
    try:
        MissionSection.model_validate(content)
    except ValidationError as error:
        raise ConfigError(f"{path}: {_one_line(error)}") from None
    for trajectory in content.get("trajectories", ()):  # its files lie beside it
        for kind in ("samples", "plan"):
            if trajectory.get(kind) is not None:
                trajectory[kind]["file"] = str(path.parent.absolute() / trajectory[kind]["file"])
    beside = {key: value for key, value in mission.items() if key != "file"}
    return {**data, "mission": {**content, **beside}}


def load_config(path: Path, overrides: tuple[str, ...] = ()) -> Config:
    """Read, override and validate a config file, and the mission file that it names.

    `overrides` are ``section.key=value`` texts. Raises `ConfigError`.
    """
    return _config(_read(path), path, path.parent, overrides)


def load_text(text: str, name: Path, folder: Path) -> Config:
    """Validate the text of a config that is called `name` and whose paths start at `folder`. Raises `ConfigError`."""
    return _config(_parse(text, name), name, folder, ())


def _config(data: Any, path: Path, folder: Path, overrides: tuple[str, ...]) -> Config:
    if not isinstance(data, dict):
        raise ConfigError(f"{path}: not a config (a mapping of sections is expected)")
    for override in overrides:
        _apply(data, *parse_override(override))
    data = _with_mission_file(data, folder)
    try:
        return Config.model_validate(data, context={"folder": folder})
    except ValidationError as error:
        raise ConfigError(f"{path}: {_one_line(error)}") from None
