"""The companion's link as a scenario hands it over: one of two transports, and a hold on the process behind it.

The plant learns from it when the companion has taken in everything and waits, so that lockstep needs no answer to go
on. What happens to the companion itself - it is stopped, stalls, loses its link - happens here, in its own thread,
between two receipts: at the same sample in every run.
"""

from __future__ import annotations

import time
from collections.abc import Callable

from companion.mavlink.link import Link, LinkError


class WatchedLink:
    """Wraps a link. Implements `sitl.wire.wire.Peer` for the plant.

    Attributes: `ended`, set by whoever ran the flight process; `gone`, set by the plant.
    """

    stream = False
    name = "plant"

    def __init__(self) -> None:
        self._link: Link
        self._received = 0
        self._waiting = False
        self._next: list[Callable[[], None]] = []
        self._unplugged = False
        self._slow_s = 0.0
        self.ended = False
        self.gone = False

    def attach(self, link: Link, sleep: Callable[[float], None] = time.sleep) -> None:
        """The link to wrap, and how time passes on it. The plant must know this object first."""
        self._link = link
        self._sleep = sleep

    # --- the companion's side ---------------------------------------------------------------------------------------

    def receive(self) -> bytes:
        self._waiting = True
        data = self._link.receive()
        self._waiting = False  # before it counts, so that nobody sees it waiting with nothing left to take
        while self._next and data:
            self._next.pop(0)()
        if self._unplugged:
            raise LinkError(f"link {self.name}: unplugged")
        if data:
            self._received += 1
        return data

    def send(self, data: bytes) -> None:
        if self._unplugged:
            raise LinkError(f"link {self.name}: unplugged")
        if self._slow_s:
            slow_s, self._slow_s = self._slow_s, 0.0
            self._sleep(slow_s)
        self._link.send(data)

    def lock(self) -> None:
        self._link.lock()

    def close(self) -> None:
        self._link.close()

    # --- the plant's side -------------------------------------------------------------------------------------------

    def idle(self, sent: int) -> bool:
        """Whether it has taken in `sent` datagrams and waits for the next, or has ended."""
        return self.ended or (self._received == sent and self._waiting)

    def before_next(self, action: Callable[[], None]) -> None:
        """Do this in the companion's thread as soon as the next datagram has come."""
        self._next.append(action)

    def stall(self, for_s: float) -> None:
        """The process does not get to run for a while, with the next datagram in its hands."""
        self.before_next(lambda: self._sleep(for_s))

    def overrun(self, for_s: float) -> None:
        """The next tick takes so much longer."""
        self._slow_s = for_s

    def unplug(self) -> None:
        """The device is gone."""
        self._unplugged = True
