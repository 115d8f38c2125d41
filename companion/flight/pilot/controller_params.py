"""From a config to the controller's parameters."""

from __future__ import annotations

import math

from companion.attitude_response.inverse import inverse
from companion.config import Config
from companion.config.attitude import response_of
from companion.config.controller import AdaptationRates, AxisSection, BiasSection, interval
from companion.control.altitude import AltitudeParams
from companion.control.estimate_correction import CorrectionParams
from companion.control.hover import HoverParams
from companion.control.limits import LimitParams
from companion.control.mrac import AxisParams, nominal_weights, solve_lyapunov
from companion.control.position import PositionParams
from companion.control.setpoint import SetpointParams
from companion.control.tracking import LeadParams
from companion.control.types import GRAVITY_M_S2

_HOVER_RATE_1_S = 0.5  # of its estimate: settled in six seconds, and gusts of a second hardly move it
_HOVER_FILTER_RAD_S = 5.0
HOVER_RANGE = 1.6  # the estimate stays within this factor of where it began: no load doubles in flight
_HOVER_SLEW_1_S = 0.05


def axis_params(axis: AxisSection, bias: BiasSection | None, *, hedging: bool) -> AxisParams:
    """(23) solved, bounds as (lower, upper), and the adaptation rates of the controller chosen."""

    def rate(rates: AdaptationRates) -> float:
        return rates.hedged if hedging else rates.standard

    q1, q2 = axis.lyapunov_q
    _, p12, p22 = solve_lyapunov(axis.natural_frequency_rad_s, axis.damping_ratio, q1, q2)
    position_bound, velocity_bound = interval(axis.position_weight_bound), interval(axis.velocity_weight_bound)
    return AxisParams(
        natural_frequency_rad_s=axis.natural_frequency_rad_s,
        damping_ratio=axis.damping_ratio,
        gravity_m_s2=GRAVITY_M_S2,
        adaptation_rate=rate(axis.adaptation_rate),
        lyapunov_12=p12,
        lyapunov_22=p22,
        position_weight_lower=position_bound[0],
        position_weight_upper=position_bound[1],
        velocity_weight_lower=velocity_bound[0],
        velocity_weight_upper=velocity_bound[1],
        hedging=hedging,
        bias_adaptation_rate=0.0 if bias is None else rate(bias.adaptation_rate),
        bias_bound=0.0 if bias is None else bias.bound,
    )


def hover_params(config: Config, hover_thrust: float) -> HoverParams:
    """The estimator about the hover thrust it begins with; with a rate of zero where none is wanted."""
    limits = config.controller.limits
    estimated = config.vehicle.hover_thrust_source == "estimated"
    return HoverParams(
        rate_1_s=_HOVER_RATE_1_S if estimated else 0.0,
        filter_rad_s=_HOVER_FILTER_RAD_S,
        lower=max(hover_thrust / HOVER_RANGE, limits.thrust_min),
        upper=min(hover_thrust * HOVER_RANGE, limits.thrust_max),
        slew_1_s=_HOVER_SLEW_1_S,
        gravity_m_s2=GRAVITY_M_S2,
    )


def position_params(config: Config, *, hedging: bool) -> PositionParams:
    """The whole controller. A rig has no y and no altitude: theirs are placeholders that its step never uses."""
    controller, limits = config.controller, config.controller.limits
    x = axis_params(controller.axes.x, controller.bias, hedging=hedging)
    y = x if controller.axes.y is None else axis_params(controller.axes.y, controller.bias, hedging=hedging)
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
        one_axis=config.vehicle_kind.one_axis,
        anchored_at_setpoint=controller.anchor == "setpoint",
        limits=LimitParams(
            tilt_rad=math.radians(limits.tilt_deg),
            thrust_min=limits.thrust_min,
            thrust_max=limits.thrust_max,
            acceleration_m_s2=math.inf if limits.acceleration_m_s2 is None else limits.acceleration_m_s2,
            gravity_m_s2=GRAVITY_M_S2,
        ),
        setpoint=SetpointParams(
            speed_m_s=math.inf if limits.speed_m_s is None else limits.speed_m_s,
            yaw_rate_rad_s=math.radians(limits.yaw_rate_deg_s),
        ),
        hover=hover_params(config, config.vehicle.hover_thrust),
    )


def lead_params(config: Config) -> LeadParams:
    """What a trajectory's force is fed forward through: the inverse of the identified responses."""
    x, y = config.attitude.x, config.attitude.y or config.attitude.x
    pitch, roll = inverse(response_of(x)), inverse(response_of(y))
    return LeadParams(pitch.first_s, pitch.second_s2, roll.first_s, roll.second_s2, min(pitch.delay_s, roll.delay_s))


def correction_params(config: Config) -> CorrectionParams | None:
    """Of the estimate; None where it is believed as it is."""
    section = config.controller.estimate_correction
    if section is None:
        return None
    return CorrectionParams(section.filter_s, section.position_gain_s, section.velocity_gain, section.limit_m_s)


def initial_weights(config: Config, params: AxisParams) -> tuple[float, float]:
    """Ŵ(0) of (22): zero as in the paper, or the nominal W, which gives feedback from the first tick."""
    return (0.0, 0.0) if config.controller.initial_weights == "zero" else nominal_weights(params)
