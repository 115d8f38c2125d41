"""YAML that cannot cost more than it looks like: how much text, how deep, how many values aliases make of it.

An alias is a few characters for as much as its anchor holds, and anchors may hold aliases: ten lines can stand for more
values than a computer has memory for. PyYAML builds them all once somebody copies or checks what it has read.
"""

from __future__ import annotations

from typing import Any, Final

import yaml

MOST_CHARACTERS: Final = 1_000_000
MOST_DEPTH: Final = 30
MOST_VALUES: Final = 50_000  # as read: what an alias stands for counts each time


class BoundedLoader(yaml.SafeLoader):
    """Refuses, where it stands, what passes a bound, before any of it is built."""

    def __init__(self, text: str) -> None:
        if len(text) > MOST_CHARACTERS:
            raise yaml.constructor.ConstructorError(None, None, f"more than {MOST_CHARACTERS} characters", None)
        super().__init__(text)
        self._depth = 0
        self._values = 0
        self._values_of: dict[int, int] = {}  # by the identity of a node: what an alias for it stands for

    def compose_node(self, parent: Any, index: Any) -> yaml.Node | None:
        """Every node and every alias comes through here."""
        event: Any = self.peek_event()  # type: ignore[no-untyped-call]
        before, self._depth = self._values, self._depth + 1
        if self._depth > MOST_DEPTH:
            self._refuse(event, f"nested more than {MOST_DEPTH} deep")
        node = super().compose_node(parent, index)
        if isinstance(event, yaml.AliasEvent):
            if id(node) not in self._values_of:
                self._refuse(event, f"alias {event.anchor} stands for what it is itself in")
            self._values += self._values_of[id(node)]
        else:
            self._values += 1
            self._values_of[id(node)] = self._values - before
        if self._values > MOST_VALUES:
            self._refuse(event, f"more than {MOST_VALUES} values, with what aliases stand for")
        self._depth -= 1
        return node

    def _refuse(self, event: Any, why: str) -> None:
        raise yaml.constructor.ConstructorError(None, None, why, event.start_mark)
