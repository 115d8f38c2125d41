"""The link's bytes as they arrive, and what to do where they come faster than they can be flown.

A turn of the loop costs some ten times what it costs to see that a datagram is nothing. So where they come faster than
any vehicle sends, all that wait are taken at once, and of their poses only the newest is flown.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from companion.flight.vehicle_link.odometry import ODOMETRY
from companion.mavlink.codec import Frame
from companion.mavlink.link import Link

_LOOK_EVERY: Final = 64  # datagrams: often enough for a flood, too seldom to cost anything
_CROWDED_HZ: Final = 2000.0  # faster than a vehicle sends
_MOST: Final = 512  # datagrams taken at once then


class Arrivals:
    """Receives from a link. `wall_s` tells the time. Attribute: `waiting`, datagrams behind the one received last."""

    def __init__(self, link: Link, wall_s: Callable[[], float]) -> None:
        self._receive = link.receive
        self._take: Callable[[int], list[bytes]] | None = getattr(link, "waiting", None)  # a socket alone has a queue
        self._wall_s = wall_s
        self._left = _LOOK_EVERY  # datagrams until it is looked again
        self._count, self._looked_s, self._crowded = 0, 0.0, False
        self.waiting: list[bytes] = []

    def receive(self) -> bytes:
        """The next bytes of the link, or none within its timeout; with what waits behind them, in a crowd."""
        data = self._receive()
        self._left -= 1
        if not self._left:
            self._look()
        return data

    def _look(self) -> None:
        """How fast they come; and take what waits, where that is too fast."""
        if self._take is None:
            return
        if self._crowded:
            self.waiting = self._take(_MOST)
            self._count += 1 + len(self.waiting)
        else:
            self._count += _LOOK_EVERY
        if self._count >= _LOOK_EVERY:
            now_s = self._wall_s()
            self._crowded = self._count > _CROWDED_HZ * (now_s - self._looked_s)
            self._count, self._looked_s = 0, now_s
        self._left = 1 if self._crowded else _LOOK_EVERY


def without_overtaken(frames: list[Frame]) -> list[Frame]:
    """Frames but for the poses that a newer one among them has overtaken."""
    newest = max((n for n, frame in enumerate(frames) if frame.message_id == ODOMETRY.message_id), default=0)
    return [frame for n, frame in enumerate(frames) if n >= newest or frame.message_id != ODOMETRY.message_id]
