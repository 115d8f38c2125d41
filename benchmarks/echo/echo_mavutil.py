"""Odometry in, set-point out, by pymavlink's mavutil. Usage: echo_mavutil.py PORT

The thrust repeats the position's x, so that the answer to each sample can be told.
"""

from __future__ import annotations

import os
import sys

os.environ["MAVLINK20"] = "1"

from pymavlink import mavutil

LEVEL = [1.0, 0.0, 0.0, 0.0]


def main(port: int) -> None:
    link = mavutil.mavlink_connection(
        f"udpin:127.0.0.1:{port}", source_system=1, source_component=191, dialect="common"
    )
    print("ready", flush=True)
    while True:
        sample = link.recv_match(type="ODOMETRY", blocking=True)
        link.mav.set_attitude_target_send(sample.time_usec // 1000, 1, 1, 0x07, LEVEL, 0.0, 0.0, 0.0, sample.x)


if __name__ == "__main__":
    main(int(sys.argv[1]))
