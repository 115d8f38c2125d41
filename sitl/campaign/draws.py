"""What differs from flight to flight: distributions over keys of the config, each flight's draw its own.

plant.mismatch.mass: {uniform: [0.8, 1.2]}
plant.mismatch.drag: {log_uniform: [0.5, 2]}
plant.setpoint_delay_s: {normal: [0.03, 0.005], within: [0.01, 0.06]}       # mean and standard deviation
plant.wind.mean_ned_m_s: {uniform: [[-4, -4, 0], [4, 4, 0]]}                # of a list: number by number
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from companion.config import ConfigError
from companion.config.numbers import NOT_YAML, read_yaml

KINDS: Final = ("uniform", "log_uniform", "normal")
_TRIES: Final = 10_000
_LIKELY: Final = 5.0  # standard deviations: a normal distribution must reach what it must lie within
_MOST_BYTES: Final = 1_000_000


class Distribution(NamedTuple):
    """Of one key. Two numbers, or lists of numbers, and what the value must lie within."""

    key: str
    kind: str
    first: tuple[float, ...]
    second: tuple[float, ...]
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    of_list: bool


class Draw(NamedTuple):
    """One flight's: overrides of the config, and the same as columns of a table."""

    overrides: tuple[str, ...]
    columns: dict[str, float]


def read_distributions(path: Path) -> tuple[Distribution, ...]:
    """The file of `--vary`. Raises `ConfigError`, one line that names the key."""
    try:
        with path.open(encoding="utf-8") as stream:
            data = read_yaml(stream.read(_MOST_BYTES))
    except OSError as error:
        raise ConfigError(f"--vary {path}: {error.strerror}") from None
    except UnicodeDecodeError:
        raise ConfigError(f"--vary {path}: not a text file") from None
    except NOT_YAML:
        raise ConfigError(f"--vary {path}: not valid YAML") from None
    if not isinstance(data, dict) or not data:
        raise ConfigError(f"--vary {path}: write a line for each key, as plant.mismatch.mass: {{uniform: [0.8, 1.2]}}")
    found = []
    for key, value in data.items():
        try:
            found.append(distribution(str(key), value))
        except ValueError as error:
            raise ConfigError(f"--vary {path}: {key}: {error}") from None
    return tuple(found)


def distribution(key: str, value: Any) -> Distribution:
    """One key's, as it is written. Raises `ValueError`."""
    if not isinstance(value, dict):
        raise ValueError(f"write a distribution: {', '.join(KINDS)}")
    within = value.get("within", [-math.inf, math.inf])
    kinds = [kind for kind in value if kind != "within"]
    if len(kinds) != 1 or kinds[0] not in KINDS:
        raise ValueError(f"write one of {', '.join(KINDS)}, and within where it is bounded")
    (first, second), (lower, upper) = _pair(value[kinds[0]]), _pair(within)
    size = max(map(len, (first, second)))
    first, second, lower, upper = (_spread(part, size) for part in (first, second, lower, upper))
    of_list = isinstance(value[kinds[0]][0], list)
    one = Distribution(key, kinds[0], first, second, lower, upper, of_list)
    for a, b, least, most in zip(first, second, lower, upper, strict=True):
        if not (math.isfinite(a) and math.isfinite(b)):
            raise ValueError("a distribution needs finite numbers")
        if not least <= most:
            raise ValueError(f"within is upside down: {least:g} to {most:g}")
        if one.kind == "normal":
            if b < 0.0:
                raise ValueError(f"a standard deviation is not negative, as {b:g}")
            if not (a - _LIKELY * b <= most and least <= a + _LIKELY * b):
                raise ValueError(f"a mean of {a:g} and a deviation of {b:g} never come within {least:g} to {most:g}")
        elif a > b or (one.kind == "log_uniform" and a <= 0.0):
            raise ValueError(f"{one.kind} from {a:g} to {b:g} is impossible")
        elif b < least or a > most:
            raise ValueError(f"{a:g} to {b:g} never comes within {least:g} to {most:g}")
    return one


def _pair(value: Any) -> tuple[tuple[float, ...], tuple[float, ...]]:
    if not isinstance(value, list) or len(value) != 2:
        raise ValueError("two numbers are wanted, or two lists of numbers")
    parts = []
    for part in value:
        numbers = part if isinstance(part, list) and part else [part]
        if not all(isinstance(number, int | float) and not isinstance(number, bool) for number in numbers):
            raise ValueError("two numbers are wanted, or two lists of numbers")
        parts.append(tuple(map(float, numbers)))
    return parts[0], parts[1]


def _spread(part: tuple[float, ...], size: int) -> tuple[float, ...]:
    if len(part) not in (1, size):
        raise ValueError("the lists are not of one length")
    return part * size if len(part) == 1 else part


def draw(distributions: tuple[Distribution, ...], seed: int, flight: int) -> Draw:
    """What flight number `flight` of a campaign of this seed is flown with; the same whoever flies it, and when.

    The plant's own seed, of noise and turbulence, is drawn too.
    """
    random = np.random.default_rng([seed, flight])
    plant_seed = int(random.integers(2**31))
    overrides, columns = [f"plant.seed={plant_seed}"], {"plant.seed": float(plant_seed)}
    for one in distributions:
        values = [_number(one, place, random) for place in range(len(one.first))]
        overrides.append(f"{one.key}={values if one.of_list else values[0]!r}")
        for place, value in enumerate(values):
            columns[f"{one.key}[{place}]" if one.of_list else one.key] = value
    return Draw(tuple(overrides), columns)


def _number(one: Distribution, place: int, random: np.random.Generator) -> float:
    a, b, lower, upper = one.first[place], one.second[place], one.lower[place], one.upper[place]
    for _ in range(_TRIES):
        if one.kind == "normal":
            value = float(random.normal(a, b))
        elif one.kind == "uniform":
            value = float(random.uniform(a, b))
        else:
            value = math.exp(random.uniform(math.log(a), math.log(b)))
        if lower <= value <= upper:
            return value
    raise ConfigError(f"{one.key}: {_TRIES} draws and none within {lower:g} to {upper:g}")
