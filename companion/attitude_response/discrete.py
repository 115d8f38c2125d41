"""Responses step by step, the set-point held over each step: the closed forms of the kinds, kept for the next step."""

from __future__ import annotations

from functools import lru_cache

from companion.attitude_response.kind import LinearResponse, State, Step


@lru_cache(maxsize=256)
def step(response: LinearResponse, dt_s: float) -> Step:
    """The exact step of `dt_s` without the response's delay, which is the caller's: it has the set-points."""
    return response.kind.step(response.values, dt_s)


def at_rest(response: LinearResponse, output: float) -> State:
    """The state in which nothing moves."""
    return (output, 0.0, *(0.0,) * response.kind.further)
