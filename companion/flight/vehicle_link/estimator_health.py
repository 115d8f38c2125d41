"""What the estimator says of itself, for as long as it is believed: which of its solutions are good."""

from __future__ import annotations

import math
from typing import Final

from companion.flight.vehicle_link.messages import EstimatorFlag

_NEEDED: Final = (  # iterating the flags would leave out the one that stands for two
    EstimatorFlag.ATTITUDE,
    EstimatorFlag.VELOCITY_HORIZONTAL,
    EstimatorFlag.VELOCITY_VERTICAL,
    EstimatorFlag.POSITION_HORIZONTAL,
    EstimatorFlag.POSITION_VERTICAL,
)
SOLUTIONS: Final = len(_NEEDED)


def missing_flags(flags: int) -> int:
    """How many of the solutions that a position controller needs ESTIMATOR_STATUS.flags does not show as good.

    Source: https://mavlink.io/en/messages/common.html#ESTIMATOR_STATUS_FLAGS; PX4 `Ekf::get_ekf_soln_status`.
    """
    return sum(not flags & needed for needed in _NEEDED)


class EstimatorHealth:
    """Attribute: `missing`, how many of the solutions needed are not good; NaN until told, and once forgotten."""

    def __init__(self) -> None:
        self._at_s = -math.inf
        self.missing = math.nan

    def on_status(self, flags: int, now_s: float) -> None:
        """An ESTIMATOR_STATUS."""
        self.missing = missing_flags(flags)
        self._at_s = now_s

    def forget(self, before_s: float) -> None:
        """What has not been told again since then is not known any more."""
        if self._at_s < before_s:
            self.missing = math.nan
