"""Plant and companion in one program: frames are handed over in memory, in the datagrams that UDP would carry.

No thread and no socket: where the companion waits for bytes, the plant runs until there are some. So the two take turns
as they do over sockets in lockstep, and a flight leaves the same bytes.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from typing import Final

from companion.mavlink.link import LinkError
from sitl.autopilot.autopilot import Autopilot
from sitl.messages.streams import Profile
from sitl.wire.lockstep import Lockstep
from sitl.wire.plant import Plant
from sitl.wire.ports import batches
from sitl.wire.wire import Channels, Peer

STILL_S: Final = 1e-3  # before the first sample the companion goes by the wall clock, which needs time to pass


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


class MemoryLink:
    """The companion's end, a `companion.mavlink.link.Link`, and the plant behind it.

    Args: `autopilot` of the plant; `stop` ends it; `channels`, what frames meet on their way; `peer`, who knows when
    the companion has ended, where the plant is to fly on after it (then `finish` must be called).
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
        self._port = port = MemoryPort()
        self.plant = Plant(autopilot, lockstep=True)
        self.plant.add(port, Profile.ONBOARD, channels)
        self._turns = Lockstep(self.plant, stop, peer).run()

    def receive(self) -> bytes:
        """The next datagram; empty where the plant has nothing to say yet.

        Raises `LinkError` when the plant has ended, and whatever goes wrong in it.
        """
        outgoing = self._port.outgoing
        if not outgoing:
            if next(self._turns, None) is None:
                raise LinkError("the plant has ended")
            if not outgoing:
                time.sleep(STILL_S)
                return b""
        return outgoing.popleft()

    def send(self, data: bytes) -> None:
        self._port.incoming.append(data)

    def lock(self) -> None:
        """There is one other end."""

    def close(self) -> None:
        """Nothing is held."""

    def finish(self) -> None:
        """Run the plant to its end, after the companion's. Raises `LockstepTimeoutError`."""
        for _ in self._turns:
            pass
