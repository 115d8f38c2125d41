"""From a section of the config to the attitude response that it describes, in the numbers as written."""

from __future__ import annotations

from companion.attitude_response.exact import NO_DELAY, Interval
from companion.attitude_response.exact import interval as exact_interval
from companion.attitude_response.response import AttitudeResponse
from companion.config.attitude import ResponseSection


def response_of(section: ResponseSection) -> AttitudeResponse:
    """The response. Raises `ValueError` with one line for an impossible one."""
    kind = section.kind
    dynamics = kind.of(tuple(map(_interval, v)) if kind.of_lists else _interval(v) for v in section.values)
    delay = _interval(section.delay_s) if section.delay_s else NO_DELAY
    return AttitudeResponse(dynamics, delay, section.pade_order)


def _interval(value: float | tuple[float, float]) -> Interval:
    return exact_interval(*value) if isinstance(value, tuple) else exact_interval(value)
