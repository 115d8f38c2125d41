"""The problem as JSON of decimal strings, and back; its digest says "exactly this config". Standard library only."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from decimal import Context, Decimal

from companion.attitude_response.exact import NO_DELAY, Interval, decimal
from companion.attitude_response.kind import Value
from companion.attitude_response.kinds import KINDS
from companion.attitude_response.response import SHORTEST_DELAY_S, AttitudeResponse
from companion.certify.problem import AxisProblem, Problem, Sampling

EXACT = Context(prec=300)

Json = str | int | bool | None | Sequence["Json"] | Mapping[str, "Json"]
"""JSON without floating point numbers: a statement has none."""


def statement(problem: Problem) -> dict[str, Json]:
    """The problem as JSON: every number a decimal string in one canonical form, an interval a list of two."""
    return {
        "axes": {name: _axis_json(axis) for name, axis in problem.axes.items()},
        "yaw_free": problem.yaw_free,
        "sampling": {name: _sampling_json(sampling) for name, sampling in problem.sampling.items()},
    }


def problem_of(stated: object) -> Problem:
    """The problem that a statement tells; the inverse of `statement`.

    Raises
    ------
    ValueError
        One line, if a key is missing or unknown, or a number is malformed or out of its range.
    """
    fields = _object(stated, "problem", {"axes", "yaw_free", "sampling"})
    axes, yaw_free, sampling = fields["axes"], fields["yaw_free"], fields["sampling"]
    if not isinstance(axes, Mapping) or not isinstance(sampling, Mapping) or not isinstance(yaw_free, bool):
        raise ValueError("problem: axes and sampling must be objects and yaw_free true or false")
    return Problem(
        {str(name): _axis_of(axis) for name, axis in axes.items()},
        yaw_free,
        {str(name): _sampling_of(item) for name, item in sampling.items()},
    )


def covers(stated: object, wanted: object) -> bool:
    """Whether a proof of one statement holds for a flight of another: the same, or with a delay where that has none.

    A config of no delay is flown over a link that has one; its certificate may count it, from `SHORTEST_DELAY_S` on.

    Raises
    ------
    ValueError
        As `problem_of`.
    """
    if digest(stated) == digest(wanted):
        return True
    proven, flown = problem_of(stated), problem_of(wanted)
    axes = dict(flown.axes)
    for name, axis in axes.items():
        delay = proven.axes[name].response.delay_s if name in proven.axes else NO_DELAY
        if axis.response.delay_s == NO_DELAY and delay.lower == SHORTEST_DELAY_S:
            axes[name] = replace(axis, response=replace(axis.response, delay_s=delay))
    return proven == replace(flown, axes=axes)


def decimal_text(number: Decimal) -> str:
    """The number in canonical form: no exponent, no trailing zeros."""
    text = format(EXACT.normalize(number), "f")
    return "0" if text == "-0" else text


def digest(content: object) -> str:
    """SHA-256 in hexadecimal over the canonical JSON (sorted keys, no spaces) of the content."""
    canonical = json.dumps(content, sort_keys=True, separators=(",", ":"), ensure_ascii=True)
    return hashlib.sha256(canonical.encode()).hexdigest()


def _axis_json(axis: AxisProblem) -> dict[str, Json]:
    response, dynamics = axis.response, axis.response.dynamics
    values = zip(dynamics.key_names(), dynamics.values(), strict=True)
    described: dict[str, Json] = {"kind": dynamics.name} | {key: _value_json(value) for key, value in values}
    return {
        "natural_frequency_rad_s": decimal_text(axis.natural_frequency_rad_s),
        "damping_ratio": decimal_text(axis.damping_ratio),
        "weights_lower": [decimal_text(w) for w in axis.weights_lower],
        "weights_upper": [decimal_text(w) for w in axis.weights_upper],
        "gravity_m_s2": decimal_text(axis.gravity_m_s2),
        "response": described | {"delay_s": _interval_json(response.delay_s), "pade_order": response.pade_order},
    }


def _sampling_json(sampling: Sampling) -> dict[str, Json]:
    """Without a bias weight its rate is not stated, so that older certificates speak of the same problem."""
    bias = sampling.bias_adaptation_rate
    return ({"bias_adaptation_rate": decimal_text(bias)} if bias else {}) | {
        "tick_rate_hz": decimal_text(sampling.tick_rate_hz),
        "adaptation_rate": decimal_text(sampling.adaptation_rate),
        "position_m": decimal_text(sampling.position_m),
        "velocity_m_s": decimal_text(sampling.velocity_m_s),
        "lyapunov_q": [decimal_text(w) for w in sampling.lyapunov_q],
    }


def _sampling_of(stated: object) -> Sampling:
    names = {"tick_rate_hz", "adaptation_rate", "position_m", "velocity_m_s"}
    if isinstance(stated, Mapping) and "bias_adaptation_rate" in stated:
        names.add("bias_adaptation_rate")
        if stated["bias_adaptation_rate"] == "0":
            raise ValueError("bias_adaptation_rate is not stated where it is zero")
    fields = _object(stated, "sampling", {*names, "lyapunov_q"})
    return Sampling(
        **{name: _number(fields[name], name) for name in names},
        lyapunov_q=_pair(fields["lyapunov_q"], "lyapunov_q"),
    )


def _axis_of(stated: object) -> AxisProblem:
    numbers = {"natural_frequency_rad_s", "damping_ratio", "gravity_m_s2"}
    fields = _object(stated, "axis", {*numbers, "weights_lower", "weights_upper", "response"})
    return AxisProblem(
        natural_frequency_rad_s=_number(fields["natural_frequency_rad_s"], "natural_frequency_rad_s"),
        damping_ratio=_number(fields["damping_ratio"], "damping_ratio"),
        weights_lower=_pair(fields["weights_lower"], "weights_lower"),
        weights_upper=_pair(fields["weights_upper"], "weights_upper"),
        response=_response_of(fields["response"]),
        gravity_m_s2=_number(fields["gravity_m_s2"], "gravity_m_s2"),
    )


def _response_of(stated: object) -> AttitudeResponse:
    name = stated.get("kind") if isinstance(stated, Mapping) else None
    kind = next((kind for kind in KINDS if kind.name == name), None)
    if kind is None:
        *names, last = (kind.name for kind in KINDS)
        raise ValueError(f"response: kind must be {', '.join(names)} or {last}")
    fields = _object(stated, "response", {"kind", "delay_s", "pade_order", *kind.key_names()})
    dynamics = kind.of(_value_of(fields[key], key, of_lists=kind.of_lists) for key in kind.key_names())
    pade_order = fields["pade_order"]
    if not isinstance(pade_order, int) or isinstance(pade_order, bool):
        raise ValueError("response: pade_order must be an integer")
    return AttitudeResponse(dynamics, _interval_of(fields["delay_s"]), pade_order)


def _value_json(value: Value) -> Json:
    return _interval_json(value) if isinstance(value, Interval) else [_interval_json(c) for c in value]


def _value_of(stated: object, key: str, *, of_lists: bool) -> Value:
    return tuple(_interval_of(c) for c in _list(stated, key)) if of_lists else _interval_of(stated)


def _interval_json(value: Interval) -> Json:
    if value.lower == value.upper:
        return decimal_text(value.lower)
    return [decimal_text(value.lower), decimal_text(value.upper)]


def _interval_of(stated: object) -> Interval:
    if isinstance(stated, str):
        number = _number(stated, "value")
        return Interval(number, number)
    return Interval(*_pair(stated, "interval"))


def _number(stated: object, name: str) -> Decimal:
    if not isinstance(stated, str):
        raise ValueError(f"{name} must be a decimal string")
    number = decimal(stated)
    if decimal_text(number) != stated:
        raise ValueError(f"{name} is not written in canonical form: {stated!r}")
    return number


def _pair(stated: object, name: str) -> tuple[Decimal, Decimal]:
    numbers = [_number(item, name) for item in _list(stated, name)]
    if len(numbers) != 2:
        raise ValueError(f"{name} must have two numbers")
    return numbers[0], numbers[1]


def _list(stated: object, name: str) -> list[object]:
    if not isinstance(stated, (list, tuple)):
        raise ValueError(f"{name} must be a list")
    return list(stated)


def _object(stated: object, name: str, required: set[str]) -> Mapping[str, object]:
    if not isinstance(stated, Mapping):
        raise ValueError(f"{name} must be an object")
    missing, unknown = required - set(stated), set(stated) - required
    if missing or unknown:
        raise ValueError(f"{name}: " + ", ".join([f"missing {k}" for k in missing] + [f"unknown {k}" for k in unknown]))
    return stated
