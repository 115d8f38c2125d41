"""Model reference adaptive control of one horizontal axis, hedged or standard: (19)-(23).

The plant of one axis is the double integrator ``ẋ = A x + B w``, ``x = [position, velocity]``. Equation (15) has
``B = [0, -g]`` for pitch and ``[0, g]`` for roll. Here ``w`` and ``u`` are the horizontal specific force over g, so
that ``B = [0, g]`` on both axes and the nominal weights ``[ωn²/g, 2ζωn/g]`` are positive: for small angles
``w_x = -θ`` and ``w_y = φ``. (Equations (13)-(14) swap f_dx and f_dy; (15) is consistent, and is followed.)
"""

from __future__ import annotations

from typing import NamedTuple

from companion.control.projection import adapt
from companion.control.reference_model import propagate, transition


class AxisParams(NamedTuple):
    """One axis. Weights are dimensionless per metre and per metre a second, since u is specific force over g."""

    natural_frequency_rad_s: float
    damping_ratio: float
    gravity_m_s2: float
    adaptation_rate: float
    lyapunov_12: float  # P of (23): the entries that e^T P B needs
    lyapunov_22: float
    position_weight_lower: float
    position_weight_upper: float
    velocity_weight_lower: float
    velocity_weight_upper: float
    hedging: bool


class AxisState(NamedTuple):
    """References and weights at the last tick, and what went in and out then."""

    ideal_position_m: float
    ideal_velocity_m_s: float
    reference_position_m: float
    reference_velocity_m_s: float
    position_weight: float
    velocity_weight: float
    command_m: float
    control: float
    actuator: float


class AxisOutput(NamedTuple):
    """The command to the attitude loop, and why."""

    control: float  # u: specific force over g, before any limit
    error_position_m: float  # e = x - x_r
    error_velocity_m_s: float
    deficit: float  # w - u over the last tick


def solve_lyapunov(
    natural_frequency_rad_s: float, damping_ratio: float, q1: float, q2: float
) -> tuple[float, float, float]:
    """P of (23), ``A_rᵀ P + P A_r = -diag(q1, q2)``, as (P11, P12, P22)."""
    stiffness = natural_frequency_rad_s * natural_frequency_rad_s
    damping = 2.0 * damping_ratio * natural_frequency_rad_s
    p12 = q1 / (2.0 * stiffness)
    p22 = (q2 + 2.0 * p12) / (2.0 * damping)
    return damping * p12 + stiffness * p22, p12, p22


def nominal_weights(params: AxisParams) -> tuple[float, float]:
    """W_x of Assumption 1: what the weights would be if the model were exact, ``[ωn²/g, 2ζωn/g]``."""
    omega = params.natural_frequency_rad_s
    return omega * omega / params.gravity_m_s2, 2.0 * params.damping_ratio * omega / params.gravity_m_s2


def start(
    position_m: float, velocity_m_s: float, position_weight: float, velocity_weight: float, actuator: float
) -> AxisState:
    """Both references on the vehicle, command where it stands: the first error and the first deficit are zero."""
    return AxisState(
        position_m,
        velocity_m_s,
        position_m,
        velocity_m_s,
        position_weight,
        velocity_weight,
        position_m,
        actuator,
        actuator,
    )


def step(
    params: AxisParams,
    state: AxisState,
    position_m: float,
    velocity_m_s: float,
    actuator: float,
    command_m: float,
    dt_s: float,
) -> tuple[AxisState, AxisOutput]:
    """One tick: move both references to now, adapt, and command.

    The command u was held over the tick while the actuator output w moved; the hedge therefore takes the mean of w at
    its two ends. Without hedging the reference is the ideal one.
    """
    stiffness = params.natural_frequency_rad_s * params.natural_frequency_rad_s
    over = transition(params.natural_frequency_rad_s, params.damping_ratio, dt_s)
    drive = stiffness * state.command_m
    ideal_position, ideal_velocity = propagate(over, state.ideal_position_m, state.ideal_velocity_m_s, drive)  # (19)
    deficit = 0.5 * (state.actuator + actuator) - state.control
    if params.hedging:  # (20)
        reference_position, reference_velocity = propagate(
            over,
            state.reference_position_m,
            state.reference_velocity_m_s,
            drive + params.gravity_m_s2 * deficit,
        )
    else:
        reference_position, reference_velocity = ideal_position, ideal_velocity

    error_position = position_m - reference_position
    error_velocity = velocity_m_s - reference_velocity
    error_pb = params.gravity_m_s2 * (params.lyapunov_12 * error_position + params.lyapunov_22 * error_velocity)
    rate = params.adaptation_rate * error_pb  # (22): γ x eᵀPB
    position_weight = adapt(
        state.position_weight, rate * position_m, params.position_weight_lower, params.position_weight_upper, dt_s
    )
    velocity_weight = adapt(
        state.velocity_weight, rate * velocity_m_s, params.velocity_weight_lower, params.velocity_weight_upper, dt_s
    )
    control = (  # (21), K_r = ωn²/g
        stiffness / params.gravity_m_s2 * command_m - position_weight * position_m - velocity_weight * velocity_m_s
    )
    next_state = AxisState(
        ideal_position,
        ideal_velocity,
        reference_position,
        reference_velocity,
        position_weight,
        velocity_weight,
        command_m,
        control,
        actuator,
    )
    return next_state, AxisOutput(control, error_position, error_velocity, deficit)
