"""What the estimator says of itself by ESTIMATOR_STATUS: which of its solutions are good."""

from __future__ import annotations

import math
from typing import Final

from pymavlink.dialects.v20 import development as mavlink

from companion.mavlink.codec import Frame, Layout

ESTIMATOR_STATUS: Final = Layout("ESTIMATOR_STATUS")

_FLAGS: Final = ESTIMATOR_STATUS.index("flags")
_NEEDED: Final = (
    mavlink.ESTIMATOR_ATTITUDE,
    mavlink.ESTIMATOR_VELOCITY_HORIZ,
    mavlink.ESTIMATOR_VELOCITY_VERT,
    mavlink.ESTIMATOR_POS_HORIZ_REL | mavlink.ESTIMATOR_POS_HORIZ_ABS,  # either will do
    mavlink.ESTIMATOR_POS_VERT_ABS,
)


def missing_flags(flags: int) -> int:
    """How many of the solutions that a position controller needs ESTIMATOR_STATUS.flags does not show as good.

    Source: https://mavlink.io/en/messages/common.html#ESTIMATOR_STATUS_FLAGS; PX4 `Ekf::get_ekf_soln_status`.
    """
    return sum(not flags & needed for needed in _NEEDED)


class EstimatorStatus:
    """Attribute: `missing`, how many of the solutions needed are not good; NaN until told, and once forgotten."""

    def __init__(self) -> None:
        self._at_s = -math.inf
        self.missing = math.nan

    def on_frame(self, frame: Frame, now_s: float) -> None:
        """An ESTIMATOR_STATUS."""
        self.missing = missing_flags(ESTIMATOR_STATUS.unpack(frame.payload)[_FLAGS])
        self._at_s = now_s

    def forget(self, before_s: float) -> None:
        """What has not been told again since then is not known any more."""
        if self._at_s < before_s:
            self.missing = math.nan
