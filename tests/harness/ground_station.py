"""A pilot's ground station on the plant's second port."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from pymavlink import mavutil

from harness.processes import PATIENCE_S


class GroundStation:
    """A pilot's ground station on the plant's second port, with ATTITUDE and CURRENT_MODE at 50 Hz."""

    def __init__(self, port: int) -> None:
        os.environ["MAVLINK20"] = "1"
        self.link = mavutil.mavlink_connection(f"udpout:127.0.0.1:{port}", source_system=255, dialect="development")
        self.link.mav.heartbeat_send(6, 8, 0, 0, 0)
        for message in (mavutil.mavlink.MAVLINK_MSG_ID_ATTITUDE, 436):
            self.command(511, message, 20_000)

    def command(self, number: int, *params: float) -> None:
        self.link.mav.command_long_send(1, 1, number, 0, *params, *[0] * (7 - len(params)))

    def vehicle_s(self) -> float:
        """The vehicle's time now, by the next message that tells it."""
        while self.link.recv_match(blocking=False) is not None:
            pass  # what has queued up is of before
        message = self.link.recv_match(type="ATTITUDE", blocking=True, timeout=PATIENCE_S)
        assert message is not None, "the vehicle has fallen silent"
        return 1e-3 * float(message.time_boot_ms)

    def mode_becomes(self, mode: int, timeout_s: float = PATIENCE_S) -> float:
        """The vehicle's time when CURRENT_MODE shows the mode."""
        until_s, vehicle_s = time.monotonic() + timeout_s, 0.0
        while time.monotonic() < until_s:
            message = self.link.recv_match(type=["CURRENT_MODE", "ATTITUDE"], blocking=True, timeout=0.1)
            if message is None:
                continue
            if message.get_type() == "ATTITUDE":
                vehicle_s = 1e-3 * message.time_boot_ms
            elif message.custom_mode == mode:
                return vehicle_s
        pytest.fail(f"the mode did not become {mode:#x} within {timeout_s:g} s")


def tlog(folder: Path) -> Iterator[mavutil.mavlink.MAVLink_message]:
    os.environ["MAVLINK20"], os.environ["MAVLINK_DIALECT"] = "1", "development"
    mavutil.set_dialect("development")
    log = mavutil.mavlink_connection(str(folder / "traffic.tlog"))
    try:
        while (message := log.recv_match()) is not None:
            yield message
    finally:
        log.close()
