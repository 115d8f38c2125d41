"""What flies while the attitude response is identified, in place of the config's controller; and why it needs no proof.

A certificate is about adaptive weights and a response that is known. Here the response is what is looked for, so the
weights are fixed, at the nominal ones of a slow reference model: plain feedback of position and velocity, which is
(wn^2 + 2 zeta wn s) / s^2 times the attitude response. Its gain is one at w = wn sqrt(2 zeta^2 + sqrt(4 zeta^4 + 1)),
with atan(2 zeta w / wn) of phase in hand. A lag of that over w would use it up: 0.49 s at 1.5 rad/s and damping 0.7.
What was measured lags by 0.24 s (PX4 v1.17, default gains), 0.28 s (v1.18) and 0.31 s (v1.17, MC_ROLL_P 3): 2 zeta / wn
of the response plus its delay. The bias weight stands outside of that loop: hedged, its error obeys (20) and (22)
whatever the attitude does, and is stable at any rate (decision 7).
"""

from __future__ import annotations

import math
from typing import Final

from companion.config.controller import AdaptationRates, AxisSection, BiasSection, EstimateCorrectionSection
from companion.config.schema import Config
from companion.control.types import GRAVITY_M_S2

NATURAL_FREQUENCY_RAD_S: Final = 1.5  # of the reference model, or the config's own where that is slower
DAMPING_RATIO: Final = 0.7
LINK_DELAY_S: Final = 0.1  # a fifth of the lag that it bears
_LYAPUNOV_Q: Final = (1.0, 0.1)  # a wrong velocity moves it by 0.6 s times it; all that adapts is the bias weight
_BIAS_RATE: Final = 1.0
_FIXED: Final = AdaptationRates(hedged=0.0, standard=0.0)


def as_flown(config: Config) -> Config:
    """The config that is flown: itself but for an identification, which has a controller of its own."""
    if config.mission.identification is None:
        return config
    controller = config.controller
    axes = controller.axes
    bias = controller.bias
    free = not config.vehicle_kind.one_axis
    slow = {
        "hedging": True,
        "initial_weights": "nominal",
        "axes": axes.model_copy(update={"x": _slow(axes.x), "y": None if axes.y is None else _slow(axes.y)}),
        "bias": bias
        and BiasSection(bound=bias.bound, adaptation_rate=AdaptationRates(hedged=_BIAS_RATE, standard=0.0)),
        "estimate_correction": controller.estimate_correction or (EstimateCorrectionSection() if free else None),
    }
    return config.model_copy(update={"controller": controller.model_copy(update=slow)})


def in_a_line(config: Config) -> str:
    """What it flies with and why that is safe, for the person who asked for it; of a config as flown."""
    axis = config.controller.axes.x
    lag_s, wn = bearable_lag_s(axis), axis.natural_frequency_rad_s
    return (
        f"no certificate is needed to identify: it flies with fixed weights, {wn:g} rad/s, which bear an attitude loop "
        f"that lags by {lag_s:.2f} s (PX4's: 0.24 to 0.31 s), and with all guards but that on the attitude response"
    )


def bearable_lag_s(axis: AxisSection) -> float:
    """The lag, s, at which the loop of the axis's nominal weights becomes unstable: phase margin over crossover."""
    wn, zeta = axis.natural_frequency_rad_s, axis.damping_ratio
    ratio = math.sqrt(2.0 * zeta**2 + math.sqrt(4.0 * zeta**4 + 1.0))
    return math.atan(2.0 * zeta * ratio) / (ratio * wn)


def _slow(axis: AxisSection) -> AxisSection:
    wn = min(axis.natural_frequency_rad_s, NATURAL_FREQUENCY_RAD_S)
    position, velocity = wn * wn / GRAVITY_M_S2, 2.0 * DAMPING_RATIO * wn / GRAVITY_M_S2
    return AxisSection(
        natural_frequency_rad_s=wn,
        damping_ratio=DAMPING_RATIO,
        position_weight_bound=(0.9 * position, 1.1 * position),
        velocity_weight_bound=(0.9 * velocity, 1.1 * velocity),
        adaptation_rate=_FIXED,
        lyapunov_q=_LYAPUNOV_Q,
    )
