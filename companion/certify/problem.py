"""What is to be certified, as the exact numbers written in the config.

Standard library only: the process in flight reads these too. Every number is a `decimal.Decimal`, so that the proof
is about the number as written ("0.02") and not about the double nearest to it."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from decimal import Decimal
from fractions import Fraction
from typing import NamedTuple

MAX_PADE_ORDER = 4
SHORTEST_DELAY_S = Decimal("0.00001")
FREQUENCIES_RAD_S = (Decimal("0.001"), Decimal(10_000))  # of reference models and attitude responses
MAX_ORDER = 6  # of a transfer function
MAX_DIGITS = (
    40  # of a decimal, on either side of the point: enough for any config, and no number can stall a verification
)


class Interval(NamedTuple):
    """A parameter between two ends, both included; equal ends mean a plain value."""

    lower: Decimal
    upper: Decimal


def decimal(value: str | int | float | Decimal) -> Decimal:
    """The decimal as written; a float stands for its shortest text.

    Raises
    ------
    ValueError
        If it is not a finite decimal number of at most `MAX_DIGITS` digits on either side of the point.
    """
    try:
        number = Decimal(str(value))
    except ArithmeticError:
        raise ValueError(f"{value!r} is not a decimal number") from None
    if not number.is_finite():
        raise ValueError(f"{value!r} is not a finite number")
    exponent = number.as_tuple().exponent
    if not isinstance(exponent, int) or exponent < -MAX_DIGITS or number.adjusted() > MAX_DIGITS:
        raise ValueError(f"{value!r} has more than {MAX_DIGITS} digits on one side of the point")
    return number


def interval(lower: str | int | float | Decimal, upper: str | int | float | Decimal | None = None) -> Interval:
    """An interval from its two ends, or from one plain value."""
    low = decimal(lower)
    return Interval(low, low if upper is None else decimal(upper))


@dataclass(frozen=True)
class FirstOrder:
    """w' = M (u - w), eq. (18) written in its output; M in rad/s."""

    bandwidth_rad_s: Interval


@dataclass(frozen=True)
class SecondOrder:
    """w'' = wn^2 (u - w) - 2 zeta wn w'; wn in rad/s."""

    natural_frequency_rad_s: Interval
    damping_ratio: Interval


@dataclass(frozen=True)
class TransferFunction:
    """Strictly proper w/u = numerator / denominator, highest power of s first, s in rad/s.

    The two constant terms must be written alike: that is unit gain at rest, also when they are intervals (they move
    together)."""

    numerator: tuple[Interval, ...]
    denominator: tuple[Interval, ...]


NO_DELAY = Interval(Decimal(0), Decimal(0))


@dataclass(frozen=True)
class AttitudeResponse:
    """Closed-loop attitude dynamics from commanded to reached tilt, eq. (16).

    Parameters
    ----------
    dynamics
        Response without delay.
    delay_s
        Transport delay in s, zero or an interval above zero.
    pade_order
        Order of the Pade approximant that stands for the delay, 1 to `MAX_PADE_ORDER`.
    """

    dynamics: FirstOrder | SecondOrder | TransferFunction
    delay_s: Interval = NO_DELAY
    pade_order: int = 1

    def __post_init__(self) -> None:
        check_response(self)


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
        _check_frequency("natural frequency", self.natural_frequency_rad_s)
        names = ("position", "velocity")
        bounds = zip(names, self.weights_lower, nominal_weights(self), self.weights_upper, strict=True)
        for name, lower, nominal, upper in bounds:
            if not lower <= nominal <= upper:
                raise ValueError(
                    f"weight bounds [{lower}, {upper}] do not contain the nominal {name} weight {float(nominal):.4g}"
                )
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
        if self.sampling and set(self.sampling) != set(self.axes):
            raise ValueError("sampling must be given for every axis or for none")


def nominal_weights(problem: AxisProblem) -> tuple[Fraction, Fraction]:
    """Weights that make the plant the reference model: `[wn^2, 2 zeta wn] / g` in rad/m, rad s/m (Assumption 1)."""
    wn, zeta, g = (Fraction(n) for n in (problem.natural_frequency_rad_s, problem.damping_ratio, problem.gravity_m_s2))
    return wn * wn / g, 2 * zeta * wn / g


def check_response(response: AttitudeResponse) -> None:
    """Refuse an attitude response that is no stable, strictly proper response of unit gain.

    Raises
    ------
    ValueError
        One line naming what is wrong.
    """
    dynamics, delay = response.dynamics, response.delay_s
    if isinstance(dynamics, FirstOrder):
        _check_positive("bandwidth", dynamics.bandwidth_rad_s)
        for end in dynamics.bandwidth_rad_s:
            _check_frequency("bandwidth", end)
    elif isinstance(dynamics, SecondOrder):
        _check_positive("attitude natural frequency", dynamics.natural_frequency_rad_s)
        for end in dynamics.natural_frequency_rad_s:
            _check_frequency("attitude natural frequency", end)
        _check_positive("attitude damping ratio", dynamics.damping_ratio)
    else:
        _check_transfer_function(dynamics)
    if not isinstance(response.pade_order, int) or not 1 <= response.pade_order <= MAX_PADE_ORDER:
        raise ValueError(f"pade_order must be 1 to {MAX_PADE_ORDER}, not {response.pade_order}")
    _check_order("delay", delay)
    if 0 < delay.upper < SHORTEST_DELAY_S:
        raise ValueError(f"delay {delay.upper} s is too short to tell from none: write 0")
    if delay.lower < 0 or (delay.lower == 0 < delay.upper):
        raise ValueError(f"delay must be zero or an interval above zero, not {delay.lower} to {delay.upper} s")


def _check_order(name: str, value: Interval) -> None:
    if value.lower > value.upper:
        raise ValueError(f"{name} interval is upside down: {value.lower} to {value.upper}")


def _check_frequency(name: str, value: Decimal) -> None:
    lowest, highest = FREQUENCIES_RAD_S
    if not lowest <= value <= highest:
        raise ValueError(f"{name} {value} rad/s is outside {lowest} to {highest} rad/s")


def _check_positive(name: str, value: Interval) -> None:
    _check_order(name, value)
    if value.lower <= 0:
        raise ValueError(f"{name} must be positive, not {value.lower}")


def _check_transfer_function(dynamics: TransferFunction) -> None:
    numerator, denominator = dynamics.numerator, dynamics.denominator
    for coefficient in (*numerator, *denominator):
        _check_order("attitude transfer function coefficient", coefficient)
    if len(denominator) < 2 or not 1 <= len(numerator) < len(denominator):
        raise ValueError("attitude transfer function must be strictly proper")
    if len(denominator) > MAX_ORDER + 1:
        raise ValueError(f"attitude transfer function has an order above {MAX_ORDER}")
    if denominator[0].lower != denominator[0].upper or denominator[0].lower <= 0:
        raise ValueError("leading denominator coefficient must be one positive value")
    if numerator[-1] != denominator[-1]:
        raise ValueError(f"attitude dc gain is not 1: constant terms {numerator[-1].lower}, {denominator[-1].lower}")
    for ends in ([c.lower for c in denominator], [c.upper for c in denominator]):
        if not is_hurwitz([Fraction(c) for c in ends]):
            raise ValueError("attitude transfer function is unstable")


def is_hurwitz(polynomial: list[Fraction]) -> bool:
    """Whether all roots lie in the open left half plane: exact Routh table, highest power first."""
    if polynomial[0] < 0:
        polynomial = [-c for c in polynomial]
    upper, lower = polynomial[0::2], polynomial[1::2]
    while lower:
        if upper[0] <= 0 or lower[0] <= 0:
            return False
        ratio = upper[0] / lower[0]
        padded = lower[1:] + [Fraction(0)] * (len(upper) - len(lower))
        upper, lower = lower, [u - ratio * p for u, p in zip(upper[1:], padded, strict=True)]
    return upper[0] > 0
