"""What the estimator says of itself: ESTIMATOR_STATUS flags, and the variances that ODOMETRY carries."""

from __future__ import annotations

from bisect import bisect_right
from typing import Final, NamedTuple


class Health(NamedTuple):
    """Self-confidence of the estimator at one instant."""

    flags: int = 895  # ESTIMATOR_STATUS: all but GPS glitch, constant position mode and accelerometer error
    horizontal_m2: float = 0.02  # variances of position
    vertical_m2: float = 0.005
    horizontal_velocity_m2_s2: float = 0.015
    vertical_velocity_m2_s2: float = 0.0014
    quality: int = 0  # of ODOMETRY: 0 unknown, -1 failed


NOMINAL: Final = Health()  # of a still PX4 with GPS

WITHOUT_HORIZONTAL: Final = 869  # velocity and position, relative and absolute, have gone
WITHOUT_PREDICTION: Final = 101  # and nothing is predicted either

# (s after the last GPS fix, m², m²/s²): PX4 v1.17 in SIH whose GPS was switched off in hover, as recorded.
_AFTER_LOSS: Final = (
    (0.0, 0.042, 0.0105),
    (1.0, 0.059, 0.0137),
    (2.0, 0.125, 0.0265),
    (3.0, 0.262, 0.0483),
    (4.0, 0.538, 0.0839),
    (5.0, 1.074, 0.155),
    (6.0, 2.04, 0.233),
    (7.0, 3.63, 0.297),
    (8.0, 6.00, 0.384),
    (9.0, 9.37, 0.483),
    (10.0, 13.9, 0.584),
)
_TIMES: Final = [row[0] for row in _AFTER_LOSS]
_FLAGS_DROP_S: Final = 5.6
_PREDICTION_DROPS_S: Final = 7.8


def after_gps_loss(elapsed_s: float) -> Health:
    """What PX4 says `elapsed_s` after its last fix: the variances tell first, the flags 5.6 s later."""
    last = len(_AFTER_LOSS) - 1
    place = min(max(bisect_right(_TIMES, elapsed_s), 1), last)
    (t0, p0, v0), (t1, p1, v1) = _AFTER_LOSS[place - 1], _AFTER_LOSS[place]
    share = min(max((elapsed_s - t0) / (t1 - t0), 0.0), 1.0)
    if elapsed_s < _FLAGS_DROP_S:
        flags = NOMINAL.flags
    else:
        flags = WITHOUT_HORIZONTAL if elapsed_s < _PREDICTION_DROPS_S else WITHOUT_PREDICTION
    return Health(flags, p0 + share * (p1 - p0), 0.05 + 0.04 * min(elapsed_s, 7.0), v0 + share * (v1 - v0), 0.01)


def drift_after_gps_loss_m(elapsed_s: float) -> float:
    """How far the reported position of the recording had drifted: 1.1 m after 5.6 s."""
    return 0.035 * elapsed_s * elapsed_s
