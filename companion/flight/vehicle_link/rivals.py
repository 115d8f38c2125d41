"""Who else flies the vehicle, or goes by our name: another companion, or our own frames that a router sends back."""

from __future__ import annotations

from typing import Final

from companion.flight.vehicle_link.requests import HEARTBEAT
from companion.mavlink.codec import Frame, Layout

SET_ATTITUDE_TARGET: Final = Layout("SET_ATTITUDE_TARGET")

_TARGET_SYSTEM: Final = SET_ATTITUDE_TARGET.index("target_system")
_TARGET_COMPONENT: Final = SET_ATTITUDE_TARGET.index("target_component")
KEPT: Final = 4096  # of our own frames: some ten seconds of them
_SEQUENCES: Final = 256  # of MAVLink

Ids = tuple[int, int]


def is_echo(frame: Frame, sent: list[bytes]) -> bool:
    """Whether a frame is one that we sent, to the last byte: time stamp, and signature where there is one.

    `sent` are `KEPT` frames, each where its count, of which the sequence is the rest by 256, puts it.
    """
    return frame.raw in sent[frame.sequence :: _SEQUENCES]


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
