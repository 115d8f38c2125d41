"""The `plant` section: the simulated vehicle that `companion sitl` flies. The real vehicle never reads it."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, model_validator

from companion.config.base import NonNegative
from companion.config.plant.disturbances import MismatchSection, RadioSection, SensorsSection, WindSection
from companion.config.vehicles import VehiclePlants


def _as_text(version: Any) -> Any:
    """A version without quotes is a number to YAML."""
    return str(version) if isinstance(version, float) else version


class Plant(VehiclePlants):
    """The vehicle that `companion sitl` simulates: one of the two kinds, its autopilot's parameters, and everything
    that keeps it from being ideal. The real vehicle never reads it."""

    setpoint_delay_s: NonNegative = 0.0
    """Transport delay of set-points in front of the attitude loop."""
    px4_version: Annotated[Literal["1.17", "1.18"], BeforeValidator(_as_text)] = "1.17"
    """The PX4 that the autopilot behaves as. In 1.18 attitude set-points pass a reference model first (MC_REF_W_N)."""
    parameters: dict[str, int | float] = Field(default_factory=dict)
    """PX4 parameters by name, those that the plant has in that version. The others keep its defaults."""
    telemetry: Literal["even", "px4"] = "even"
    """When ODOMETRY and CURRENT_MODE come: `even`, at the rate asked for and without delay; `px4`, as PX4 v1.17 sends
    them: of samples 8 ms apart, up to 5 ms late, CURRENT_MODE twice a second and when it changes, resets counted."""
    seed: int = 1
    """Of all that is random. The same seed gives the same flight."""
    mismatch: MismatchSection = MismatchSection()
    """The true vehicle against the believed one."""
    wind: WindSection | None = None
    """Wind."""
    battery_sag_1_s: NonNegative = 0.0
    """Share of the thrust lost a second."""
    sensors: SensorsSection | None = None
    """Noise and age of the estimate."""
    link: RadioSection | None = None
    """What the radio does to frames."""

    @model_validator(mode="after")
    def _no_wind_on_guides(self) -> Plant:
        if self.wind is not None and not self.kind.can_fly:
            raise ValueError(f"wind does not reach a {self.kind.name}: its guides hold it")
        return self
