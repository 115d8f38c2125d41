"""What a file may say of one guard: enabled, limit and timeout, by kind of limit."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from companion.config.base import NonNegative, Positive, Section

Enabled = Annotated[bool, Field(description="whether it ends control")]
Timeout = Annotated[
    NonNegative,
    Field(description="s for which the limit must be exceeded, less the time in which it is not; 0 means at once"),
]


class GuardSection(Section):
    """One guard: on or off, the limit, and for how long it must be exceeded before control ends."""

    enabled: Enabled = True
    limit: Annotated[Positive, Field(description="past it control ends, in the unit of the guard's name")]
    timeout_s: Timeout = 0.0


class EventGuardSection(Section):
    """A guard against something that happens at once, so that there is nothing to wait for."""

    enabled: Enabled = True
    limit: Annotated[Positive, Field(description="past it control ends, in the unit of the guard's name")]
    timeout_s: Annotated[NonNegative, Field(le=0.0, description="s; always 0: it happens at once")] = 0.0


class CountGuardSection(Section):
    """A guard whose limit is a number of things that may be so."""

    enabled: Enabled = True
    limit: Annotated[NonNegative, Field(description="how many may be so; one more, and control ends")]
    timeout_s: Timeout = 0.0


class DerivedGuardSection(Section):
    """A guard whose limit, where it is not given, follows from another section."""

    enabled: Enabled = True
    limit: Annotated[
        Positive | None,
        Field(description="past it control ends, in the unit of the guard's name; left out, it follows from elsewhere"),
    ] = None
    timeout_s: Timeout = 0.0


class EnvelopeGuardSection(Section):
    """A guard whose limit is `controller.envelope`."""

    enabled: Enabled = True
    timeout_s: Timeout = 0.0
