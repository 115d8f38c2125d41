"""The `link` and `tick` sections: the way to the autopilot, and how often the loop runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from pydantic import Field, ValidationInfo, field_validator, model_validator

from companion.config.base import Id, Positive, Section


class LinkSection(Section):
    """The way to the autopilot, who we are on it, and the key that proves it."""

    url: str
    connect_timeout_s: Positive = 10.0
    system_id: Id = 1
    component_id: Id = 191
    signing_key_file: Path | None = None  # 32 bytes, or 64 hexadecimal digits; a relative path starts at the config

    @field_validator("signing_key_file")
    @classmethod
    def _beside_the_config(cls, path: Path | None, info: ValidationInfo) -> Path | None:
        folder = (info.context or {}).get("folder", Path())
        return None if path is None else Path(folder / path.expanduser()).absolute()


class TickSection(Section):
    """How often the loop runs: the rate asked of the autopilot, and the rate below which we do not fly."""

    rate_hz: Annotated[float, Field(gt=0.0, le=1000.0)]
    floor_hz: Positive

    @model_validator(mode="after")
    def _floor_below_rate(self) -> TickSection:
        if self.floor_hz > self.rate_hz:
            raise ValueError(f"floor_hz ({self.floor_hz:g}) must not be above rate_hz ({self.rate_hz:g})")
        return self
