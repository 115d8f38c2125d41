"""A wire on which every frame is signed, as PX4 has all of its once a key is on its card."""

from __future__ import annotations

from companion.mavlink.codec import FrameParser
from companion.mavlink.signing import Signing
from sitl.wire.ports import Port


class SignedPort:
    """Wraps a port: signs what goes out, and lets through only whole frames that are signed by the same key.

    Attribute: `bare`, the port that is wrapped.
    """

    def __init__(self, port: Port, key: bytes) -> None:
        self.bare = port
        self._parser = FrameParser(stream=port.stream)
        self._signing = Signing(key, link_id=1)
        self.stream = False

    @property
    def connected(self) -> bool:
        return self.bare.connected

    @property
    def number(self) -> int:
        return self.bare.number

    def fileno(self) -> int:
        return self.bare.fileno()

    def receive(self) -> bytes:
        while data := self.bare.receive():
            if believed := self._believed(data):
                return believed
        return b""

    def receive_waiting(self) -> bytes:
        return self._believed(self.bare.receive_waiting())

    def send(self, frames: list[bytes]) -> None:
        self.bare.send([self._signing.sign(frame) for frame in frames])

    def close(self) -> None:
        self.bare.close()

    def _believed(self, data: bytes) -> bytes:
        return b"".join(frame.raw for frame in self._parser.feed(data) if self._signing.verify(frame))
