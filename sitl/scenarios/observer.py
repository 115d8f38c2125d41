"""What the plant has seen of a flight: the set-points that it received, and where the vehicle really was."""

from __future__ import annotations

import math
from typing import NamedTuple

from sitl.autopilot.autopilot import Autopilot
from sitl.autopilot.modes import FlightMode
from sitl.vehicles.rotation import Quaternion, turned
from sitl.vehicles.vehicle import Vector

SMOOTH_S = 0.5  # for how long after an engagement or a reset set-points must not step


class Change(NamedTuple):
    """A change of what the autopilot does."""

    time_s: float
    mode: FlightMode
    armed: bool


class Account(NamedTuple):
    """All that is judged of a flight from the plant's side. Distances are the truth's, from where OFFBOARD began."""

    engaged_s: float | None  # simulated time at which OFFBOARD began
    setpoints: int
    invalid_setpoints: int
    thrust_least: float  # while armed, in OFFBOARD
    thrust_most: float
    largest_step_deg: float  # between two set-points, after OFFBOARD began and after each mark
    in_control_m: float  # the larger of across and vertical, while in OFFBOARD
    farthest_m: float  # and in all, as long as it was in the air
    changes: list[Change]


class Observer:
    """Watches one autopilot. `on_control` at every control step; `mark` an instant at which set-points must not step.

    Attributes: `engaged_us`, when OFFBOARD began; `start_ned_m`, where; `changes` of mode and arming.
    """

    def __init__(self, autopilot: Autopilot) -> None:
        self._autopilot = autopilot
        self._last: Quaternion | None = None
        self._smooth_until_us = -1
        self.start_ned_m: Vector = (0.0, 0.0, 0.0)
        self._setpoints = self._invalid = 0
        self._least, self._most = math.inf, -math.inf
        self._step_deg = self._farthest_m = self._in_control_m = 0.0
        self.engaged_us: int | None = None
        self.changes: list[Change] = []
        autopilot.on_setpoint = self._setpoint

    def mark(self) -> None:
        """From now on, for a while, no step."""
        self._smooth_until_us = self._autopilot.time_us + round(1e6 * SMOOTH_S)

    @property
    def setpoints(self) -> int:
        """Set-points received so far."""
        return self._setpoints

    def on_control(self, now_us: int) -> None:
        """One look at the vehicle."""
        commander = self._autopilot.commander
        mode, armed = commander.mode, commander.armed
        if not self.changes or self.changes[-1][1:] != (mode, armed):
            self.changes.append(Change(1e-6 * now_us, mode, armed))
        position = self._autopilot.vehicle.state.position_ned_m
        flying = armed and mode is FlightMode.OFFBOARD
        if self.engaged_us is None:
            if not flying:
                return
            self.engaged_us = now_us
            self.start_ned_m = position
            self.mark()
        (x, y, z), (x0, y0, z0) = position, self.start_ned_m
        away_m = max(math.hypot(x - x0, y - y0), abs(z - z0))
        if not commander.landed:
            self._farthest_m = max(self._farthest_m, away_m)
        if flying:
            self._in_control_m = max(self._in_control_m, away_m)

    def _setpoint(self, q_wxyz: Quaternion, thrust: float, _type_mask: int) -> None:
        self._setpoints += 1
        if not math.isfinite(sum(q_wxyz) + thrust):
            self._invalid += 1
            return
        commander = self._autopilot.commander
        if commander.armed and commander.mode is FlightMode.OFFBOARD:
            self._least, self._most = min(self._least, thrust), max(self._most, thrust)
        q_wxyz = turned(q_wxyz, -self._autopilot.heading_error_rad)  # as the vehicle flies it
        if self._last is not None and self._autopilot.time_us <= self._smooth_until_us:
            self._step_deg = max(self._step_deg, angle_deg(self._last, q_wxyz))
        self._last = q_wxyz

    def account(self) -> Account:
        """What it has seen up to now."""
        return Account(
            None if self.engaged_us is None else 1e-6 * self.engaged_us,
            self._setpoints,
            self._invalid,
            self._least,
            self._most,
            self._step_deg,
            self._in_control_m,
            self._farthest_m,
            self.changes,
        )


def angle_deg(a: Quaternion, b: Quaternion) -> float:
    """The angle between two attitudes; by its sine, since the cosine of a small angle is all rounding."""
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    x = aw * bx - ax * bw - ay * bz + az * by
    y = aw * by + ax * bz - ay * bw - az * bx
    z = aw * bz - ax * by + ay * bx - az * bw
    w = aw * bw + ax * bx + ay * by + az * bz
    return math.degrees(2.0 * math.atan2(math.sqrt(x * x + y * y + z * z), abs(w)))
