"""Change values in a YAML text and leave every other character where it was."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any, NamedTuple

import yaml

KeyPath = tuple[str, ...]


class _Place(NamedTuple):
    """Where a value stands in the text, and the key before it; the anchor, if it has one, stays."""

    key_start: int
    start: int
    end: int
    anchor: str


def edited(text: str, changes: Mapping[KeyPath, str], notes: Mapping[KeyPath, str] | None = None) -> str:
    """The text with other values.

    Parameters
    ----------
    text
        A YAML document whose outermost node is a mapping.
    changes
        New value, as YAML in flow style, by key path. An alias is replaced where it stands, an anchor is kept.
    notes
        By key path, a comment for the line above the key, in place of one there that begins with the same word.

    Raises
    ------
    KeyError
        For a path that the text does not have.
    """
    places = _places(text)
    for path in sorted(changes, key=lambda p: places[p].start, reverse=True):  # from the end: marks before stay true
        place = places[path]
        old = text[place.start : place.end]
        newline = "\r\n" if "\r\n" in text else "\n"
        line_start = text.rfind("\n", 0, place.key_start) + 1
        indent = re.match(r"[ \t]*", text[line_start:])
        assert indent is not None  # it matches nothing, too
        remarks = re.findall(r"(?:^|(?<=\s))#[^\r\n]*", old)  # inside the old value: kept, on lines of their own
        above = text[:line_start]
        note = (notes or {}).get(path)
        if note is not None:
            previous = above.rstrip("\r\n").rfind("\n") + 1
            if above[previous:].lstrip().startswith(f"# {note.split(' ', 1)[0]} "):
                above = above[:previous]
            remarks.insert(0, f"# {note}")
        lines = "".join(f"{indent.group()}{remark.rstrip()}{newline}" for remark in remarks)
        anchor = f"&{place.anchor} " if place.anchor else ""
        text = above + lines + text[line_start : place.start] + anchor + changes[path] + text[place.end :]
    return text


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
