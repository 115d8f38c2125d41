"""YAML as this project reads it: a number is the decimal number that a person sees, or it is refused.

PyYAML follows YAML 1.1, where `010` is 8, `1:30` is 90, `0x1F` is 31, `1_000` is 1000 and `1e-3` is a word, and it
drops digits that a double cannot hold. The certificate speaks of the numbers as written, so that none of this may
happen silently: a number is decimal digits without leading zeros, with a point and an exponent as wanted, and the
shortest text of the double that is flown equals it.
"""

from __future__ import annotations

import math
import re
import struct
from decimal import Decimal
from typing import Any, Final

import yaml

from companion.config.text.bounded_yaml import BoundedLoader

MOST_DIGITS: Final = 100  # characters of a number; to read a longer one costs the square of its length
_PLAIN: Final = re.compile(r"[-+]?(?:(?:0|[1-9][0-9]*)(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][-+]?[0-9]+)?")
_DIGITS: Final = re.compile(r"[-+]?[0-9]+")
_TOO_LONG: Final = f"is longer than the {MOST_DIGITS} characters of a number"
_INT, _FLOAT, _STR = (f"tag:yaml.org,2002:{name}" for name in ("int", "float", "str"))


class Loader(BoundedLoader):
    """Also refuses a key given twice, where PyYAML would silently keep the last."""

    def compose_mapping_node(self, anchor: Any) -> yaml.MappingNode:
        """Every mapping comes through here."""
        node = super().compose_mapping_node(anchor)
        seen: set[tuple[str, str]] = set()
        for key_node, _ in node.value:  # as written: what a merge key brings in comes later and may be overridden
            if not isinstance(key_node, yaml.ScalarNode):
                raise yaml.composer.ComposerError(None, None, "a key must be a word", key_node.start_mark)
            key = (key_node.tag, key_node.value)
            if key in seen:
                raise yaml.composer.ComposerError(None, None, f"key {key_node.value} given twice", key_node.start_mark)
            seen.add(key)
        return node

    def construct_number(self, node: yaml.ScalarNode) -> object:
        """What YAML 1.1 takes for a number. Infinities and nan pass: the schema refuses them by key."""
        if len(node.value) > MOST_DIGITS:
            _refuse(node, _TOO_LONG)
        if not _PLAIN.fullmatch(node.value):
            read = self.construct_yaml_int(node) if node.tag == _INT else self.construct_yaml_float(node)
            if math.isfinite(read):
                _refuse(node, f"is no plain decimal number, and YAML would read {read}: write what is meant")
            return read
        return int(node.value) if _DIGITS.fullmatch(node.value) else _exact(node)

    def construct_word(self, node: yaml.ScalarNode) -> object:
        """What YAML 1.1 takes for a word, among them `1e-3` and `08`."""
        if node.style is not None:  # in quotes, or a block of text
            return node.value
        if len(node.value) > MOST_DIGITS:
            if _PLAIN.fullmatch(node.value):
                _refuse(node, _TOO_LONG)
            return node.value
        if _PLAIN.fullmatch(node.value):
            return _exact(node)
        if _number_to_python(node.value):
            _refuse(node, "is no plain decimal number: write decimal digits, or quotes around a word")
        return node.value


def read_yaml(text: str) -> Any:
    """What a text says. Raises one of `NOT_YAML`."""
    return yaml.load(text, Loader=Loader)


# PyYAML lets its constructors' own errors out: a date of month 13, an integer that is none.
NOT_YAML: Final = (yaml.YAMLError, ValueError, TypeError, AttributeError)


def kept(value: int) -> bool:
    """Whether an integer is kept as a double."""
    try:
        return int(float(value)) == value
    except OverflowError:
        return False


def shortest(value: float) -> str:
    """A number in the fewest digits, at least six, that are read back as the same.

    PX4 keeps 32 bits: a value that 32 bits hold exactly is read back as those, by which it is compared; any other as
    the same double.
    """
    kept = float32 if float32(value) == value else float
    return next((told for digits in range(6, 17) if kept(told := f"{value:.{digits}g}") == value), repr(value))


def float32(value: float | str) -> float:
    """The value that 32 bits keep of a number; infinite beyond them."""
    try:
        return float(struct.unpack("<f", struct.pack("<f", float(value)))[0])
    except OverflowError:
        return math.copysign(math.inf, float(value))


def _exact(node: yaml.ScalarNode) -> float:
    value = float(node.value)
    try:
        same = not math.isfinite(value) or Decimal(node.value) == Decimal(repr(value))
    except ArithmeticError:  # an exponent beyond any
        same = False
    if not same:
        _refuse(node, f"has more digits than are kept: write {value!r}")
    return value


def _number_to_python(text: str) -> bool:
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False


def _refuse(node: yaml.ScalarNode, why: str) -> None:
    shown = node.value if len(node.value) <= 40 else f"{node.value[:37]}..."
    raise yaml.constructor.ConstructorError(None, None, f"{shown} {why}", node.start_mark)


Loader.add_constructor(_INT, Loader.construct_number)
Loader.add_constructor(_FLOAT, Loader.construct_number)
Loader.add_constructor(_STR, Loader.construct_word)
