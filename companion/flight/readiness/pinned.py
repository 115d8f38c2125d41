"""What the attitude response is made of: PX4's version and its gains, read before stand-by, compared, and then watched.

What the config states must be so. What it does not state is pinned as it was read: a later change of it means the same
as a difference from the config. A vehicle that does not tell its gains could be any.
"""

from __future__ import annotations

import math
from typing import Final

from companion.config.numbers import shortest
from companion.config.schema import Config
from companion.flight.readiness.parameters import (
    GAINS,
    HAS_REFERENCE_MODEL,
    REFERENCE_MODEL,
    ParameterReader,
    response_parameters,
    stale,
)
from companion.flight.vehicle_link.messages import Parameter
from companion.flight.vehicle_link.requests import Request, TellFirmware

_ASK_AGAIN_S: Final = 0.5
_PATIENCE_S: Final = 3.0  # for the version; a vehicle that does not tell it may have parameters all the same
_HOVER_THRUST: Final = "MPC_THR_HOVER"
HOVER_PLAUSIBLE: Final = 0.2  # share by which it may differ from the config's: further off, one of them is wrong


class Pinned:
    """Firmware and parameters of one vehicle.

    Args: `compare`, whether they are set beside what the config states, and pinned.
    Attributes: `over`, whether nothing more is waited for; `stale`, why the certificate does not hold for the vehicle
    as it is, None where it does or as long as that is not known.
    """

    def __init__(self, config: Config, *, compare: bool) -> None:
        self._compare = compare
        self._expected: dict[str, float] = dict(config.vehicle.parameters) if compare else {}
        self._stated_version = config.vehicle.px4_version if compare else None
        self._hover_thrust = config.vehicle.hover_thrust
        self._hover_wanted = config.vehicle.hover_thrust_source != "config"
        gains = GAINS if compare else ()
        self._parameters = ParameterReader([*([_HOVER_THRUST] if self._hover_wanted else []), *self._expected, *gains])
        self._version: tuple[int, int, int] | None = None
        self._began_s: float | None = None
        self._ask_s = -math.inf
        self._pinned: dict[str, float] = {}  # and not stated
        self.over = not compare and not self._hover_wanted
        self.stale: str | None = None

    @property
    def hover_thrust(self) -> float | None:
        """MPC_THR_HOVER, where `vehicle.hover_thrust_source` wants it and the vehicle has told one that can be true."""
        told = self._parameters.values.get(_HOVER_THRUST) if self._hover_wanted else None
        return told if told is not None and abs(told / self._hover_thrust - 1.0) <= HOVER_PLAUSIBLE else None

    def requests(self, now_s: float) -> list[Request]:
        """What to ask now."""
        if self.over:
            return []
        if self._began_s is None:
            self._began_s = now_s
        asked: list[Request] = [*self._parameters.requests(now_s)]
        if self._version_open(now_s) and now_s >= self._ask_s:
            self._ask_s = now_s + _ASK_AGAIN_S
            asked.append(TellFirmware())
        self._judge(now_s)
        return asked

    def on_firmware(self, version: tuple[int, int, int]) -> None:
        """The vehicle's version. Before stand-by, what that version has more is asked for too."""
        if self._version is None and self._compare and not self.over:
            self._version = version
            if version[:2] >= HAS_REFERENCE_MODEL:
                self._parameters.add(REFERENCE_MODEL)

    def on_parameter(self, parameter: Parameter) -> bool:
        """One that was told, also when somebody sets it later; whether `stale` has changed by it once all is over."""
        if not self.over:
            self._parameters.on_parameter(parameter)
            return False
        if parameter.name not in self._expected or not self._parameters.on_parameter(parameter):
            return False
        before, self.stale = self.stale, self._why_stale()
        return self.stale != before

    def remarks(self) -> list[str]:
        """What somebody should know before it flies, a line each."""
        lines = []
        if self._compare:
            version = "unknown version" if self._version is None else "{}.{}.{}".format(*self._version)
            pins = ", ".join(f"{name} {shortest(value)}" for name, value in self._pinned.items())
            gains = f"pinned as read: {pins}" if pins else "its gains are as the config says"
            lines.append(f"PX4 {version}; {gains}")
        if self._hover_wanted and self.hover_thrust is None:
            told = self._parameters.values.get(_HOVER_THRUST)
            why = "the vehicle does not tell it"
            if told is not None:
                why = f"{told:g} is more than {HOVER_PLAUSIBLE:.0%} from vehicle.hover_thrust, correct the wrong one"
            lines.append(f"{_HOVER_THRUST} is not believed ({why}): flying with vehicle.hover_thrust")
        return lines

    def _version_open(self, now_s: float) -> bool:
        """Whether the version is still waited for."""
        assert self._began_s is not None
        return self._compare and self._version is None and now_s - self._began_s <= _PATIENCE_S

    def _judge(self, now_s: float) -> None:
        if self._version_open(now_s) or not self._parameters.over(now_s):
            return
        self.over = True
        if self._compare:
            told = self._parameters.values
            wanted = response_parameters(self._version or (0, 0, 0))
            self._pinned = {name: told.get(name, math.nan) for name in wanted if name not in self._expected}
            self._expected |= self._pinned
            self.stale = self._why_stale()

    def _why_stale(self) -> str | None:
        told = self._parameters.values
        untold = [name for name, value in self._pinned.items() if math.isnan(value) and name not in told]
        if untold:
            return f"the vehicle does not tell {', '.join(untold)}: whether the certificate is for it, nobody knows"
        return stale(self._expected, told, self._stated_version, self._version)
