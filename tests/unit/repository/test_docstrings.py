"""Every public function says what it does, and one that lists its parameters lists all; nothing dodges the walls."""

from __future__ import annotations

import ast
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest
from pymavlink.dialects.v20 import development as mavlink

ROOT = Path(__file__).resolve().parents[3]
FILES = sorted(path for package in ("companion", "sitl") for path in (ROOT / package).rglob("*.py"))
# A heading with a list below it, as numpy has it, or one that the list begins on the line of.
LISTED = re.compile(r"^(Parameters\n-+|Args:)", re.MULTILINE)


class Function(NamedTuple):
    """A public function, class or method, and where it is."""

    where: str
    name: str
    node: ast.FunctionDef | ast.ClassDef
    method: bool

    @property
    def documented(self) -> bool:
        return bool(ast.get_docstring(self.node))


def public(path: Path) -> Iterator[Function]:
    """All of a file."""
    place = path.relative_to(ROOT)

    def within(node: ast.AST, *, method: bool) -> Iterator[Function]:
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.FunctionDef | ast.ClassDef) and not child.name.startswith("_"):
                yield Function(f"{place}:{child.lineno}: {child.name}", child.name, child, method)
                if isinstance(child, ast.ClassDef):
                    yield from within(child, method=True)

    yield from within(ast.parse(path.read_text(encoding="utf-8")), method=False)


EVERYTHING = [function for path in FILES for function in public(path)]
# What a protocol has said need not be said again by those who keep to it.
SAID = {function.name for function in EVERYTHING if function.method and function.documented}


def explained(function: Function) -> bool:
    """By itself, by a protocol, or by MAVLink: a builder of a message bears the message's name."""
    is_message = f"MAVLINK_MSG_ID_{function.name.upper()}" in vars(mavlink)
    return function.documented or (function.method and (function.name in SAID or is_message))


def test_every_public_function_has_a_docstring() -> None:
    assert len(EVERYTHING) > 700
    assert [function.where for function in EVERYTHING if not explained(function)] == []


def test_every_module_has_a_docstring() -> None:
    assert [str(path) for path in FILES if not ast.get_docstring(ast.parse(path.read_text(encoding="utf-8")))] == []


def unlisted(node: ast.FunctionDef | ast.ClassDef) -> list[str]:
    """Parameters that a docstring which lists parameters does not name."""
    function = node
    if isinstance(node, ast.ClassDef):
        function = next((f for f in node.body if isinstance(f, ast.FunctionDef) and f.name == "__init__"), node)
    text = ast.get_docstring(node) or ""
    if not isinstance(function, ast.FunctionDef) or not LISTED.search(text):
        return []
    arguments = [*function.args.posonlyargs, *function.args.args, *function.args.kwonlyargs]
    names = [argument.arg for argument in arguments if argument.arg not in ("self", "cls")]
    return [name for name in names if not re.search(rf"\b{re.escape(name)}\b", text)]


def test_where_parameters_are_listed_all_of_them_are() -> None:
    missing = {f.where: names for f in EVERYTHING if (names := unlisted(f.node))}
    assert missing == {}


@pytest.mark.parametrize("text", ["Args:\n    one: first.", "Parameters\n----------\none\n    First."])
def test_the_test_sees_a_parameter_that_is_not_listed(text: str) -> None:
    (node,) = ast.parse(f'def f(one, two):\n    """Do.\n\n    {text}\n    """').body
    assert isinstance(node, ast.FunctionDef)
    node.body[0].value.value = f"Do.\n\n{text}\n"  # type: ignore[attr-defined]
    assert unlisted(node) == ["two"]


def imported(nodes: list[ast.stmt]) -> set[str]:
    """Modules imported by these statements, and below them."""
    found = [node for statement in nodes for node in ast.walk(statement)]
    names = {alias.name for node in found if isinstance(node, ast.Import) for alias in node.names}
    return names | {node.module or "" for node in found if isinstance(node, ast.ImportFrom)}


@pytest.mark.parametrize("path", [p for p in FILES if "TYPE_CHECKING" in p.read_text(encoding="utf-8")], ids=str)
def test_an_import_for_the_type_checker_alone_is_one_that_is_only_late(path: Path) -> None:
    """What is heavy may be imported where it is needed; what is nowhere imported in earnest goes round the walls."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    hidden = [node for node in tree.body if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)]
    late = imported([node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)])
    assert imported([statement for node in hidden for statement in node.body]) <= late


def test_the_walls_hold_for_the_type_checker_s_imports_too() -> None:
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"]
    assert not settings.get("exclude_type_checking_imports", False)
