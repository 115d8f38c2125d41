"""What the vehicle hovers at before control begins: from the thrust that PX4 flies, and how the vehicle moves by it.

Nobody else knows: the config may be of another battery, and PX4 never writes back what it has learnt to MPC_THR_HOVER.
"""

from __future__ import annotations

import math
from typing import Final

from companion.control import hover
from companion.control.types import GRAVITY_M_S2, Odometry

_SETTLED_S: Final = 0.5  # it begins with what is flown, which is right in a calm hover
_CALM_M_S: Final = 0.3  # up or down: what climbs faster is no hover
_PARAMS: Final = hover.HoverParams(
    rate_1_s=2.0,
    filter_rad_s=5.0,
    lower=0.01,
    upper=1.0,
    slew_1_s=10.0,
    gravity_m_s2=GRAVITY_M_S2,
)


class Hovering:
    """Takes thrusts as PX4 tells them by ATTITUDE_TARGET, and samples, of a vehicle in the air outside OFFBOARD."""

    def __init__(self) -> None:
        self._flown: float | None = None
        self._state: hover.HoverState | None = None
        self._for_s = 0.0

    @property
    def thrust(self) -> float | None:
        """Normalised thrust that carries the weight; None until it is known."""
        return self._state.hover_thrust if self._state is not None and self._for_s >= _SETTLED_S else None

    def forget(self) -> None:
        """It stands on the ground, or was not seen."""
        self._flown = self._state = None
        self._for_s = 0.0

    def on_thrust(self, thrust: float, *, offboard: bool) -> None:
        """What PX4 flies. In OFFBOARD that is what it is told: what is known by then stays."""
        if not offboard and math.isfinite(thrust):
            self._flown = thrust

    def on_sample(self, sample: Odometry, dt_s: float, *, offboard: bool) -> None:
        """The vehicle, `dt_s` after the last sample."""
        if offboard or self._flown is None:
            return
        if self._state is None:
            if self._flown > 0.0:
                self._state = hover.start(min(self._flown, 1.0), sample.vz_m_s)
            return
        upright = 1.0 - 2.0 * (sample.qx * sample.qx + sample.qy * sample.qy)
        self._state = hover.step(_PARAMS, self._state, sample.vz_m_s, self._flown * upright, dt_s)
        if abs(sample.vz_m_s) < _CALM_M_S:
            self._for_s += dt_s
