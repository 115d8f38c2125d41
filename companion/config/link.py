"""The `link` and `tick` sections: the way to the autopilot, and how often the loop runs."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from companion.config.base import NUMBER, FileBesideConfig, Id, Positive, Section


class LinkSection(Section):
    """The way to the autopilot, who we are on it, and the key that proves it."""

    url: str
    """`udpin://HOST:PORT` listens, `udpout://HOST:PORT` calls, `serial://DEVICE:BAUD` is a tty. The option `--link`
    counts more."""
    connect_timeout_s: Positive = 10.0
    """Without a heartbeat of the vehicle for so long the flight is given up (`no_vehicle`)."""
    system_id: Id = 1
    """The companion's own MAVLink system id, the vehicle's as a rule."""
    component_id: Id = 191
    """The companion's own MAVLink component id; 191 is MAV_COMP_ID_ONBOARD_COMPUTER."""
    signing_key_file: FileBesideConfig | None = None
    """Key of MAVLink signing: a file of 32 bytes or 64 hexadecimal digits that not everybody may read. A relative path
    starts at the config's folder. Given, all that is sent is signed and only signed frames are believed."""


class TickSection(Section):
    """How often the loop runs: the rate asked of the autopilot, and the rate below which we do not fly."""

    rate_hz: Annotated[float, Field(gt=0.0, le=1000.0), NUMBER]
    """Rate of ODOMETRY asked of the autopilot. Each sample is one tick. PX4
    in simulation sends 125 Hz for whatever more is asked."""
    floor_hz: Positive
    """Slowest rate that flies: below it control does not begin. The adaptation rates are certified for it, and it is
    the default limit of `guards.pose_rate_hz`."""

    @model_validator(mode="after")
    def _floor_below_rate(self) -> TickSection:
        if self.floor_hz > self.rate_hz:
            raise ValueError(f"floor_hz ({self.floor_hz:g}) must not be above rate_hz ({self.rate_hz:g})")
        return self
