"""Cut the moments worth testing out of a full PX4 recording, byte for byte.

    python tests/data/cut.py SOURCE.tlog OUTPUT.tlog

SOURCE is one of the recordings named in `WINDOWS`; OUTPUT is what stands beside this script under the same name. A tlog
is records of an 8-byte big-endian time in microseconds and one raw MAVLink frame.
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


def main(arguments: list[str]) -> None:
    """Cut SOURCE into OUTPUT."""
    if len(arguments) != 2 or Path(arguments[0]).name not in WINDOWS:
        sys.exit(f"usage: cut.py SOURCE OUTPUT, SOURCE being one of {', '.join(WINDOWS)}")
    source, output = (Path(argument) for argument in arguments)
    output.write_bytes(cut(source.read_bytes(), WINDOWS[source.name]))


if __name__ == "__main__":
    main(sys.argv[1:])
