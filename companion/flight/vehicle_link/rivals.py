"""Who else flies the vehicle, or goes by our name: another companion, or our own frames that a router sends back."""

from __future__ import annotations

from typing import Final

from companion.flight.vehicle_link.requests import HEARTBEAT
from companion.mavlink.codec import Frame, Layout

SET_ATTITUDE_TARGET: Final = Layout("SET_ATTITUDE_TARGET")

_TARGET_SYSTEM: Final = SET_ATTITUDE_TARGET.index("target_system")
_TARGET_COMPONENT: Final = SET_ATTITUDE_TARGET.index("target_component")
_KEPT: Final = 4096  # of our own frames: some ten seconds of them
_SEQUENCES: Final = 256  # of MAVLink

Ids = tuple[int, int]


class Sent:
    """Our own frames, in the order of their sequence, to be known when they come back. Attribute: `count`."""

    def __init__(self) -> None:
        self.count = 0
        self._frames = [b""] * _KEPT

    def add(self, frame: bytes) -> None:
        """A frame that goes out; its sequence is `count`."""
        count = self.count
        self._frames[count % _KEPT] = frame
        self.count = count + 1

    def is_echo(self, frame: Frame) -> bool:
        """Whether a frame is one of ours to the last byte: time stamp, and signature where there is one."""
        return frame.raw in self._frames[frame.sequence :: _SEQUENCES]


def recognise(frame: Frame, own: Ids, vehicle: Ids) -> str | None:
    """Who it is that flies the vehicle beside us, or goes by our name; None for everybody else."""
    who = (frame.system_id, frame.component_id)
    if frame.message_id == SET_ATTITUDE_TARGET.message_id:
        values = SET_ATTITUDE_TARGET.unpack(frame.payload)
        system, component = values[_TARGET_SYSTEM], values[_TARGET_COMPONENT]
        if who == own or (system == vehicle[0] and component in (0, vehicle[1])):
            return "{}/{} streams to the vehicle".format(*who)
    elif frame.message_id == HEARTBEAT.message_id and who == own:
        return "another companion is {}/{} too".format(*who)
    return None
