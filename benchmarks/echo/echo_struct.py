"""Odometry in, set-point out, by `struct` and a compiled CRC alone: what Python costs. Usage: echo_struct.py PORT

No controller, no check, no record. The thrust repeats the position's x, so that the answer to each sample can be told.
"""

from __future__ import annotations

import gc
import socket
import struct
import sys

from fastcrc.crc16 import mcrf4xx
from pymavlink.dialects.v20 import development as mavlink

SAMPLE, ANSWER = mavlink.MAVLink_odometry_message, mavlink.MAVLink_set_attitude_target_message


def main(port: int) -> None:
    extra = bytes([SAMPLE.crc_extra])
    link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    link.bind(("127.0.0.1", port))
    answer = ANSWER(0, 1, 1, 0x07, [1.0, 0.0, 0.0, 0.0], 0.0, 0.0, 0.0, 0.5)
    template = answer.pack(mavlink.MAVLink(None, srcSystem=1, srcComponent=191))
    frame = bytearray(template[:10] + template[10:-2].ljust(ANSWER.unpacker.size, b"\0") + b"\0\0")
    frame[1] = ANSWER.unpacker.size
    stamp, thrust = struct.Struct("<I"), struct.Struct("<f")
    at_thrust = 10 + template[10:].index(thrust.pack(0.5))
    unpack = struct.Struct("<Q3f").unpack_from
    crc = struct.Struct("<H")
    print("ready", flush=True)
    gc.disable()
    while True:
        data, peer = link.recvfrom(2048)
        if data[0] != 0xFD or data[7] | data[8] << 8 != SAMPLE.id:
            continue
        if mcrf4xx(data[1:-2] + extra) != data[-2] | data[-1] << 8:
            continue
        time_us, x, _, _ = unpack(data[10:-2].ljust(SAMPLE.unpacker.size, b"\0"))
        frame[4] = (frame[4] + 1) & 0xFF
        stamp.pack_into(frame, 10, time_us // 1000 & 0xFFFFFFFF)
        thrust.pack_into(frame, at_thrust, x)
        crc.pack_into(frame, len(frame) - 2, mcrf4xx(bytes(frame[1:-2]) + bytes([ANSWER.crc_extra])))
        link.sendto(frame, peer)


if __name__ == "__main__":
    main(int(sys.argv[1]))
