"""The `guards` and `release` sections: every failsafe as enabled / limit / timeout, and what is asked for at the end.

A guard ends control when its limit has been exceeded for `timeout_s` without a break; 0 means at once. What a file
leaves out of a guard keeps its default.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from companion.config.attitude import AttitudeSection
from companion.config.base import NonNegative, Positive, Section, Vector


class GuardSection(Section):
    """One failsafe: on or off, the limit, and for how long it must be exceeded before control ends."""

    enabled: bool = True
    limit: Positive
    timeout_s: NonNegative = 0.0


class EventGuardSection(Section):
    """A failsafe against something that happens at once, so that there is nothing to wait for."""

    enabled: bool = True
    limit: Positive
    timeout_s: Annotated[NonNegative, Field(le=0.0)] = 0.0


class CountGuardSection(Section):
    """A failsafe whose limit is a number of things that may be so."""

    enabled: bool = True
    limit: NonNegative
    timeout_s: NonNegative = 0.0


class DerivedGuardSection(Section):
    """A failsafe whose limit, where it is not given, follows from another section."""

    enabled: bool = True
    limit: Positive | None = None
    timeout_s: NonNegative = 0.0


class FenceSection(Section):
    """A cylinder and a box around where control began; what is not given is not a fence."""

    enabled: bool = False
    radius_m: Positive | None = None
    lower_ned_m: Vector | None = None  # north, east, down
    upper_ned_m: Vector | None = None
    timeout_s: NonNegative = 0.0

    @model_validator(mode="after")
    def _in_order(self) -> FenceSection:
        if self.enabled and self.radius_m is None and self.lower_ned_m is None and self.upper_ned_m is None:
            raise ValueError("give radius_m, lower_ned_m or upper_ned_m")
        if any(low >= 0.0 for low in self.lower_ned_m or ()) or any(high <= 0.0 for high in self.upper_ned_m or ()):
            raise ValueError("lower_ned_m must be below and upper_ned_m above zero: control begins within the fence")
        return self

    def outside(self, offset_ned_m: Vector) -> str | None:
        """Why a place, relative to where control began, lies outside, in at most 32 characters; None inside, or off."""
        if not self.enabled:
            return None
        distance = math.hypot(offset_ned_m[0], offset_ned_m[1])
        if self.radius_m is not None and not distance <= self.radius_m:
            return f"{distance:.3g} m away, fence {self.radius_m:.3g} m"
        for axis, at in enumerate(offset_ned_m):
            lower = -math.inf if self.lower_ned_m is None else self.lower_ned_m[axis]
            upper = math.inf if self.upper_ned_m is None else self.upper_ned_m[axis]
            if not lower <= at <= upper:
                limit = lower if at < lower else upper
                return f"{at:.3g} m {('north', 'east', 'down')[axis]}, fence {limit:.3g} m"
        return None


class EnvelopeGuardSection(Section):
    """A failsafe whose limit is `controller.envelope`."""

    enabled: bool = True
    timeout_s: NonNegative = 0.0


class Guards(Section):
    """Every failsafe, with the unit of its limit in its name."""

    # what we are told
    pose_age_s: GuardSection = GuardSection(limit=0.25)
    heartbeat_age_s: GuardSection = GuardSection(limit=3.0)
    pose_rate_hz: DerivedGuardSection = DerivedGuardSection(timeout_s=1.0)  # default: tick.floor_hz
    clock_jump_s: EventGuardSection = EventGuardSection(limit=0.25)  # from one time stamp to the next; never above 1 s
    link_delay_s: DerivedGuardSection = DerivedGuardSection(
        timeout_s=1.0
    )  # default: what the certified delay leaves to the link
    link_jitter_s: GuardSection = GuardSection(limit=0.15, timeout_s=1.0)
    # where the estimator thinks we are
    estimator_flags: CountGuardSection = CountGuardSection(limit=0, timeout_s=0.3)  # needed flags that may be missing
    position_variance_m2: GuardSection = GuardSection(limit=0.5, timeout_s=0.3)
    estimator_jump_m: EventGuardSection = EventGuardSection(limit=0.5)  # smaller ones re-seat the controller
    velocity_consistency_m: GuardSection = GuardSection(limit=1.0)
    # how it flies
    fence: FenceSection = FenceSection()
    envelope: EnvelopeGuardSection = EnvelopeGuardSection(timeout_s=1.0)
    tracking_error_m: GuardSection = GuardSection(limit=1.5, timeout_s=0.5)
    tilt_deg: GuardSection = GuardSection(limit=60.0, timeout_s=0.2)
    tilt_error_deg: GuardSection = GuardSection(limit=25.0, timeout_s=0.5)
    hover_thrust: GuardSection = GuardSection(limit=0.2, timeout_s=3.0)  # flown over believed, less one
    attitude_response_deg: GuardSection = GuardSection(limit=8.0, timeout_s=0.5)
    weights_on_bound: CountGuardSection = CountGuardSection(limit=2, timeout_s=10.0)  # weights that may rest there
    thrust_saturation: GuardSection = GuardSection(limit=0.5, timeout_s=1.0)  # share of the last second's ticks
    flight_time_s: GuardSection = GuardSection(enabled=False, limit=600.0)
    # ourselves
    tick_overrun_s: EventGuardSection = EventGuardSection(limit=0.2)

    @model_validator(mode="before")
    @classmethod
    def _over_the_defaults(cls, data: Any) -> Any:
        if not isinstance(data, Mapping):
            return data
        fields = cls.model_fields
        return {
            key: {**fields[key].default.model_dump(), **given}
            if key in fields and isinstance(given, Mapping)
            else given
            for key, given in data.items()
        }


def certified_delay_s(attitude: AttitudeSection) -> float:
    """The longest delay for which every axis is certified; zero where the certificate knows of none."""
    return min(upper for _, upper in _delays(attitude))


def link_share_s(attitude: AttitudeSection) -> float:
    """What the link may take of the certified delay, which is that of the vehicle and the link together.

    Of an interval its width, since the vehicle alone has the lower end; of a plain number all of it, for lack of
    knowledge; zero where the certificate knows of no delay.
    """
    return min(upper - lower if upper > lower else upper for lower, upper in _delays(attitude))


def _delays(attitude: AttitudeSection) -> list[tuple[float, float]]:
    delays = [section.delay_s for section in (attitude.x, attitude.y) if section is not None]
    return [delay if isinstance(delay, tuple) else (delay, delay) for delay in delays]


def check_delay(guards: Guards, attitude: AttitudeSection) -> None:
    """Refuse a link slower than what is certified. Raises `ValueError`."""
    certified_s, limit_s = certified_delay_s(attitude), guards.link_delay_s.limit
    if guards.link_delay_s.enabled and limit_s is not None and 0.0 < certified_s < limit_s:
        raise ValueError(
            f"guards.link_delay_s.limit ({limit_s:g}) is above the certified attitude.*.delay_s ({certified_s:g})"
        )


class ReleaseSection(Section):
    """The mode that is asked of the vehicle when control ends for a fault, by the operator, or because it is over."""

    mode: Literal["hold", "land", "return", "position"] = "hold"
