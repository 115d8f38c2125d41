"""Change values in a YAML text and leave every other character where it was."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import yaml

from companion.config import numbers

KeyPath = tuple[str, ...]

_FIGURE = re.compile(r"[0-9]")
_TRAILING = re.compile(r"(?:^|(?<=\s))[ \t]*#.*$")


class _Place(NamedTuple):
    """Where a value stands in the text, and the key before it; the anchor, if it has one, stays."""

    key_start: int
    start: int
    end: int
    anchor: str


def edited(
    text: str,
    changes: Mapping[KeyPath, str],
    notes: Mapping[KeyPath, str] | None = None,
    *,
    drop_figures: bool = False,
) -> str:
    """The text with other values.

    Parameters
    ----------
    text
        A YAML document whose outermost node is a mapping.
    changes
        New value, as YAML in flow style, by key path. An alias is replaced where it stands, an anchor is kept.
    notes
        By key path, a comment for the line above the key, in place of one there that begins with the same word.
    drop_figures
        Leave out the comments beside a value that changes, above it, in it and on its line, that have a digit in them:
        they speak of the value before.

    Raises
    ------
    KeyError
        For a path that the text does not have.
    """
    if drop_figures:
        text = _without_figures(text, changes)
    places = _places(text)
    newline = "\r\n" if "\r\n" in text else "\n"
    edits: list[tuple[int, int, str]] = []  # from, to, and what comes there
    remarks: dict[int, list[str]] = {}  # by the start of the line that they go above
    for path, value in changes.items():
        place = places[path]
        anchor = f"&{place.anchor} " if place.anchor else ""
        edits.append((place.start, place.end, anchor + value))
        above = remarks.setdefault(text.rfind("\n", 0, place.key_start) + 1, [])
        if notes and path in notes:
            above.append(f"# {notes[path]}")
        inside = re.findall(r"(?:^|(?<=\s))#[^\r\n]*", text[place.start : place.end])
        above += [remark.rstrip() for remark in inside]  # kept, on lines of their own
    for line_start, lines in remarks.items():
        indent = re.match(r"[ \t]*", text[line_start:])
        assert indent is not None  # it matches nothing, too
        first = line_start
        previous = text[:line_start].rstrip("\r\n").rfind("\n") + 1
        said = text[previous:line_start].lstrip()
        if any(line.split(" ", 2)[:2] == said.split(" ", 2)[:2] for line in lines if said.startswith("# ")):
            first = previous  # of the time before
        edits.append((first, line_start, "".join(f"{indent.group()}{line}{newline}" for line in lines)))
    for start, end, new in sorted(edits, reverse=True):  # from the end: places before stay true
        text = text[:start] + new + text[end:]
    return text


def _without_figures(text: str, changes: Mapping[KeyPath, str]) -> str:
    """The text without the comments beside the values that change that have a digit in them."""
    places = _places(text)
    lines = text.splitlines(keepends=True)
    gone: set[int] = set()  # lines that are nothing but a comment
    for path, value in changes.items():
        place = places[path]
        if _equal(text[place.start : place.end], value):
            continue
        first, last = (text.count("\n", 0, at) for at in (place.key_start, max(place.end - 1, place.start)))
        section = text.count("\n", 0, places[path[:-1]].key_start) if path[:-1] in places else first
        heads = {first, section} if section == first - 1 else {first}  # of the section where it begins with the key
        for head in heads:
            gone |= _speaking(lines, range(head - 1, -1, -1), 0)
        indent = len(lines[first]) - len(lines[first].lstrip())
        for number in range(first, last + 1):
            bare = _TRAILING.sub("", lines[number].rstrip("\r\n"))
            comment = lines[number][len(bare) :]
            below = _speaking(lines, range(number + 1, len(lines)), indent + 1)  # where a comment goes on
            if not bare.strip():
                gone |= {number} if _FIGURE.search(comment) else set()
            elif _FIGURE.search(comment) or (comment.strip() and below):
                lines[number] = bare.rstrip() + ("\r\n" if comment.endswith("\r\n") else "\n")
                gone |= below or _comments(lines, range(number + 1, len(lines)), indent + 1)
    return "".join(line for number, line in enumerate(lines) if number not in gone)


def _equal(old: str, new: str) -> bool:
    """Whether two texts of a value mean the same; an alias means what it stands for, which is not looked up."""
    try:
        return bool(yaml.load(old, Loader=numbers.Loader) == yaml.load(new, Loader=numbers.Loader))
    except yaml.YAMLError:
        return False


def _comments(lines: list[str], numbers_of_lines: range, least_indent: int) -> set[int]:
    """The lines of one block of comment, from where it begins."""
    block: set[int] = set()
    for number in numbers_of_lines:
        said = lines[number].lstrip(" \t")
        if not said.startswith("#") or len(lines[number]) - len(said) < least_indent:
            break
        block.add(number)
    return block


def _speaking(lines: list[str], numbers_of_lines: range, least_indent: int) -> set[int]:
    """A block of comment that has a digit in it; empty for any other."""
    block = _comments(lines, numbers_of_lines, least_indent)
    return block if any(_FIGURE.search(lines[number]) for number in block) else set()


def added(text: str, section: str, key: str, value: str) -> str:
    """The text with one more key, before the first of an outermost section in block style; as it was for any other."""
    before_the_first = re.compile(
        rf"^{section}:[ \t]*(?:#.*)?\n(?:[ \t]*(?:#.*)?\n)*(?=(?P<indent>[ \t]+)[^\s#{{&*])", re.MULTILINE
    )
    return before_the_first.sub(lambda m: f"{m[0]}{m['indent']}{key}: {value}\n", text, count=1)


def flow(values: Mapping[str, float | Sequence[float]]) -> str:
    """A mapping of numbers and lists of numbers as YAML in flow style, each as `numbers.shortest` writes it."""

    def plain(value: float | Sequence[float]) -> str:
        return (
            f"[{', '.join(map(numbers.shortest, value))}]" if isinstance(value, Sequence) else numbers.shortest(value)
        )

    return f"{{{', '.join(f'{key}: {plain(value)}' for key, value in values.items())}}}"


def key_paths(text: str) -> frozenset[KeyPath]:
    """Every path of keys that the text itself has; what an alias brings in is not there twice."""
    return frozenset(_places(text))


def _places(text: str) -> dict[KeyPath, _Place]:
    """Every value under string keys, by its path."""
    events = [
        e for e in yaml.parse(text, Loader=yaml.SafeLoader) if isinstance(e, yaml.NodeEvent | yaml.CollectionEndEvent)
    ]
    places: dict[KeyPath, _Place] = {}
    _walk(events, 0, (), places)
    return places


def _walk(events: list[Any], at: int, path: KeyPath, places: dict[KeyPath, _Place]) -> tuple[int, int]:
    """Walk one node from `events[at]`; the index behind it and where its text ends."""
    event = events[at]
    end = event.end_mark.index
    at += 1
    if isinstance(event, yaml.SequenceStartEvent):
        while not isinstance(events[at], yaml.SequenceEndEvent):
            at, end = _walk(events, at, (*path, "-"), {})
    elif isinstance(event, yaml.MappingStartEvent):
        while not isinstance(events[at], yaml.MappingEndEvent):
            key = events[at]
            at, _ = _walk(events, at, (), {})
            name = str(key.value) if isinstance(key, yaml.ScalarEvent) else "?"
            value = events[at]
            at, end = _walk(events, at, (*path, name), places)
            anchor = "" if isinstance(value, yaml.AliasEvent) else value.anchor or ""
            places[(*path, name)] = _Place(key.start_mark.index, value.start_mark.index, end, anchor)
    else:
        return at, end
    if event.flow_style:  # a block's own mark lies behind the comments that follow it
        end = events[at].end_mark.index
    return at + 1, end
