"""The vehicle's parameters over our own link: asked for by name, collected, and set beside what was certified.

Each by its name, no mavsdk: the flying process needs a handful of values once, before stand-by, and a library with
threads of its own is no company for the loop. PX4 answers an unknown name with silence.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Final, NamedTuple

from companion.config.numbers import shortest
from companion.flight.vehicle_link.messages import Parameter
from companion.flight.vehicle_link.requests import ReadParameter

_LOOP: Final = ("ROLL", "PITCH")
GAINS: Final = (
    *(f"MC_{axis}_P" for axis in (*_LOOP, "YAW")),
    *(f"MC_{axis}RATE_{term}" for axis in _LOOP for term in "PIDK"),
)
"""What the attitude response is made of, besides the airframe."""
REFERENCE_MODEL: Final = ("MC_REF_W_N", "MC_REF_FF", "MC_REF_FF_MAX")
HAS_REFERENCE_MODEL: Final = (1, 18)
"""From here on a model stands in front of the attitude controller. Source: `mc_att_control_params.yaml`."""

_AT_ONCE: Final = 4  # requests a call: what a slow serial line takes beside the set-points
_ASK_AGAIN_S: Final = 0.5
_PATIENCE_S: Final = 5.0


def response_parameters(version: tuple[int, int, int]) -> tuple[str, ...]:
    """Those that PX4 of this version makes its attitude response of."""
    return GAINS + REFERENCE_MODEL if version[:2] >= HAS_REFERENCE_MODEL else GAINS


class Difference(NamedTuple):
    """A parameter that is not what it was when the attitude response was identified; `found` is None if untold."""

    name: str
    expected: float
    found: float | None

    def __str__(self) -> str:
        if self.found is None:
            return f"the vehicle does not tell {self.name}"
        return f"{self.name} is {shortest(self.found)}, was {shortest(self.expected)}"


class ParameterReader:
    """Reads some parameters of one autopilot, whatever the link loses.

    Attributes: `values` by name, as far as they have been told.
    """

    def __init__(self, names: Iterable[str]) -> None:
        self._asked_s = dict.fromkeys(names, -math.inf)
        self._began_s: float | None = None
        self.values: dict[str, int | float] = {}

    @property
    def missing(self) -> list[str]:
        """Names not told yet."""
        return [name for name in self._asked_s if name not in self.values]

    @property
    def done(self) -> bool:
        """Whether every one has been told."""
        return len(self.values) == len(self._asked_s)

    def add(self, names: Iterable[str]) -> None:
        """More to read."""
        self._asked_s = {**dict.fromkeys(names, -math.inf), **self._asked_s}

    def over(self, now_s: float) -> bool:
        """Whether there is nothing left to wait for: all told, or the patience at its end."""
        return self.done or (self._began_s is not None and now_s - self._began_s > _PATIENCE_S)

    def requests(self, now_s: float) -> list[ReadParameter]:
        """What to ask now: a few at a time, each again while it stays unanswered."""
        if self.over(now_s):
            return []
        if self._began_s is None:
            self._began_s = now_s
        due = [name for name in self.missing if now_s - self._asked_s[name] >= _ASK_AGAIN_S][:_AT_ONCE]
        for name in due:
            self._asked_s[name] = now_s
        return [ReadParameter(name) for name in due]

    def on_parameter(self, parameter: Parameter) -> bool:
        """One that was told; whether it was among those asked for."""
        if parameter.name not in self._asked_s:
            return False
        self.values[parameter.name] = parameter.value
        return True


def differences(expected: Mapping[str, float], found: Mapping[str, float]) -> list[Difference]:
    """What is not as expected, in the order of `expected`. Equal means equal as the 32 bits of the vehicle's store."""
    return [
        Difference(name, value, found.get(name)) for name, value in expected.items() if not same(value, found.get(name))
    ]


def same(expected: float, found: float | None) -> bool:
    """Whether a value is what the vehicle stores for `expected`."""
    if found is None:
        return False
    if isinstance(found, int):
        return found == expected
    return math.isclose(expected, found, rel_tol=1e-6, abs_tol=1e-12)  # float32 keeps seven digits


def stale(
    expected: Mapping[str, float],
    found: Mapping[str, float],
    px4_version: str | None = None,
    version: tuple[int, int, int] | None = None,
) -> str | None:
    """Why the certificate does not hold for the vehicle as it is, as one line; None when it does.

    `px4_version` as the config states it, None where it does not; `version` as the vehicle tells it.
    """
    changed = [str(difference) for difference in differences(expected, found)]
    if px4_version is not None and version is None:
        changed.insert(0, "the vehicle does not tell its firmware's version")
    elif px4_version is not None and version is not None and not same_version(px4_version, version):
        changed.insert(0, f"PX4 is {version[0]}.{version[1]}, was {px4_version}")
    if not changed:
        return None
    return f"the certificate is stale, its attitude response was identified otherwise: {', '.join(changed)}"


def same_version(px4_version: str, version: tuple[int, int, int]) -> bool:
    """Whether a vehicle has the version that a config states: major and minor."""
    return px4_version == f"{version[0]}.{version[1]}"
