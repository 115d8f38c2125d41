"""What is to be certified, as the exact numbers written in the config.

Standard library only: the process in flight reads these too. Every number is a `decimal.Decimal`, so that the proof
is about the number as written ("0.02") and not about the double nearest to it."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from decimal import Decimal
from fractions import Fraction

from companion.attitude_response.exact import check_frequency
from companion.attitude_response.response import AttitudeResponse
from companion.attitude_response.transfer_function import TransferFunction


@dataclass(frozen=True)
class AxisProblem:
    """One horizontal axis: reference model, weight bounds and attitude response.

    Parameters
    ----------
    natural_frequency_rad_s, damping_ratio
        Reference model of eq. (19).
    weights_lower, weights_upper
        Projection bounds on the estimated weights of position (rad/m) and velocity (rad s/m), eq. (22).
    response
        Closed-loop attitude dynamics.
    gravity_m_s2
        Gravity, m/s^2.

    Raises
    ------
    ValueError
        One line, if a number is out of its range, if the bounds do not contain the nominal weights `[wn^2, 2 zeta wn]
        / g`, or if the delay is not shorter than the period of the reference model.
    """

    natural_frequency_rad_s: Decimal
    damping_ratio: Decimal
    weights_lower: tuple[Decimal, Decimal]
    weights_upper: tuple[Decimal, Decimal]
    response: AttitudeResponse
    gravity_m_s2: Decimal = Decimal("9.81")

    def __post_init__(self) -> None:
        for name in ("natural_frequency_rad_s", "damping_ratio", "gravity_m_s2"):
            if getattr(self, name) <= 0:
                raise ValueError(f"{name} must be positive, not {getattr(self, name)}")
        check_frequency("natural frequency", self.natural_frequency_rad_s)
        names = ("position", "velocity")
        bounds = zip(names, self.weights_lower, nominal_weights(self), self.weights_upper, strict=True)
        for name, lower, nominal, upper in bounds:
            if not lower <= nominal <= upper:
                raise ValueError(
                    f"weight bounds [{lower}, {upper}] do not contain the nominal {name} weight {float(nominal):.4g}"
                )
        dynamics, delayed = self.response.dynamics, self.response.delay_s.upper > 0
        if isinstance(dynamics, TransferFunction) and len(dynamics.denominator) == 2 and delayed:
            constant = dynamics.denominator[-1]
            if constant.lower != constant.upper:  # the slope of the output is then no affine function of it
                raise ValueError("a transfer function of first order with an interval and a delay: use bandwidth_rad_s")
        period = 2 * math.pi / float(self.natural_frequency_rad_s)
        if float(self.response.delay_s.upper) >= period:
            raise ValueError(f"delay {self.response.delay_s.upper} s is not below the reference period {period:.3g} s")


@dataclass(frozen=True)
class Sampling:
    """What the sampled adaptation of one axis flies with.

    Parameters
    ----------
    tick_rate_hz
        Rate of the controller.
    adaptation_rate
        gamma of eq. (22).
    position_m, velocity_m_s
        Largest magnitudes the regressors reach.
    lyapunov_q
        Diagonal of Q in eq. (23).
    bias_adaptation_rate
        That of the weight on the regressor 1; zero where there is none.
    """

    tick_rate_hz: Decimal
    adaptation_rate: Decimal
    position_m: Decimal
    velocity_m_s: Decimal
    lyapunov_q: tuple[Decimal, Decimal] = (Decimal(1), Decimal(1))
    bias_adaptation_rate: Decimal = Decimal(0)

    def __post_init__(self) -> None:
        for name in ("tick_rate_hz", "position_m", "velocity_m_s"):
            if getattr(self, name) <= 0:
                raise ValueError(f"{name} must be positive, not {getattr(self, name)}")
        for name in ("adaptation_rate", "bias_adaptation_rate"):
            if getattr(self, name) < 0:
                raise ValueError(f"{name} must not be negative, not {getattr(self, name)}")
        if min(self.lyapunov_q) <= 0:
            raise ValueError("lyapunov_q must be positive")


@dataclass(frozen=True)
class Problem:
    """Everything one certificate speaks of.

    Parameters
    ----------
    axes
        Axis problems by name, in the order they are shown.
    yaw_free
        Whether the yaw may turn: then the attitude responses of the two axes mix and both are certified together.
    sampling
        Sampled adaptation by axis, for every axis, or empty if it is no part of the certificate.
    """

    axes: Mapping[str, AxisProblem]
    yaw_free: bool = False
    sampling: Mapping[str, Sampling] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not self.axes:
            raise ValueError("a problem has at least one axis")
        if self.yaw_free and len(self.axes) != 2:
            raise ValueError("a free yaw mixes two axes: give both")
        responses = [axis.response for axis in self.axes.values()]
        if self.yaw_free and responses[0].delay_s != responses[1].delay_s:
            raise ValueError("a free yaw needs the same delay on both axes")
        if (
            self.yaw_free
            and responses[0].delay_s.upper
            and any(isinstance(response.dynamics, TransferFunction) for response in responses)
        ):  # its output turns with the yaw, and the delay does not
            raise ValueError("a free yaw with a delay needs responses of first or second order")
        if self.sampling and set(self.sampling) != set(self.axes):
            raise ValueError("sampling must be given for every axis or for none")


def nominal_weights(problem: AxisProblem) -> tuple[Fraction, Fraction]:
    """Weights that make the plant the reference model: `[wn^2, 2 zeta wn] / g` in rad/m, rad s/m (Assumption 1)."""
    wn, zeta, g = (Fraction(n) for n in (problem.natural_frequency_rad_s, problem.damping_ratio, problem.gravity_m_s2))
    return wn * wn / g, 2 * zeta * wn / g
