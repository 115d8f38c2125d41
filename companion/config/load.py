"""Read a config file. Whatever is wrong with it ends as one line that names the file, the key and the reason."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml
from pydantic import ValidationError

from companion.config.schema import Config


class ConfigError(Exception):
    """A config that cannot be used; the message is one line for a person."""


class _UniqueKeys(yaml.SafeLoader):
    """YAML that refuses a key given twice, where PyYAML would silently keep the last."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen: set[Any] = set()
        for key_node, _ in node.value:
            key = self.construct_object(key_node, deep=True)
            if key in seen:
                raise yaml.constructor.ConstructorError(None, None, f"key {key} given twice", key_node.start_mark)
            seen.add(key)
        return super().construct_mapping(node, deep)


def parse_override(text: str) -> tuple[list[str], Any]:
    """``a.b.c=value`` from the command line as the path of a key and its YAML value."""
    path, equals, value = text.partition("=")
    if not equals or not path:
        raise ConfigError(f"--set {text}: write it as section.key=value")
    try:
        return path.strip().split("."), yaml.safe_load(value)
    except yaml.YAMLError:
        raise ConfigError(f"--set {text}: {value!r} is not a YAML value") from None


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
    first = problems[0]
    key = ".".join(str(part) for part in first["loc"] if not str(part).startswith(("tuple[", "constrained", "float")))
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
    return text + (f" (and {more} more)" if more else "")


def load_config(path: Path, overrides: tuple[str, ...] = ()) -> Config:
    """Read, override and validate a config file.

    `overrides` are ``section.key=value`` texts. Raises `ConfigError`.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise ConfigError(f"{path}: no such file") from None
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not a text file"
        raise ConfigError(f"{path}: {reason}") from None
    try:
        data = yaml.load(text, Loader=_UniqueKeys)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f" line {mark.line + 1}" if mark else ""
        problem = getattr(error, "problem", None) or "not valid YAML"
        raise ConfigError(f"{path}{where}: {problem}") from None
    if not isinstance(data, dict):
        raise ConfigError(f"{path}: not a config (a mapping of sections is expected)")
    data = _unshared(data)
    for override in overrides:
        _apply(data, *parse_override(override))
    try:
        return Config.model_validate(data)
    except ValidationError as error:
        raise ConfigError(f"{path}: {_one_line(error)}") from None
