"""The reference model in front of PX4 v1.18's attitude controller, critically damped, and its feed-forward.

An attitude set-point is not tracked itself: a model of natural frequency MC_REF_W_N follows it, and the controller
follows the model, which with the default of 50 rad/s is 2 / 50 s late. With MC_REF_FF the model's rate is added to the
controller's rate set-point, each axis up to MC_REF_FF_MAX. The model advances only when a set-point arrives: without
one it stands, its rate included.

The plant knows the attitude loop by its response to a set-point, and its controller is P on the angle: a rate r added
behind P is an angle r / P added in front of it.

Source: `mc_att_control/AttitudeControl/AttitudeControl.cpp`, `mc_att_control_main.cpp`.
"""

from __future__ import annotations

import math
from typing import Final

from sitl.autopilot.parameters import Parameters
from sitl.vehicles.rotation import UNCONTROLLED, Quaternion, multiply, rotation

_GAINS: Final = ("MC_ROLL_P", "MC_PITCH_P", "MC_YAW_P")
_LEAST_RAD_S: Final = 0.1


class AttitudeReference:
    """The model of one autopilot. Parameters count when a set-point arrives."""

    def __init__(self, parameters: Parameters) -> None:
        self._parameters = parameters
        self._q_wxyz: Quaternion | None = None
        self._rates_rad_s = (0.0, 0.0, 0.0)  # towards the set-point, in the model's frame
        self._arrived_us = 0
        self._wanted: Quaternion | None = None
        self._followed: Quaternion = (1.0, 0.0, 0.0, 0.0)

    def follow(self, wanted: Quaternion, now_us: int) -> Quaternion:
        """What the attitude loop follows now, w first, body to NED; `wanted` has arrived if it is another object."""
        if wanted is not self._wanted:
            self._wanted = wanted
            self._advance(wanted, 1e-6 * (now_us - self._arrived_us))
            self._arrived_us = now_us
        return self._followed

    def _advance(self, wanted: Quaternion, dt_s: float) -> None:
        if wanted is UNCONTROLLED:  # nothing to follow: the model begins anew at the next attitude
            self._q_wxyz, self._rates_rad_s, self._followed = None, (0.0, 0.0, 0.0), wanted
            return
        if self._q_wxyz is None or dt_s <= 0.0:
            self._q_wxyz = self._followed = wanted
            return
        number = self._parameters.number
        frequency = max(number("MC_REF_W_N"), _LEAST_RAD_S)
        w, x, y, z = self._q_wxyz
        ew, ex, ey, ez = multiply((w, -x, -y, -z), wanted)
        short = math.copysign(2.0, ew)
        # The exact answer of the double pole at -frequency to a set-point held over dt_s.
        decay = math.exp(-frequency * dt_s)
        moved, kept = 1.0 - (1.0 + frequency * dt_s) * decay, dt_s * decay
        pulled, slowed = frequency * frequency * dt_s * decay, (1.0 - frequency * dt_s) * decay
        errors = (short * ex, short * ey, short * ez)
        turned = [moved * error + kept * rate for error, rate in zip(errors, self._rates_rad_s, strict=True)]
        rx, ry, rz = (pulled * error + slowed * rate for error, rate in zip(errors, self._rates_rad_s, strict=True))
        self._rates_rad_s = rx, ry, rz
        self._q_wxyz = self._followed = multiply(self._q_wxyz, rotation(*turned))
        share, limit = number("MC_REF_FF"), math.radians(number("MC_REF_FF_MAX"))
        if share:
            fed = (share * rate for rate in self._rates_rad_s)
            capped = [min(max(rate, -limit), limit) if limit > 0.0 else rate for rate in fed]
            gains = [number(gain) for gain in _GAINS]
            ahead = [rate / gain if gain > 0.0 else 0.0 for rate, gain in zip(capped, gains, strict=True)]
            self._followed = multiply(self._q_wxyz, rotation(*ahead))
