"""Plant and companion in one program: frames are handed over in memory, in the datagrams that UDP would carry.

No thread and no socket: where the companion waits for bytes, the plant runs until there are some. The clock on the wall
is the plant's own, and moves only while the companion waits. So a flight is the same every time, and takes no longer
than its arithmetic.

`LockstepLink`: the two take turns as they do over sockets in lockstep, and a flight leaves the same bytes.
`OwnClockLink`: the companion goes by its own clock, as on a vehicle, with its timeouts, ages and rates.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable
from typing import Final

from companion.mavlink.link import LinkError
from sitl.autopilot.autopilot import Autopilot
from sitl.messages.streams import Profile
from sitl.wire.lockstep import Lockstep
from sitl.wire.plant import FIXED_EPOCH_US, Plant
from sitl.wire.ports import batches
from sitl.wire.wire import Channels, Peer

TIMEOUT_US: Final = 20_000  # of a receipt, as `open_link` has it


class VirtualWall:
    """A clock on the wall that is moved by hand; implements `companion.flight.host.clock.Wall`. Attribute: `now_us`."""

    def __init__(self, now_us: int) -> None:
        self.now_us = now_us

    def monotonic(self) -> float:
        """In seconds."""
        return 1e-6 * self.now_us

    def time_ns(self) -> int:
        """Since the epoch."""
        return 1000 * (FIXED_EPOCH_US + self.now_us)


class MemoryPort:
    """The plant's end: a `Port`.

    Attributes: `incoming` from the companion, `outgoing` to it, a datagram each.
    """

    stream = False
    number = 0

    def __init__(self) -> None:
        self.incoming: deque[bytes] = deque()
        self.outgoing: deque[bytes] = deque()
        self.connected = False

    def fileno(self) -> int:
        """There is nothing to wait for."""
        raise OSError("a port in memory has no descriptor")

    def receive(self) -> bytes:
        if not self.incoming:
            return b""
        self.connected = True
        return self.incoming.popleft()

    receive_waiting = receive  # the plant's turn comes when the companion has said all it has to say

    def send(self, frames: list[bytes]) -> None:
        if self.connected:  # as on a port that has heard nobody yet, what is sent before reaches nobody
            self.outgoing.extend(map(b"".join, batches(frames)))

    def close(self) -> None:
        """Nothing is held."""


class MemoryLink(ABC):
    """The companion's end, a `companion.mavlink.link.Link`, and the plant behind it.

    Args: `autopilot` of the plant; `stop` ends it; `channels`, what frames meet on their way; `peer`, who knows when
    the companion has ended, where the plant is to fly on after it (then `finish` must be called).
    Attributes: `wall`, the clock for the companion.
    """

    stream = False
    name = "memory"

    def __init__(
        self,
        autopilot: Autopilot,
        *,
        stop: Callable[[], bool] = lambda: False,
        channels: Channels | None = None,
        peer: Peer | None = None,
    ) -> None:
        self.wall = VirtualWall(autopilot.time_us)
        self._port = MemoryPort()
        self._plant = Plant(autopilot, FIXED_EPOCH_US)
        self._plant.add(self._port, Profile.ONBOARD, channels)
        self._stop, self._peer = stop, peer

    def receive(self) -> bytes:
        """The next datagram; empty where the plant has had nothing to say within the timeout.

        Raises `LinkError` when the plant has ended, and whatever goes wrong in it.
        """
        outgoing = self._port.outgoing
        if not outgoing:
            self._run()
            if not outgoing:
                return b""
        return outgoing.popleft()

    @abstractmethod
    def _run(self) -> None:
        """Let the plant run until there is something to receive, or the timeout has passed."""

    def send(self, data: bytes) -> None:
        self._port.incoming.append(data)

    def lock(self) -> None:  # noqa: B027 - nothing to do is what it does
        """There is one other end."""

    def close(self) -> None:  # noqa: B027
        """Nothing is held."""

    def sleep(self, for_s: float) -> None:
        """The companion does not get to run for a while."""
        self.wall.now_us += round(1e6 * for_s)

    @abstractmethod
    def finish(self) -> None:
        """Run the plant to its end, after the companion's."""


class LockstepLink(MemoryLink):
    """Time stands still until the companion has answered."""

    def __init__(
        self,
        autopilot: Autopilot,
        *,
        stop: Callable[[], bool] = lambda: False,
        channels: Channels | None = None,
        peer: Peer | None = None,
    ) -> None:
        super().__init__(autopilot, stop=stop, channels=channels, peer=peer)
        self._turns = Lockstep(self._plant, stop, peer, self.wall.monotonic).run()

    def _run(self) -> None:
        if next(self._turns, None) is None:
            raise LinkError("the plant has ended")
        if not self._port.outgoing:  # time stands still, but for the clock on the wall
            self.wall.now_us += TIMEOUT_US

    def finish(self) -> None:
        """Run the plant to its end, after the companion's. Raises `LockstepTimeoutError`."""
        for _ in self._turns:
            self.wall.now_us += TIMEOUT_US


class OwnClockLink(MemoryLink):
    """The companion's clock and the plant's are one, which moves while the companion waits."""

    def _run(self) -> None:
        if self._stop():
            raise LinkError("the plant has ended")
        self._run_until(self.wall.now_us + TIMEOUT_US, lambda: bool(self._port.outgoing))

    def sleep(self, for_s: float) -> None:
        """The companion does not get to run for a while. The plant does, and what it sends waits."""
        self._run_until(self.wall.now_us + round(1e6 * for_s), lambda: False)

    def finish(self) -> None:
        """Run the plant to its end, after the companion's."""
        if self._peer is not None:
            self._peer.gone = True
        self._run_until(None, self._stop)

    def _run_until(self, until_us: int | None, enough: Callable[[], bool]) -> None:
        plant, wall = self._plant, self.wall
        (wire,) = plant.wires
        plant.receive_all()
        while not enough():
            due_us = wire.due_us
            if until_us is not None and due_us > until_us:
                wall.now_us = max(until_us, wall.now_us)
                break
            wall.now_us = max(due_us, wall.now_us)
            plant.advance(wall.now_us)
