"""Model reference adaptive control of one horizontal axis, hedged or standard: (19)-(23).

The plant of one axis is the double integrator ``ẋ = A x + B w``, ``x = [position, velocity]``. Equation (15) has
``B = [0, -g]`` for pitch and ``[0, g]`` for roll. Here ``w`` and ``u`` are the horizontal specific force over g, so
that ``B = [0, g]`` on both axes and the nominal weights ``[ωn²/g, 2ζωn/g]`` are positive: for small angles
``w_x = -θ`` and ``w_y = φ``. (Equations (13)-(14) swap f_dx and f_dy; (15) is consistent, and is followed.)
"""

from __future__ import annotations

from typing import NamedTuple

from companion.control.projection import adapt


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
    bias_adaptation_rate: float = 0.0  # of the weight on the regressor 1, against constant forces; zero: there is none
    bias_bound: float = 0.0  # specific force over g


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
    bias_weight: float


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


def on_bound(params: AxisParams, state: AxisState) -> int:
    """How many weights of an axis rest on a bound of their projection."""
    count = 0
    if not params.position_weight_lower < state.position_weight < params.position_weight_upper:
        count += 1
    if not params.velocity_weight_lower < state.velocity_weight < params.velocity_weight_upper:
        count += 1
    if params.bias_adaptation_rate > 0.0 and not -params.bias_bound < state.bias_weight < params.bias_bound:
        count += 1
    return count


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
        0.0,
    )


def step(
    params: AxisParams,
    state: AxisState,
    over: tuple[float, float, float, float, float, float],
    shift_m: float,
    position_m: float,
    velocity_m_s: float,
    actuator: float,
    command_m: float,
    dt_s: float,
) -> tuple[AxisState, AxisOutput]:
    """One tick: move both references to now, adapt, and command.

    `over` is the reference model's `Transition` over `dt_s`; `shift_m` is how far the anchor has moved along the axis
    since the last tick: the references and the command before move the other way, since the double integrator does not
    care where its origin is.

    The command u was held over the tick while the actuator output w moved; the hedge therefore takes the mean of w at
    its two ends. Without hedging the reference is the ideal one.

    The bias weight has the regressor 1 and obeys (22) with a rate and a bound of its own: it takes up a constant force.
    It leaves (24)-(25) as they are, since it adds no more than a bounded input.
    """
    # Unpacked once: attributes of a NamedTuple cost CPython more than the arithmetic.
    omega, _, gravity, adaptation, p12, p22, lower1, upper1, lower2, upper2, hedging, bias_rate, bias_bound = params
    ideal1, ideal2, reference1, reference2, weight1, weight2, command_before, control_before, actuator_before, bias = (
        state
    )
    stiffness = omega * omega
    f11, f12, f21, f22, g1, g2 = over
    ideal1 -= shift_m
    reference1 -= shift_m
    drive = stiffness * (command_before - shift_m)
    next_ideal1 = f11 * ideal1 + f12 * ideal2 + g1 * drive  # (19)
    next_ideal2 = f21 * ideal1 + f22 * ideal2 + g2 * drive
    deficit = 0.5 * (actuator_before + actuator) - control_before
    if hedging:  # (20)
        drive = drive + gravity * deficit
        next1 = f11 * reference1 + f12 * reference2 + g1 * drive
        next2 = f21 * reference1 + f22 * reference2 + g2 * drive
    else:
        next1, next2 = next_ideal1, next_ideal2

    error1 = position_m - next1
    error2 = velocity_m_s - next2
    steer = gravity * (p12 * error1 + p22 * error2)  # e'PB
    rate = adaptation * steer  # (22): gamma x e'PB
    weight1 = adapt(weight1, rate * position_m, lower1, upper1, dt_s)
    weight2 = adapt(weight2, rate * velocity_m_s, lower2, upper2, dt_s)
    if bias_rate > 0.0:
        bias = adapt(bias, bias_rate * steer, -bias_bound, bias_bound, dt_s)
    control = (
        stiffness / gravity * command_m - weight1 * position_m - weight2 * velocity_m_s - bias
    )  # (21), K_r = wn^2/g
    return (
        AxisState(next_ideal1, next_ideal2, next1, next2, weight1, weight2, command_m, control, actuator, bias),
        AxisOutput(control, error1, error2, deficit),
    )
