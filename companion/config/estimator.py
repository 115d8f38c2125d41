"""The `estimator` section: how wrong the estimate of the real vehicle is.

`companion design` reads it, and `guards.position_slide_m` has its limit from it.
"""

from __future__ import annotations

from typing import Final, Literal, NamedTuple

from pydantic import model_validator

from companion.config.base import Positive, Section

Preset = Literal["gps", "rtk", "optical_flow", "motion_capture"]


class VelocityError(NamedTuple):
    """The error of an estimated horizontal velocity: standard deviation on one axis, and its time constant.

    `position_aided`: whether the estimator corrects its position by something that measures it. Only then does the
    slope of the position tell the error of the velocity.
    """

    deviation_m_s: float
    time_s: float
    position_aided: bool = True


# East and north together (RMS), and the time in which the autocorrelation falls to 1/e, of the plant's models with
# these names over 8 min (`sitl/world/navigation_error.py`); `docs/estimator.md` says what those are from.
PRESETS: Final[dict[str, VelocityError]] = {
    "gps": VelocityError(0.23, 3.7),
    "rtk": VelocityError(0.075, 4.0),
    "optical_flow": VelocityError(0.037, 1.1, position_aided=False),
    "motion_capture": VelocityError(0.037, 2.3),
}


class EstimatorSection(Section):
    """What aids the estimator, or how wrong its velocity is. Left out, `companion design` measures it in the log, and
    `guards.position_slide_m` takes it for GPS."""

    preset: Preset | None = None
    """What aids it. Its velocity is then as wrong as PX4's EKF2 has it with this."""
    velocity_error_m_s: Positive | None = None
    """Standard deviation of the error of one horizontal velocity, in place of a preset's."""
    velocity_error_time_s: Positive | None = None
    """Time in which its autocorrelation falls to 1/e. Needs `velocity_error_m_s` beside it."""
    position_aided: bool = True
    """Whether anything aids the position (GPS, motion capture), beside `velocity_error_m_s`. With optical flow alone
    nothing does, and `controller.estimate_correction` has nothing to correct by."""

    @model_validator(mode="after")
    def _one_of_both(self) -> EstimatorSection:
        numbers = (self.velocity_error_m_s, self.velocity_error_time_s)
        if (self.preset is None) == (numbers == (None, None)) or (self.preset is None and None in numbers):
            raise ValueError("give preset, or velocity_error_m_s and velocity_error_time_s")
        return self

    @property
    def velocity_error(self) -> VelocityError:
        """What is given, in numbers."""
        if self.velocity_error_m_s is None or self.velocity_error_time_s is None:
            return PRESETS[self.preset or ""]
        return VelocityError(self.velocity_error_m_s, self.velocity_error_time_s, self.position_aided)
