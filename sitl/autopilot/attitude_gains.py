"""Gains set in flight act in flight: the vehicle is told how they compare with those that its response is for."""

from __future__ import annotations

import math
from typing import Final

from sitl.autopilot.parameters import Parameters
from sitl.vehicles.vehicle import Vehicle

_NAMES: Final = ("MC_ROLL_P", "MC_PITCH_P", "MC_YAW_P")


class AttitudeGains:
    """Watches the gains from angle to rate. `parameters` hold those that the vehicle's response is for."""

    def __init__(self, parameters: Parameters) -> None:
        self._identified = tuple(map(parameters.number, _NAMES))
        self._seen = parameters.changes
        self._now = self._identified

    def follow(self, parameters: Parameters, vehicle: Vehicle) -> None:
        """Tell the vehicle if they have changed. What is no gain (PX4 takes -3 and NaN too) changes nothing here."""
        if parameters.changes == self._seen:
            return
        self._seen = parameters.changes
        now = tuple(map(parameters.number, _NAMES))
        if now != self._now and all(0.0 < gain < math.inf for gain in (*now, *self._identified)):
            self._now = now
            roll, pitch, yaw = (gain / began for gain, began in zip(now, self._identified, strict=True))
            vehicle.follow_gains((roll, pitch, yaw))
