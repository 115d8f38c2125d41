"""`docs/config.md` from the schema: every key with its path, type, unit, default and meaning.

    python -m companion.config.reference > docs/config.md

A key's meaning is the text below it in the source, or the `description` of its field. pydantic could read the former
itself (`use_attribute_docstrings`), but it would parse the sources at each start of every command.
"""

from __future__ import annotations

import ast
import inspect
import re
import textwrap
from collections.abc import Iterable, Iterator, Mapping
from itertools import pairwise
from typing import Any, Final, NamedTuple, get_args

from pydantic import BaseModel

from companion.config.schema import Config

_UNITS: Final = {
    "_n_s2_m2": "N s²/m²",
    "_kg_m2": "kg m²",
    "_rad_s2": "rad/s²",
    "_m_s2": "m/s²",
    "_1_s2": "1/s²",
    "_rad_s": "rad/s",
    "_deg_s": "°/s",
    "_m_s": "m/s",
    "_1_s": "1/s",
    "_m2": "m²",
    "_hz": "Hz",
    "_deg": "°",
    "_kg": "kg",
    "_s": "s",
    "_m": "m",
}  # fmt: skip - by the end of a key's name, the longer ones first
_BRACKETS: Final = re.compile(r"\[([^\]]+)\]\s+")
_GUARD: Final = {"enabled", "limit", "timeout_s"}

_HEAD: Final = """\
# Config files

Written by `python -m companion.config.reference` from the schema in `companion/config/`: do not edit it here.

A config is YAML. An unknown key, a key given twice and a value out of its range are refused in one line that names
the key. `--set section.key=value` changes one key for one command. A number is decimal digits as a person reads them,
and as many as a double keeps: `010`, `1:30`, `0x1F` and `1_000`, which YAML reads as 8, 90, 31 and 1000, are refused,
and so is a number in quotes. Frames are local NED and body FRD. A key's unit is in its name where it has one; a unit of
1 is a pure number. The files in [`config/`](../config) are examples; numbers in parentheses are equations of the paper.
"""
_GUARDS_HEAD: Final = """\
Every guard has up to three keys. `enabled`: whether it is watched. `limit`: the most that is allowed, in the unit
below. `timeout_s`: for how long the limit must be exceeded, less the time in which it is not; 0 is at once. What a
file leaves out of a guard keeps its default. "derived": the limit follows from another section where none is given.
What it means when one ends control, and what to look at then: [guards.md](guards.md).
"""


class Key(NamedTuple):
    """One key: where it is, what it is for, and the section below it, if it is one."""

    path: str
    kind: str
    unit: str
    default: str
    meaning: str
    section: type[BaseModel] | None
    value: Any  # default of a section, from which those of its keys follow


def attribute_docs(model: type[BaseModel]) -> dict[str, str]:
    """The text below each attribute of a class and its bases; nothing for a class that has no source."""
    docs: dict[str, str] = {}
    for base in reversed(model.__mro__[: model.__mro__.index(BaseModel)]):
        try:
            tree = ast.parse(textwrap.dedent(inspect.getsource(base)))
        except (OSError, TypeError, SyntaxError):
            continue
        body = getattr(tree.body[0], "body", [])
        for before, after in pairwise(body):
            if (
                isinstance(before, ast.AnnAssign)
                and isinstance(before.target, ast.Name)
                and isinstance(after, ast.Expr)
                and isinstance(after.value, ast.Constant)
                and isinstance(after.value.value, str)
            ):
                docs[before.target.id] = after.value.value
    return docs


def keys(model: type[BaseModel], path: str = "", values: Any = None) -> Iterator[Key]:
    """The keys of one section, sections among them.

    Parameters
    ----------
    model
        The section's class.
    path
        Of the section, empty for the whole config.
    values
        An instance that the section is by default; its values count more than the defaults of its class.
    """
    docs, schema = attribute_docs(model), model.model_json_schema()
    if path.startswith("guards"):
        docs = {**dict.fromkeys(_GUARD, "As of every guard."), **docs}
    for name, field in model.model_fields.items():
        text = " ".join((field.description or docs.get(name, "")).split())
        given = _BRACKETS.match(text)
        meaning = _sentence(text[given.end() :] if given else text)
        default = getattr(values, name) if values is not None else field.get_default(call_default_factory=True)
        section = _section(field.annotation)
        listed = section is not None and "tuple" in str(field.annotation)
        yield Key(
            f"{path}.{name}".lstrip(".") + ("[]" if listed else ""),
            ("list of sections" if listed else "section") if section else _type(schema["properties"][name], schema),
            given[1] if given else next((unit for end, unit in _UNITS.items() if name.endswith(end)), ""),
            "required" if values is None and field.is_required() else _text(default),
            meaning,
            section,
            default if isinstance(default, BaseModel) else None,
        )


def all_keys(model: type[BaseModel] = Config, path: str = "", values: Any = None) -> Iterator[Key]:
    """Every key of a config, each section before what it holds."""
    for key in keys(model, path, values):
        yield key
        if key.section is not None:
            yield from all_keys(key.section, key.path, key.value)


def is_guard(key: Key) -> bool:
    """Whether a section is a guard: it has a row of its own in place of a table."""
    return key.section is not None and key.path.startswith("guards.") and set(key.section.model_fields) <= _GUARD


def markdown() -> str:
    """The whole page."""
    lines = [_HEAD, *_table(list(keys(Config)))]
    lines += _sections(Config, "", None, {})
    return "\n".join(lines) + "\n"


def _sections(model: type[BaseModel], path: str, values: Any, told: dict[type[BaseModel], str]) -> Iterator[str]:
    """What stands below a table: a heading and a table for each of its sections. `told`: where a section has been."""
    for key in keys(model, path, values):
        if key.section is None or is_guard(key):
            continue
        yield f"\n## `{key.path}`\n"
        if key.section in told:
            yield f"{key.meaning} The same keys as `{told[key.section]}`."
            continue
        told[key.section] = key.path
        yield (inspect.cleandoc(key.section.__doc__ or "") + "\n").lstrip("\n")
        below = list(keys(key.section, key.path, key.value))
        guards = [each for each in below if is_guard(each)]
        if guards:
            yield _GUARDS_HEAD
            yield from _guards(guards)
            yield ""
        yield from _table([each for each in below if each not in guards])
        yield from _sections(key.section, key.path, key.value, told)


def _table(rows: list[Key]) -> Iterator[str]:
    if not rows:
        return
    yield "| key | type | unit | default | meaning |"
    yield "|---|---|---|---|---|"
    for row in rows:
        yield _row(f"`{row.path}`", row.kind, row.unit, row.default, row.meaning)


def _guards(rows: list[Key]) -> Iterator[str]:
    yield "| guard | unit | enabled | limit | timeout_s | meaning |"
    yield "|---|---|---|---|---|---|"
    for row in rows:
        default = {} if row.value is None else dict(row.value)
        limit = "derived" if default.get("limit") is None else _text(default["limit"])
        enabled, timeout = _text(default.get("enabled")), _text(default.get("timeout_s"))
        yield _row(f"`{row.path}`", row.unit or "1", enabled, limit, timeout, row.meaning)


def _row(*cells: str) -> str:
    return f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |"


def _section(annotation: Any) -> type[BaseModel] | None:
    """The section that an annotation means, itself, optional or in a list."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    found = (_section(argument) for argument in get_args(annotation))
    return next((section for section in found if section is not None), None)


def _sentence(text: str) -> str:
    """With a capital and a full stop."""
    first = text[:1].upper() if text[:1].isascii() else text[:1]  # a Greek letter is a symbol
    return f"{first}{text[1:].removesuffix('.')}." if text else ""


def _text(value: Any) -> str:
    """A default, as YAML would have it."""
    if value is None or value in ({}, ()):
        return "none"
    if isinstance(value, BaseModel):
        return "see below"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return f"{value:g}"
    if isinstance(value, tuple):
        return f"[{', '.join(_text(each) for each in value)}]"
    return str(value)


def _type(schema: Mapping[str, Any], whole: Mapping[str, Any]) -> str:
    """A JSON schema in words."""
    if "$ref" in schema:
        return _type(whole["$defs"][schema["$ref"].rpartition("/")[2]], whole)
    kinds = [each for each in schema.get("anyOf", ()) if each.get("type") != "null"]
    if kinds:
        return ", or ".join(_type(each, whole) for each in kinds)
    if "enum" in schema:
        return ", ".join(f"`{value}`" for value in schema["enum"])
    kind = str(schema.get("type"))
    if kind == "array":
        one = schema.get("items") or schema["prefixItems"][0]
        length = f" {schema['maxItems']}" if "maxItems" in schema else ""
        return f"list of{length}: {_type(one, whole)}"
    if kind == "object":
        values = {**schema.get("patternProperties", {}), "": schema.get("additionalProperties")}
        one = next(each for each in values.values() if isinstance(each, Mapping))
        return f"names, each with: {_type(one, whole)}"
    if kind in ("number", "integer"):
        return kind + _bounds(schema)
    if kind == "boolean":
        return "true, false"
    return "path" if schema.get("format") == "path" else "text"


def _bounds(schema: Mapping[str, Any]) -> str:
    signs = (("exclusiveMinimum", ">"), ("minimum", "≥"), ("exclusiveMaximum", "<"), ("maximum", "≤"))
    bounds = [f"{sign} {schema[name]:g}" for name, sign in signs if name in schema]
    return f" {', '.join(bounds)}" if bounds else ""


def undocumented(found: Iterable[Key]) -> list[str]:
    """Paths of keys without a meaning, and of numbers without a unit."""
    return [key.path for key in found if not key.meaning or (not key.unit and _is_quantity(key))]


def _is_quantity(key: Key) -> bool:
    guarded = key.path.startswith("guards.") and key.path.endswith(".limit")  # its unit is that of the guard
    return "number" in key.kind and not key.kind.startswith("names") and not guarded


if __name__ == "__main__":
    print(markdown(), end="")
