"""Logs damaged at random, kind by kind: what happens to files and clocks, firmware and tuning."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from random import Random
from typing import Final

from harness.log_edits import Records, UlogEdit, first_version, packed, records, stepped

TOPICS: Final = ("vehicle_attitude", "vehicle_attitude_setpoint", "vehicle_status", "vehicle_control_mode")
FIELDS: Final = {
    "vehicle_attitude": ("q", "timestamp", "quat_reset_counter", "delta_q_reset"),
    "vehicle_attitude_setpoint": ("q_d", "timestamp"),
    "vehicle_status": ("nav_state", "arming_state", "vehicle_type", "is_vtol", "in_transition_mode", "system_id"),
    "vehicle_control_mode": ("flag_control_attitude_enabled", "flag_control_position_enabled"),
    "offboard_control_mode": ("attitude", "position", "velocity"),
    "control_allocator_status": ("torque_setpoint_achieved",),
    "actuator_motors": ("control",),
}
BEHIND_THE_HEADER: Final = 20_000  # bytes: what is damaged before may be a gain, and nothing tells


def cut(data: bytes, chance: Random) -> bytes:
    """It ends anywhere."""
    return data[: chance.randint(1, len(data))]


def zero_tail(data: bytes, chance: Random) -> bytes:
    """It ends anywhere, and zeros follow."""
    return data[: chance.randint(len(data) // 2, len(data))] + bytes(chance.randint(1, 20_000))


def hole(data: bytes, chance: Random) -> bytes:
    """A stretch of it is zeros or rubbish, or is missing."""
    size = round(10.0 ** chance.uniform(0.0, 4.5))
    at = chance.randrange(BEHIND_THE_HEADER, max(len(data) - size, BEHIND_THE_HEADER + 1))
    return data[:at] + chance.choice([bytes(size), chance.randbytes(size), b""]) + data[at + size :]


def flips(data: bytes, chance: Random) -> bytes:
    """Some bytes of it are others."""
    damaged = bytearray(data)
    for _ in range(round(10.0 ** chance.uniform(0.0, 2.0))):
        damaged[chance.randrange(BEHIND_THE_HEADER, len(data))] = chance.randrange(256)
    return bytes(damaged)


def swaps(data: bytes, chance: Random) -> bytes:
    """Samples stand in another order."""
    log = UlogEdit(data)
    topic = chance.choice(TOPICS)
    count = len(log.at(topic))
    for _ in range(round(10.0 ** chance.uniform(0.0, 1.7))):
        first = chance.randrange(count)
        log.swap(topic, first, min(max(first + chance.randint(-4, 4), 0), count - 1))
    return log.pack()


def stamps(data: bytes, chance: Random) -> bytes:
    """Some samples have a wrong time."""
    log = UlogEdit(data)
    topic = chance.choice(TOPICS)
    for _ in range(round(10.0 ** chance.uniform(0.0, 1.3))):
        i = chance.randrange(len(log.at(topic)))
        wrong = chance.choice([0, 1, 1_700_000_000_000_000, (1 << 64) - 1, chance.randrange(80_000_000)])
        log.set(topic, "timestamp", "Q", wrong, which=slice(i, i + 1))
    return log.pack()


def not_numbers(data: bytes, chance: Random) -> bytes:
    """Some samples are no numbers, or no rotation."""
    log = UlogEdit(data)
    topic, field = chance.choice([("vehicle_attitude", "q"), ("vehicle_attitude_setpoint", "q_d")])
    wrong = chance.choice([math.nan, math.inf, 0.0, 1e30])
    for _ in range(round(10.0 ** chance.uniform(0.0, 1.7))):
        i = chance.randrange(len(log.at(topic)))
        log.set(topic, field, "4f", *[wrong] * 4, which=slice(i, i + 1))
    return log.pack()


def missing_field(data: bytes, chance: Random) -> bytes:
    """A field or a whole topic is not there."""
    topic = chance.choice(list(FIELDS))
    if chance.random() < 0.2:
        return UlogEdit(data).without(topic).pack()
    return UlogEdit(data).rename(topic, {chance.choice(FIELDS[topic]): "of_other_firmware"}).pack()


def tuned(data: bytes, chance: Random) -> bytes:
    """A gain is set somewhere."""
    name = chance.choice(["MC_ROLL_P", "MC_PITCH_P", "MC_ROLLRATE_K", "MC_YAW_P"])
    return UlogEdit(data).parameter(name, round(chance.uniform(2.0, 8.0), 2), chance.random()).pack()


def twice(data: bytes, chance: Random) -> bytes:
    """Some messages are in it twice."""
    log = UlogEdit(data)
    some = chance.choice([0.01, 0.5, 1.0])
    log.messages = [m for m in log.messages for _ in range(1 + (m[0] == ord("D") and chance.random() < some))]
    return log.pack()


def appended(data: bytes, chance: Random) -> bytes:
    """Its last part was appended after a power cut."""
    return UlogEdit(data).appended(chance.uniform(0.3, 0.95))


def clock_of_ulog(data: bytes, chance: Random) -> bytes:
    """Time goes on elsewhere after some sample."""
    log = UlogEdit(data)
    step_us = round(chance.choice([-1, 1]) * 10.0 ** chance.uniform(3.0, 13.5))
    middle = chance.randrange(len(log.messages))
    for kind, body in log.messages[middle:]:
        if kind == ord("D"):
            stamp = struct.unpack_from("<Q", body, 2)[0] + step_us
            struct.pack_into("<Q", body, 2, stamp % (1 << 64))
    return log.pack()


def clock_of_tlog(data: bytes, chance: Random) -> bytes:
    """Our clock is set, once or a few times."""
    flown = records(data)
    for _ in range(chance.choice([1, 1, 1, 2, 4])):
        flown = stepped(flown, chance.random(), chance.choice([-1, 1]) * 10.0 ** chance.uniform(-2.0, 7.5))
    return packed([(max(t, 0), frame) for t, frame in flown])


def records_lost(data: bytes, chance: Random) -> bytes:
    """Single records are missing, twice in it, late, or have a time of their own."""
    flown: Records = []
    share = 10.0 ** chance.uniform(-3.5, -1.5)
    for t, frame in records(data):
        luck = chance.random() / share
        if luck < 0.25:
            continue
        if luck < 0.5:
            flown.append((t + chance.randint(0, 2000), frame))
        elif luck < 0.75:
            flown.append((chance.choice([0, t + 10**12, t - 10**7, t + 10**7]), frame))
            continue
        flown.append((t, frame))
    return packed(flown)


def old_link(data: bytes, chance: Random) -> bytes:
    """The first version of the protocol, and a cut."""
    old = packed(first_version(records(data)))
    return old[: chance.randint(len(old) * 3 // 4, len(old))]


Damage = Callable[[bytes, Random], bytes]
OF_ULOG: Final[tuple[Damage, ...]] = (
    cut, zero_tail, hole, flips, swaps, stamps, not_numbers, missing_field, tuned, twice, appended, clock_of_ulog,
)  # fmt: skip
OF_TLOG: Final[tuple[Damage, ...]] = (cut, zero_tail, hole, flips, clock_of_tlog, records_lost, old_link)
