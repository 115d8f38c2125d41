"""The fence: a cylinder and a box around where control began. Its geometry stands here and nowhere else.

A mission is held against it when the config is read, a live command when it comes, the vehicle while it is flown.
"""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field, model_validator

from companion.config.base import Positive, Section, Vector
from companion.config.guards.sections import Enabled, Timeout


class FenceSection(Section):
    """A cylinder and a box around where control began; what is not given is not a fence."""

    enabled: Enabled = False
    radius_m: Annotated[Positive | None, Field(description="of the cylinder around the vertical, m")] = None
    lower_ned_m: Annotated[Vector | None, Field(description="corner of the box: least north, east, down, m")] = None
    upper_ned_m: Annotated[Vector | None, Field(description="corner of the box: most north, east, down, m")] = None
    timeout_s: Timeout = 0.0

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
