"""The documents: links lead somewhere, paths exist, every room has its sentence, and the README is short."""

from __future__ import annotations

import ast
import re
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md")])
FENCED = re.compile(r"^```.*?^```", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"\]\(([^)\s]+)\)")
CODE_PATH = re.compile(r"`((?:companion|sitl|tests|benchmarks|config|docs|systemd)/[\w./-]*)`")
PLACEHOLDER = re.compile(r"\bNAME\b")


def prose(page: Path) -> str:
    """A page without its examples."""
    return FENCED.sub("", page.read_text(encoding="utf-8"))


def anchors(page: Path) -> set[str]:
    """What its headings are called in a link, as GitHub has it."""
    headings = re.findall(r"^#+ +(.+)$", prose(page), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_and_paths_lead_somewhere(page: Path) -> None:
    broken = []
    for link in LINK.findall(prose(page)):
        if "://" in link:
            continue
        place, _, anchor = link.partition("#")
        target = (page.parent / place).resolve() if place else page
        if not target.exists() or (anchor and anchor not in anchors(target)):
            broken.append(link)
    paths = [path for path in CODE_PATH.findall(prose(page)) if not PLACEHOLDER.search(path)]
    broken += [path for path in paths if not (ROOT / path).exists()]
    assert broken == []


def test_every_page_is_reached_from_the_readme() -> None:
    reached, queue = set(), [ROOT / "README.md"]
    while queue:
        page = queue.pop()
        if page in reached or page.suffix != ".md":
            continue
        reached.add(page)
        links = (link.partition("#")[0] for link in LINK.findall(prose(page)) if "://" not in link)
        queue += [(page.parent / link).resolve() for link in links if link and (page.parent / link).exists()]
    assert sorted(str(page.relative_to(ROOT)) for page in set(PAGES) - reached) == []


def test_every_room_has_its_sentence() -> None:
    told = set(re.findall(r"^\| `((?:companion|sitl)/[\w/]*)`", prose(ROOT / "docs/architecture.md"), re.MULTILINE))
    rooms = {
        f"{folder.parent.relative_to(ROOT)}/"
        for package in ("companion", "sitl")
        for folder in [*ROOT.glob(f"{package}/*/__init__.py"), *ROOT.glob(f"{package}/flight/*/__init__.py")]
    }
    assert {room for room in told if room.endswith("/")} == rooms | {"sitl/"}


def test_the_readme_is_for_ten_minutes() -> None:
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= 150


def test_the_readme_has_the_test_command_of_ci() -> None:
    commands = [line for line in (ROOT / "README.md").read_text(encoding="utf-8").splitlines() if "pytest" in line]
    assert commands, ".ci/run looks for it"
    subprocess.run(["bash", "-n", "-c", commands[0]], check=True, timeout=10)  # it is a command
    assert "-m pytest" in commands[0]


def test_public_functions_and_classes_say_what_they_are() -> None:
    """Modules too; methods may leave it to their class or protocol."""
    silent = []
    for path in [*ROOT.glob("companion/**/*.py"), *ROOT.glob("sitl/**/*.py")]:
        module = ast.parse(path.read_text(encoding="utf-8"))
        named = [node for node in module.body if isinstance(node, ast.FunctionDef | ast.ClassDef)]
        public = [module, *(node for node in named if not node.name.startswith("_"))]
        silent += [f"{path}: {getattr(node, 'name', '')}" for node in public if not ast.get_docstring(node)]
    assert silent == []
