"""Live commands: SET_POSITION_TARGET_LOCAL_NED from those who may steer, taken or refused with a reason.

A position is a set-point to travel to; with a velocity, and perhaps an acceleration, it is a sample of a trajectory
that a planner streams. Whatever else a client asks for is refused and not guessed at.

Source: https://mavlink.io/en/messages/common.html#SET_POSITION_TARGET_LOCAL_NED and #POSITION_TARGET_TYPEMASK.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from pymavlink.dialects.v20 import development as mavlink

from companion.config.guards.fence import FenceSection
from companion.control.types import PositionSetpoint
from companion.mavlink.codec import Frame, Layout
from companion.trajectory.sample import Sample

SET_POSITION_TARGET: Final = Layout("SET_POSITION_TARGET_LOCAL_NED")

_SYSTEM: Final = SET_POSITION_TARGET.index("target_system")
_COMPONENT: Final = SET_POSITION_TARGET.index("target_component")
_FRAME: Final = SET_POSITION_TARGET.index("coordinate_frame")
_MASK: Final = SET_POSITION_TARGET.index("type_mask")
_TIME: Final = SET_POSITION_TARGET.index("time_boot_ms")
_X: Final = SET_POSITION_TARGET.index("x")  # then y and z, three of velocity, three of acceleration
_YAW: Final = SET_POSITION_TARGET.index("yaw")

_IGNORE_POSITION: Final = 0x007
_IGNORE_VELOCITY: Final = 0x038
_IGNORE_ACCELERATION: Final = 0x1C0
_IGNORE_YAW: Final = 0x400
_IGNORE_YAW_RATE: Final = 0x800
_FORCE: Final = 0x200  # what is called acceleration is one
_KNOWN: Final = 0xFFF  # above, some have bits for take-off and landing


class LiveCommand(NamedTuple):
    """What came of whom and when, by the flight's clock: a set-point, a sample, or why neither."""

    heard_s: float
    sender: tuple[int, int]  # system and component
    wanted: PositionSetpoint | Sample | str


def addressed_to(frame: Frame, own: tuple[int, int]) -> bool:
    """Whether a frame is a set-point for exactly this system and component; one for everybody is not."""
    if frame.message_id != SET_POSITION_TARGET.message_id:
        return False
    values = SET_POSITION_TARGET.unpack(frame.payload)
    return (values[_SYSTEM], values[_COMPONENT]) == own


def parse(frame: Frame, own: tuple[int, int]) -> PositionSetpoint | Sample | str:
    """Where a frame tells us to go in local NED, yaw NaN to keep it; or why it is refused, in at most 32 characters."""
    if not addressed_to(frame, own):
        return "not addressed to the companion"
    values = SET_POSITION_TARGET.unpack(frame.payload)
    mask, yaw = values[_MASK], values[_YAW]
    x, y, z, vx, vy, vz, ax, ay, az = values[_X : _X + 9]
    no_velocity, no_acceleration = mask & _IGNORE_VELOCITY, mask & _IGNORE_ACCELERATION
    refusals = (
        (values[_FRAME] != mavlink.MAV_FRAME_LOCAL_NED, f"frame {values[_FRAME]} is not LOCAL_NED"),
        (mask & ~_KNOWN, "unknown bits in type_mask"),
        (mask & _IGNORE_POSITION, "x, y and z must be given"),
        (no_velocity not in (0, _IGNORE_VELOCITY), "velocity is given in part"),
        (no_acceleration not in (0, _IGNORE_ACCELERATION), "acceleration is given in part"),
        (no_velocity and not no_acceleration, "acceleration without velocity"),
        (mask & _FORCE and not no_acceleration, "a force is no acceleration"),
        (~mask & _IGNORE_YAW_RATE, "yaw rate must be ignored"),
        (not math.isfinite(x + y + z), "position is not finite"),
        (not (no_velocity or math.isfinite(vx + vy + vz)), "velocity is not finite"),
        (not (no_acceleration or math.isfinite(ax + ay + az)), "acceleration is not finite"),
        (not (mask & _IGNORE_YAW or math.isfinite(yaw)), "yaw is not finite"),
    )
    for refused, text in refusals:
        if refused:
            return text
    yaw = math.nan if mask & _IGNORE_YAW else math.remainder(yaw, math.tau)
    if no_velocity:
        return PositionSetpoint(x, y, z, yaw)
    if no_acceleration:
        ax = ay = az = math.nan
    return Sample(values[_TIME], x, y, z, vx, vy, vz, ax, ay, az, yaw)


def outside(command: PositionSetpoint | Sample, fence: FenceSection, origin: PositionSetpoint) -> str | None:
    """Why a command lies outside the fence around `origin`, where control began, in at most 32 characters; or None."""
    return fence.outside((command.x_m - origin.x_m, command.y_m - origin.y_m, command.z_m - origin.z_m))


class Refusals:
    """Which refusals to tell: a client that repeats itself at 50 Hz is answered once a second."""

    def __init__(self, every_s: float = 1.0) -> None:
        self.count = 0
        self._every_s = every_s
        self._told_s = -math.inf

    def tell(self, now_s: float) -> bool:
        """Count a refusal; True where it is to be told."""
        self.count += 1
        if now_s - self._told_s < self._every_s:
            return False
        self._told_s = now_s
        return True
