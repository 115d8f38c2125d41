"""From a config to the controller's parameters."""

from __future__ import annotations

import math

from companion.config import Config
from companion.config.controller import AxisSection, interval
from companion.control.altitude import AltitudeParams
from companion.control.mrac import AxisParams, nominal_weights, solve_lyapunov
from companion.control.position import PositionParams
from companion.control.types import GRAVITY_M_S2


def axis_params(axis: AxisSection, *, hedging: bool) -> AxisParams:
    """(23) solved, bounds as (lower, upper), and the adaptation rate of the controller chosen."""
    q1, q2 = axis.lyapunov_q
    _, p12, p22 = solve_lyapunov(axis.natural_frequency_rad_s, axis.damping_ratio, q1, q2)
    position_bound, velocity_bound = interval(axis.position_weight_bound), interval(axis.velocity_weight_bound)
    return AxisParams(
        natural_frequency_rad_s=axis.natural_frequency_rad_s,
        damping_ratio=axis.damping_ratio,
        gravity_m_s2=GRAVITY_M_S2,
        adaptation_rate=axis.adaptation_rate.hedged if hedging else axis.adaptation_rate.standard,
        lyapunov_12=p12,
        lyapunov_22=p22,
        position_weight_lower=position_bound[0],
        position_weight_upper=position_bound[1],
        velocity_weight_lower=velocity_bound[0],
        velocity_weight_upper=velocity_bound[1],
        hedging=hedging,
    )


def position_params(config: Config, *, hedging: bool) -> PositionParams:
    """The whole controller. A rig has no y and no altitude: theirs are placeholders that its step never uses."""
    controller, limits = config.controller, config.controller.limits
    x = axis_params(controller.axes.x, hedging=hedging)
    y = x if controller.axes.y is None else axis_params(controller.axes.y, hedging=hedging)
    cascade = controller.altitude
    altitude = (
        AltitudeParams(0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, GRAVITY_M_S2)
        if cascade is None
        else AltitudeParams(
            position_gain_1_s=cascade.position_gain_1_s,
            velocity_gain_1_s=cascade.velocity_gain_1_s,
            integral_gain_1_s2=cascade.integral_gain_1_s2,
            derivative_gain=cascade.derivative_gain,
            filter_bandwidth_rad_s=cascade.filter_bandwidth_rad_s,
            integral_limit_m_s2=cascade.integral_limit_m_s2,
            velocity_limit_m_s=cascade.velocity_limit_m_s,
            gravity_m_s2=GRAVITY_M_S2,
        )
    )
    return PositionParams(
        x=x,
        y=y,
        altitude=altitude,
        one_axis=config.vehicle.kind == "rig",
        hover_thrust=config.vehicle.hover_thrust,
        thrust_min=limits.thrust_min,
        thrust_max=limits.thrust_max,
        tilt_limit_rad=math.radians(limits.tilt_deg),
    )


def initial_weights(config: Config, params: AxisParams) -> tuple[float, float]:
    """Ŵ(0) of (22): zero as in the paper, or the nominal W, which gives feedback from the first tick."""
    return (0.0, 0.0) if config.controller.initial_weights == "zero" else nominal_weights(params)
