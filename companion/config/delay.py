"""What the certificate knows of delay, and what of it the link may take."""

from __future__ import annotations

from companion.config.attitude import AttitudeSection


def certified_delay_s(attitude: AttitudeSection) -> float:
    """The longest delay for which every axis is certified; zero where the certificate knows of none."""
    return min(upper for _, upper in _delays(attitude))


def link_share_s(attitude: AttitudeSection) -> float:
    """What the link may take of the certified delay, which is that of the vehicle and the link together.

    Of an interval its width, since the vehicle alone has the lower end; of a plain number all of it, for lack of
    knowledge; zero where the certificate knows of no delay.
    """
    return min(upper - lower if upper > lower else upper for lower, upper in _delays(attitude))


def _delays(attitude: AttitudeSection) -> list[tuple[float, float]]:
    delays = [section.delay_s for section in (attitude.x, attitude.y) if section is not None]
    return [delay if isinstance(delay, tuple) else (delay, delay) for delay in delays]
