"""Whether the config makes sense beside this vehicle: its hover thrust, and whether it flies where a rig is meant."""

from __future__ import annotations

from typing import Final

from companion.config.plausible import hover_thrust
from companion.config.schema import Config
from companion.flight.readiness.parameters import ParameterReader
from companion.flight.vehicle_link.messages import Parameter
from companion.flight.vehicle_link.requests import Request

_HOVER_THRUST: Final = "MPC_THR_HOVER"
_FLIES_M: Final = 1.0  # above where its position counts from


class Plausible:
    """`anyway`: somebody insists. Attribute: `refused`, why the config makes no sense, as one line, or None."""

    def __init__(self, config: Config, *, anyway: bool) -> None:
        self._anyway = anyway
        self._hover_thrust = config.vehicle.hover_thrust
        self._rig = not config.vehicle_kind.can_fly
        self._parameters = ParameterReader([_HOVER_THRUST])
        self.refused: str | None = None

    def requests(self, now_s: float) -> list[Request]:
        """What to ask before stand-by; nothing waits for the answer."""
        return [] if self._anyway else [*self._parameters.requests(now_s)]

    def on_parameter(self, parameter: Parameter) -> None:
        """One that was told."""
        if self._parameters.on_parameter(parameter) and not self._anyway:
            why = hover_thrust(self._hover_thrust, parameter.value)
            self.refused = None if why is None else f"{why}, or insist by --anyway"

    def on_landed_state(self, height_m: float, *, landed: bool) -> None:
        """Where it says that it is. `height_m`: as its position tells."""
        if self._rig and not self._anyway and not landed and height_m > _FLIES_M:
            self.refused = (
                f"vehicle.kind is rig, whose height nobody controls, and this vehicle is in the air, {height_m:.1f} m "
                "up: take a quadrotor's config, or insist by --anyway"
            )
