"""The identification manoeuvre: attitude doublets around hover, with pauses that bring the vehicle back.

Within a doublet the attitude set-point is the trim plus a pulse and nobody holds the position; it ends where it began
but for wind and drag. In a pause the position controller flies as ever. A doublet waits until the vehicle is calm, and
one that does not become calm ends the manoeuvre.
"""

from __future__ import annotations

import math
from typing import Final

from companion.config.mission.identification import IdentificationSection

# From where it began, and over ground: in the 2 s of a doublet both grow by what the trim is wrong. With 0.4 m and
# 0.35 m/s three flights of ten with GPS left the envelope. The corrected velocity is off by 0.1 m/s.
CALM_M: Final = 0.3
CALM_M_S: Final = 0.2
PATIENCE_S: Final = 20.0

_SHAPE = (1.0, -1.0, -1.0, 1.0)  # in pulses


class Manoeuvre:
    """Walks through the doublets.

    Attributes: `amplitude_deg` of a doublet; `over`, whether the last one and the pause after it have passed; `done`,
    doublets flown so far.
    """

    def __init__(self, section: IdentificationSection, amplitude_deg: float, *, one_axis: bool) -> None:
        self.amplitude_deg = amplitude_deg
        self._amplitude_rad = math.radians(amplitude_deg)
        self._pulse_s = section.pulse_s
        self._pause_s = section.pause_s
        axes = (1,) if one_axis else (0, 1)  # a rig pitches
        self._axes = [axis for axis in axes for _ in range(section.repeats)]
        self._since_s = 0.0  # of the pause or the doublet under way
        self._pulsing = False
        self.done = 0
        self.over = False

    @property
    def gave_up(self) -> bool:
        """Whether it is over before the last doublet."""
        return self.over and self.done < len(self._axes)

    @property
    def doublets(self) -> int:
        """How many there are to fly."""
        return len(self._axes)

    def offset(self, elapsed_s: float, distance_m: float, speed_m_s: float) -> tuple[float, float] | None:
        """(roll, pitch) to add to the trim, rad; None while the position controller flies.

        Parameters
        ----------
        elapsed_s
            Since control began.
        distance_m, speed_m_s
            Of the vehicle, from where it is to hover and over ground.
        """
        if self.over:
            return None
        within = elapsed_s - self._since_s
        if self._pulsing:
            pulse = int(within / self._pulse_s + 1e-9)
            if pulse < len(_SHAPE):
                angle = self._amplitude_rad * _SHAPE[pulse] * (1.0 if self.done % 2 == 0 else -1.0)
                return (angle, 0.0) if self._axes[self.done] == 0 else (0.0, angle)
            self._pulsing, self._since_s = False, elapsed_s
            self.done += 1
            return None
        if within < self._pause_s:
            return None
        if self.done == len(self._axes) or within > self._pause_s + PATIENCE_S:
            self.over = True
        elif distance_m < CALM_M and speed_m_s < CALM_M_S:
            self._pulsing, self._since_s = True, elapsed_s
            return self.offset(elapsed_s, distance_m, speed_m_s)
        return None
