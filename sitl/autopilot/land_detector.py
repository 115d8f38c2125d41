"""Whether PX4 says that it stands on the ground, which is not the same as standing there.

In OFFBOARD by attitude the thrust decides: above MPC_MANTHR_MIN + 0.01 a vehicle that has not moved is "in the air".
Thresholds and times are as seen on a PX4 v1.17 with SIH (`land_detector/MulticopterLandDetector.cpp`).
"""

from __future__ import annotations

from typing import Final

from sitl.autopilot.parameters import Parameters

LAND_DETECTION_US: Final = 1_000_000
ATTITUDE_LAND_DETECTION_US: Final = 2_100_000
_LANDED_THRUST_SHARE: Final = 0.3  # of hover thrust: below, a vehicle on the ground counts as landed
_ABOVE_IDLE: Final = 0.01  # over MPC_MANTHR_MIN


class LandDetector:
    """Attribute: `landed`."""

    def __init__(self, parameters: Parameters, hover_thrust: float) -> None:
        self._parameters = parameters
        self._landed_thrust = _LANDED_THRUST_SHARE * hover_thrust
        self._contact_since_us: int | None = None
        self.landed = True

    def step(self, now_us: int, thrust: float, *, armed: bool, by_attitude: bool, on_ground: bool) -> bool:
        """Look once more; whether it has landed.

        `thrust`: what it was told; `by_attitude`: in OFFBOARD by attitude set-points; `on_ground`: the truth.
        """
        if not armed:  # at once, in the air too
            self.landed = True
        elif not on_ground:
            self.landed = False
        elif by_attitude:
            idle = thrust <= self._parameters.number("MPC_MANTHR_MIN") + _ABOVE_IDLE
            self.landed = idle and (self.landed or self._contact_for(now_us, ATTITUDE_LAND_DETECTION_US))
            if idle:
                return self.landed
        elif not self.landed and thrust <= self._landed_thrust:
            self.landed = self._contact_for(now_us, LAND_DETECTION_US)
            return self.landed
        self._contact_since_us = None
        return self.landed

    def _contact_for(self, now_us: int, time_us: int) -> bool:
        if self._contact_since_us is None:
            self._contact_since_us = now_us
        return now_us - self._contact_since_us >= time_us
