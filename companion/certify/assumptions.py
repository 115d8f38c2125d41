"""What a certificate takes for granted, each with its limits. Flight watches all but one. Standard library only."""

from decimal import Decimal

from companion.attitude_response.exact import Interval
from companion.attitude_response.kind import ParametricKind
from companion.certify.problem import AxisProblem, Problem
from companion.certify.statement import Json, decimal_text


def assumptions(problem: Problem) -> list[dict[str, Json]]:
    """The assumptions of a problem.

    Returns
    -------
    list of dict
        `quantity`, `axis`, `minimum`, `maximum` (decimal strings, or None where there is no limit) and `unit`. The
        position is that of the regressor, from the anchor. `regressor_rate` is zero: the adaptation rate is checked for
        regressors that stand still, and nobody watches that; what grows where they do not ends with weights on their
        bounds, which flight watches. A transfer function and the Pade order cannot be watched
        as numbers and are not listed.
    """
    result = []
    for name, sampling in problem.sampling.items():
        result.append(_limit("tick_rate", name, sampling.tick_rate_hz, None, "Hz"))
        result.append(_limit("position", name, None, sampling.position_m, "m"))
        result.append(_limit("velocity", name, None, sampling.velocity_m_s, "m/s"))
        result.append(_limit("regressor_rate", name, Decimal(0), Decimal(0), "1/s"))
    for name, axis in problem.axes.items():
        result += _axis_assumptions(name, axis)
    return result


def _axis_assumptions(name: str, axis: AxisProblem) -> list[dict[str, Json]]:
    result = [_limit("delay", name, axis.response.delay_s.lower, axis.response.delay_s.upper, "s")]
    bounds = zip(("position_weight", "velocity_weight"), axis.weights_lower, axis.weights_upper, strict=True)
    for (quantity, lower, upper), unit in zip(bounds, ("rad/m", "rad s/m"), strict=True):
        result.append(_limit(quantity, name, lower, upper, unit))
    for quantity, value, unit in response_parameters(axis):
        result.append(_limit(quantity, name, value.lower, value.upper, unit))
    return result


def response_parameters(axis: AxisProblem) -> list[tuple[str, Interval, str]]:
    """Named parameters of the attitude response: (name, value, unit); empty for a transfer function."""
    dynamics = axis.response.dynamics
    if not isinstance(dynamics, ParametricKind):
        return []
    values = zip(dynamics.parameters, dynamics.intervals(), strict=True)
    return [(parameter.name, value, parameter.unit) for parameter, value in values]


def _limit(quantity: str, axis: str, minimum: Decimal | None, maximum: Decimal | None, unit: str) -> dict[str, Json]:
    return {
        "quantity": quantity,
        "axis": axis,
        "minimum": None if minimum is None else decimal_text(minimum),
        "maximum": None if maximum is None else decimal_text(maximum),
        "unit": unit,
    }
