"""What one tick leaves in `flight.mcap`: one table of fields, from which packing, reading and the schema text follow.

Encoding: ROS 2 CDR with a `ros2msg` schema, a fixed layout that `struct` packs in a microsecond and that Foxglove,
PlotJuggler and the mcap tools read. Floats come first, so that the layout has no padding.

Source: https://mcap.dev/spec/registry (profiles ros2msg and cdr).
"""

from __future__ import annotations

import struct
from typing import Final, NamedTuple

CDR_HEADER: Final = b"\x00\x01\x00\x00"  # little endian, plain CDR
TICK_TOPIC: Final = "/tick"
TICK_SCHEMA_NAME: Final = "companion/msg/Tick"
EVENT_TOPIC: Final = "/event"
EVENT_SCHEMA_NAME: Final = "companion/msg/Event"


class Field(NamedTuple):
    """A field of the tick record: how many values, and what they are."""

    name: str
    size: int
    meaning: str


# Per-axis fields are [x, y] of the control frame: NED at the anchor, turned by the yaw set-point. Where the anchor
# goes along with the set-point, positions are distances from it and command_m is zero. NaN: not in control.
FLOATS: Final = (
    Field("time_s", 1, "time of the odometry sample, autopilot's clock"),
    Field("dt_s", 1, "since the sample before"),
    Field("position_ned_m", 3, "measured position, local NED"),
    Field("velocity_ned_m_s", 3, "measured velocity, local NED"),
    Field("attitude_q_wxyz", 4, "measured attitude, body to NED"),
    Field("target_ned_m", 3, "where the mission or a live command wants the vehicle, local NED"),
    Field("target_yaw_rad", 1, "and its heading"),
    Field("command_ned_m", 3, "flown set-point, local NED: on its way to the target at limits.speed_m_s"),
    Field("command_yaw_rad", 1, "flown heading set-point, that of the control frame: limits.yaw_rate_deg_s"),
    Field("anchor_ned_m", 2, "origin of the control frame, local NED (north, east)"),
    Field("position_m", 2, "measured position, control frame"),
    Field("velocity_m_s", 2, "measured velocity, control frame"),
    Field("command_m", 2, "c, commanded position, control frame"),
    Field("ideal_position_m", 2, "x_i of (19)"),
    Field("ideal_velocity_m_s", 2, "x_i of (19)"),
    Field("reference_position_m", 2, "x_r of (20)"),
    Field("reference_velocity_m_s", 2, "x_r of (20)"),
    Field("position_weight", 2, "first element of W of (22), 1/m"),
    Field("velocity_weight", 2, "second element of W of (22), s/m"),
    Field("bias_weight", 2, "third element of W, of the regressor 1: specific force over g"),
    Field("control", 2, "u of (21), specific force over g, before limits"),
    Field("actuator", 2, "w of (16), specific force over g: measured attitude, commanded thrust"),
    Field("hedge_deficit", 2, "w - u over the last tick, as the hedge took it"),
    Field("reference_z_m", 1, "down, local NED: (4) on a vehicle that nothing disturbs"),
    Field("hover_thrust", 1, "normalised thrust taken for the one that carries the weight"),
    Field("setpoint_q_wxyz", 4, "attitude set-point sent"),
    Field("setpoint_thrust", 1, "thrust set-point sent, normalised"),
    Field("latency_s", 1, "odometry received to set-point sent, our clock; zero in lockstep, where time stands still"),
)
_NAMES = [field.name for field in FLOATS]
CONTROL_FLOATS: Final = FLOATS[_NAMES.index("target_ned_m") : _NAMES.index("setpoint_q_wxyz")]  # known only in control
FLAGS: Final = (
    Field("state", 1, "authority: see companion.flight.authority.states.State"),
    Field("limited", 1, "1 when tilt, thrust or acceleration limits cut the force"),
    Field("thrust_limited", 1, "1 when the thrust limit cut its vertical part"),
)

PACKER: Final = struct.Struct(f"<4s{sum(field.size for field in FLOATS)}d{len(FLAGS)}B")
pack_tick = PACKER.pack  # CDR_HEADER, the floats in order, the flags in order


def tick_schema() -> str:
    """The tick record as a ROS 2 message definition, one comment a field."""
    lines = [f"float64{f'[{f.size}]' if f.size > 1 else ''} {f.name}  # {f.meaning}" for f in FLOATS]
    lines += [f"uint8 {f.name}  # {f.meaning}" for f in FLAGS]
    return "\n".join(lines) + "\n"


def event_schema() -> str:
    """A named event: a change of authority, a release and its reason, a refused command."""
    return "string name  # an enum value\nstring detail  # one line for a person\n"


def pack_event(name: str, detail: str) -> bytes:
    """An event as CDR: two strings, each aligned to four bytes after the header."""
    body = b""
    for text in (name, detail):
        data = text.encode() + b"\0"
        body += b"\0" * (-len(body) % 4) + struct.pack("<I", len(data)) + data
    return CDR_HEADER + body


def unpack_event(data: bytes) -> tuple[str, str]:
    """(name, detail) of an event."""
    texts, at = [], len(CDR_HEADER)
    for _ in range(2):
        at += -(at - len(CDR_HEADER)) % 4
        (length,) = struct.unpack_from("<I", data, at)
        texts.append(data[at + 4 : at + 3 + length].decode())
        at += 4 + length
    return texts[0], texts[1]
