"""Cut the moments worth testing out of a full PX4 recording, byte for byte.

    python tests/data/cut.py SOURCE.tlog OUTPUT.tlog
    python tests/data/cut.py --replay SOURCE.tlog OUTPUT.tlog

SOURCE is one of the recordings named in `WINDOWS` or `REPLAYS`; OUTPUT is what stands beside this script under the same
name, for a replay with `replay_` before it. A tlog is records of an 8-byte big-endian time in microseconds and one raw
MAVLink frame. A replay holds what the flight process hears of the vehicle, without gaps but every fourth ODOMETRY only.
"""

from __future__ import annotations

import struct
import sys
from collections.abc import Iterator
from pathlib import Path

# Seconds since the first record: everything on the wire within, from both ends.
WINDOWS = {
    "px4_sih_flight.tlog": (
        (0.00, 0.28),  # rates requested, arm, take-off
        (7.35, 7.60),  # OFFBOARD asked for, acknowledged twice, entered
        (25.20, 25.60),  # the companion's stream stops
        (26.40, 27.40),  # failsafe: OFFBOARD ends, Return begins
        (27.70, 28.10),  # the stream resumes, OFFBOARD by itself
        (30.80, 31.15),  # Hold asked for
    ),
    "px4_sih_gps_loss.tlog": (
        (15.00, 15.15),  # before
        (23.50, 24.60),  # GPS is back: the reset counter steps, then position slides without a count
    ),
    "px4_sih_attitude_p3.tlog": ((9.40, 10.50),),  # OFFBOARD entered, heartbeats of both ends
}

REPLAYS = {
    "px4_sih_flight.tlog": (24.0, 32.0),  # the stream stops, failsafe, OFFBOARD by itself, Hold
    "px4_sih_gps_loss.tlog": (10.5, 24.8),  # GPS lost at 13.4; the reset at 23.7 and the slide after it
}
_THINNED = 331  # ODOMETRY
_KEEP_ONE_IN = 4
_HEARD = frozenset({0, 230, 436, _THINNED})  # HEARTBEAT, ESTIMATOR_STATUS, CURRENT_MODE
_AUTOPILOT = b"\x01\x01"

_TIME = struct.Struct(">Q")
_MAGIC_V2 = 0xFD
_HEADER_AND_CRC_BYTES = 12
_SIGNATURE_BYTES = 13


def records(data: bytes) -> Iterator[tuple[int, bytes]]:
    """(time in microseconds, the record as it stands) of every record of a tlog of unbroken MAVLink 2 frames."""
    at = 0
    while at < len(data):
        (time_us,) = _TIME.unpack_from(data, at)
        frame_at = at + _TIME.size
        if data[frame_at] != _MAGIC_V2:
            raise ValueError(f"no MAVLink 2 frame at byte {frame_at}")
        signature = _SIGNATURE_BYTES if data[frame_at + 2] & 1 else 0
        end = frame_at + _HEADER_AND_CRC_BYTES + data[frame_at + 1] + signature
        yield time_us, data[at:end]
        at = end


def cut(data: bytes, windows: tuple[tuple[float, float], ...]) -> bytes:
    """The records whose time since the first lies within one of the windows, in order."""
    first_us = _TIME.unpack_from(data)[0]
    spans = [(first_us + round(start * 1e6), first_us + round(end * 1e6)) for start, end in windows]
    return b"".join(record for time_us, record in records(data) if any(a <= time_us < b for a, b in spans))


def replay(data: bytes, window: tuple[float, float]) -> bytes:
    """What the flight process hears of the vehicle within the window, ODOMETRY thinned."""
    kept, seen = [], 0
    for _, record in records(cut(data, (window,))):
        frame = record[_TIME.size :]
        number = int.from_bytes(frame[7:10], "little")
        if number not in _HEARD or frame[5:7] != _AUTOPILOT:
            continue
        seen += number == _THINNED
        if number != _THINNED or seen % _KEEP_ONE_IN == 1:
            kept.append(record)
    return b"".join(kept)


def main(arguments: list[str]) -> None:
    """Cut SOURCE into OUTPUT."""
    replayed = arguments[:1] == ["--replay"]
    paths = [Path(argument) for argument in arguments[replayed:]]
    names = REPLAYS if replayed else WINDOWS
    if len(paths) != 2 or paths[0].name not in names:
        sys.exit(f"usage: cut.py [--replay] SOURCE OUTPUT, SOURCE being one of {', '.join(names)}")
    data, name = paths[0].read_bytes(), paths[0].name
    paths[1].write_bytes(replay(data, REPLAYS[name]) if replayed else cut(data, WINDOWS[name]))


if __name__ == "__main__":
    main(sys.argv[1:])
