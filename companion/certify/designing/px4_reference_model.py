"""Settings of PX4 v1.18's attitude reference model under which a faster position reference would be certified.

In front of the attitude controller stands a critically damped model of natural frequency W (MC_REF_W_N), and F
(MC_REF_FF) of its rate is added to the rate set-point. The controller is P on the angle, so a rate r added behind P is
an angle r / P in front of it, and a set-point passes

    m(s) = (W / (s + W))² (1 + F s / P)

before it reaches the loop that was there before v1.18. An identified response is therefore known at other settings
too: multiply by the new m and divide by the old one. That is a prediction: no certificate is made of it, the settings
are flown and identified first.

Beside a real v1.18 (SIH, P 4), from 9.2 rad/s, 0.92, 80 ms at W 50, F 0:

| | predicted | identified |
|---|---|---|
| W 200, F 0 | 9.7 rad/s, 0.94, 56 ms | 9.6 rad/s, 0.95, 53 ms |
| W 15, F 1 | 9.4 rad/s, 0.48, 43 ms | 9.4 rad/s, 0.48, 46 ms |
| W 50, F 0.5, cap 300 deg/s | 16.9 rad/s, 0.89, 52 ms | 13.5 rad/s, 0.79, 42 ms |

Source: PX4 `mc_att_control/AttitudeControl/AttitudeControl.cpp`, `mc_att_control_params.yaml`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from decimal import Decimal
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares

from companion.attitude_response.exact import interval
from companion.attitude_response.kinds import SECOND_ORDER_DELAY, SecondOrder
from companion.attitude_response.response import AttitudeResponse
from companion.certify.bandwidth import fastest_reference
from companion.certify.designing.design import slower
from companion.certify.problem import AxisProblem

FREQUENCIES_RAD_S: Final = (50.0, 100.0, 200.0)  # the default to the largest PX4 takes
SHARES: Final = (0.0, 0.25, 0.5)  # of the rate fed forward: with all of it the real loop was underdamped
LARGEST_STEP_RAD: Final = math.radians(16.0)  # of a set-point: a doublet of 8 degrees turned round
RATE_LIMIT_RAD_S: Final = math.radians(220.0)  # MC_ROLLRATE_MAX and MC_PITCHRATE_MAX, defaults
WORTH: Final = 1.05  # a proposal must allow a reference model faster by this factor
_CAP_STEP_DEG_S: Final = 50.0
_DEFAULT_CAP_DEG_S: Final = 100.0
_OMEGA_RAD_S: Final = np.logspace(-0.3, 1.4, 60)
_PLACES: Final = Decimal("0.0001")

Complex = npt.NDArray[np.complex128]


class Settings(NamedTuple):
    """MC_REF_W_N in rad/s, MC_REF_FF, MC_REF_FF_MAX in deg/s."""

    frequency_rad_s: float
    share: float
    cap_deg_s: float

    def parameters(self) -> dict[str, float]:
        """By PX4's names."""
        return dict(zip(("MC_REF_W_N", "MC_REF_FF", "MC_REF_FF_MAX"), self, strict=True))


class Proposal(NamedTuple):
    """Settings, what each axis's response is predicted to be with them, and the fastest reference model then.

    `responses` is (natural frequency in rad/s, damping ratio, delay in s) by axis.
    """

    settings: Settings
    responses: Mapping[str, tuple[float, float, float]]
    fastest_rad_s: Decimal


def settings_of(gains: Mapping[str, float]) -> Settings | None:
    """Those a vehicle flies with; None where it has no such model, or does not tell."""
    if not {"MC_REF_W_N", "MC_REF_FF"} <= gains.keys():
        return None
    return Settings(gains["MC_REF_W_N"], gains["MC_REF_FF"], gains.get("MC_REF_FF_MAX", _DEFAULT_CAP_DEG_S))


def predicted(
    response: tuple[float, float, float], p_1_s: float, now: Settings, then: Settings
) -> tuple[float, float, float]:
    """The response at other settings, as the second order with a delay that is nearest to it.

    Parameters
    ----------
    response
        (natural frequency in rad/s, damping ratio, delay in s) as identified at `now`.
    p_1_s
        MC_ROLL_P or MC_PITCH_P.
    now, then
        Settings it was identified at, and those it is wanted for.

    Returns
    -------
    tuple
        As `response`.
    """
    s: Complex = np.asarray(1j * _OMEGA_RAD_S, dtype=np.complex128)
    wanted = _second_order(np.array(response), s) * _model(then, p_1_s, s) / _model(now, p_1_s, s)
    # Of a step each frequency holds 1/omega: what is slow counts more.
    weight = 1.0 / np.sqrt(_OMEGA_RAD_S)

    def error(values: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        difference = weight * (_second_order(values, s) - wanted)
        return np.concatenate([difference.real, difference.imag])

    lower, upper = np.array(SECOND_ORDER_DELAY.lower), np.array(SECOND_ORDER_DELAY.upper)
    found = least_squares(error, np.clip(response, lower + 1e-6, upper - 1e-6), bounds=(lower, upper)).x
    return float(found[0]), float(found[1]), float(found[2])


def propose(
    axes: Mapping[str, AxisProblem],
    responses: Mapping[str, tuple[float, float, float]],
    p_1_s: Mapping[str, float],
    now: Settings,
    margin: Decimal,
) -> Proposal | None:
    """The settings that allow the fastest certified reference model, in continuous time; None if today's are as good.

    Only settings that stay linear are looked at: at the largest step the controller's rate and the model's own peak
    rate ``F W step / e`` together stay within PX4's rate limit.

    Parameters
    ----------
    axes
        The problem by axis, x and y.
    responses, p_1_s
        By axis, as in `predicted`.
    now
        Settings the responses were identified at.
    margin
        As in `design`.
    """
    today = _fastest(axes, responses, margin)
    best = None
    for frequency in FREQUENCIES_RAD_S:
        for share in SHARES:
            fed_rad_s = share * frequency * LARGEST_STEP_RAD / math.e
            if max(p_1_s.values()) * LARGEST_STEP_RAD + fed_rad_s > RATE_LIMIT_RAD_S:
                continue
            cap = _CAP_STEP_DEG_S * math.ceil(math.degrees(2.0 * fed_rad_s) / _CAP_STEP_DEG_S)
            settings = Settings(frequency, share, max(cap, _DEFAULT_CAP_DEG_S))
            then = {name: predicted(responses[name], p_1_s[name], now, settings) for name in axes}
            fastest = _fastest(axes, then, margin)
            if fastest > (best.fastest_rad_s if best else today) * Decimal(str(WORTH)):
                best = Proposal(settings, then, fastest)
    return best


def _fastest(
    axes: Mapping[str, AxisProblem], responses: Mapping[str, tuple[float, float, float]], margin: Decimal
) -> Decimal:
    values = []
    for name, axis in axes.items():
        wn, zeta, delay = (Decimal(value).quantize(_PLACES) for value in responses[name])
        response = AttitudeResponse(
            SecondOrder(interval(wn), interval(zeta)), interval(delay), axis.response.pade_order
        )
        found = fastest_reference(slower(replace(axis, response=response), margin), (0,))
        values.append(Decimal(0) if found is None else found.value)
    return min(values)


def _second_order(values: npt.NDArray[np.float64], s: Complex) -> Complex:
    wn, zeta, delay = values
    found: Complex = wn * wn / (s * s + 2.0 * zeta * wn * s + wn * wn) * np.exp(-delay * s)
    return found


def _model(settings: Settings, p_1_s: float, s: Complex) -> Complex:
    passed = settings.frequency_rad_s / (s + settings.frequency_rad_s)
    found: Complex = passed * passed * (1.0 + settings.share * s / p_1_s)
    return found
