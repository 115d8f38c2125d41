"""The `link` and `tick` sections: the way to the autopilot, and how often the loop runs."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from companion.config.base import Id, Positive, Section


class LinkSection(Section):
    """The way to the autopilot, and who we are on it."""

    url: str
    connect_timeout_s: Positive = 10.0
    system_id: Id = 1
    component_id: Id = 191


class TickSection(Section):
    """How often the loop runs: the rate asked of the autopilot, and the rate below which we do not fly."""

    rate_hz: Annotated[float, Field(gt=0.0, le=1000.0)]
    floor_hz: Positive

    @model_validator(mode="after")
    def _floor_below_rate(self) -> TickSection:
        if self.floor_hz > self.rate_hz:
            raise ValueError(f"floor_hz ({self.floor_hz:g}) must not be above rate_hz ({self.rate_hz:g})")
        return self
