"""The `mission.identification` section: attitude doublets that `companion identify` reads the response from."""

from __future__ import annotations

import math
from typing import Annotated, Final

from pydantic import Field

from companion.config.base import NUMBER, Positive, Section
from companion.control.types import GRAVITY_M_S2

SMALLEST_DEG: Final = 2.0  # of an amplitude: below it `companion identify` sees no manoeuvre
USUAL_DEG: Final = 8.0


class IdentificationSection(Section):
    """Doublets in roll and then in pitch, each followed by a pause in which the position loop brings the vehicle back.

    A doublet is one pulse to one side, two to the other and one back: it ends where it began, at rest.
    """

    amplitude_deg: Annotated[float, Field(ge=SMALLEST_DEG, le=20.0), NUMBER] | None = None
    """Tilt of a pulse, from the trim. Left out: 8, or as much less as envelope and fence ask for."""
    pulse_s: Annotated[float, Field(ge=0.2, le=2.0), NUMBER] = 0.5
    """How long a pulse lasts. Several times 1/bandwidth, or the end of the response is never seen."""
    pause_s: Positive = 4.0
    """How long the position loop flies at least between two doublets. It goes on until the vehicle is calm, for at most
    20 s more."""
    repeats: Annotated[int, Field(ge=3, le=20)] = 6
    """Doublets of each axis. The intervals come from how they differ."""

    def excursion_m(self, amplitude_deg: float) -> float:
        """How far a doublet carries a vehicle without drag: `a T²` at the middle of it. `a T` is its largest speed."""
        return GRAVITY_M_S2 * math.tan(math.radians(amplitude_deg)) * self.pulse_s * self.pulse_s

    def amplitude_for_deg(self, excursion_m: float) -> float:
        """The amplitude that stays within an excursion."""
        return math.degrees(math.atan(excursion_m / (GRAVITY_M_S2 * self.pulse_s * self.pulse_s)))
