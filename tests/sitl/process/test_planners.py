"""Planners of others' making stream to a flight over sockets: plain pymavlink, and MAVSDK's offboard plugin.

They speak to the vehicle's port for ground stations, and the vehicle passes on what is for the companion.
"""

from __future__ import annotations

import math
import signal
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from harness.ports import free_port
from harness.processes import end_of, eventually, line_with, served
from harness.two_processes import in_control, running
from mavsdk import ComponentType, Configuration, ConnectionResult, Mavsdk, System
from mavsdk.plugins.offboard import AccelerationNed, Offboard, PositionNedYaw, VelocityNedYaw

from companion.record.reader import read_flight

pytestmark = pytest.mark.realtime

STREAMABLE = (
    "mission.waypoints=[]", "controller.anchor=setpoint", "controller.limits.speed_m_s=0.5",
    "guards.fence={enabled: true, radius_m: 4, lower_ned_m: [-4, -4, -4], upper_ned_m: [4, 4, 4]}",
    # of a machine that does other things as well
    "steering={enabled: true, system_ids: [255, 245], stream: {timeout_s: 1, late_s: 1}}",
)  # fmt: skip
WAY_M, WAY_S = 0.3, 2.5
RATE_HZ = 20.0


class Instant(NamedTuple):
    """North: position, velocity and acceleration."""

    x_m: float
    vx_m_s: float
    ax_m_s2: float


def way() -> Iterator[Instant]:
    """From rest to rest, an instant each twentieth of a second, when it is time for it."""
    began_s, rate = time.monotonic(), math.pi / WAY_S
    while (t := min(time.monotonic() - began_s, WAY_S)) < WAY_S:
        phase = rate * t
        half = 0.5 * WAY_M
        yield Instant(half * (1 - math.cos(phase)), half * rate * math.sin(phase), half * rate**2 * math.cos(phase))
        time.sleep(1.0 / RATE_HZ)
    for _ in range(10):
        yield Instant(WAY_M, 0.0, 0.0)
        time.sleep(1.0 / RATE_HZ)


def check(folder: Path) -> None:
    """It was led along the way, and not in steps."""
    record = read_flight(folder)
    ticks = record.ticks[record.ticks["state"] == 3]
    wanted = ticks["target_ned_m"][:, 0] - ticks["target_ned_m"][0, 0]
    assert wanted[-1] == pytest.approx(WAY_M, abs=2e-3)
    moved = np.diff(wanted)[np.diff(wanted) > 1e-4]
    assert len(moved) > 1.5 * RATE_HZ * WAY_S  # between the samples too: 125 ticks a second
    assert moved.max() < 0.02
    assert not [event.detail for event in record.events if event.name == "command_refused"]


def test_a_plain_pymavlink_planner_is_followed(tmp_path: Path) -> None:
    station_port = free_port()
    with (
        served("--gcs-port", station_port) as port,
        in_control(f"udpout://127.0.0.1:{port}", tmp_path, station_port, *STREAMABLE) as flight,
    ):
        station = flight[1].link
        for at in way():
            station.mav.set_position_target_local_ned_send(
                round(1e3 * time.monotonic()) & 0xFFFFFFFF, 1, 191, 1, 0xC00,
                at.x_m, 0, 0, at.vx_m_s, 0, 0, at.ax_m_s2, 0, 0, 0, 0,
            )  # fmt: skip
        run, pilot, folder = flight
        assert "255/" in line_with(run, "^streamed by")
        line_with(run, "^stream ended, braking")
        pilot.command(176, 1, 4, 3)  # DO_SET_MODE: Hold
        assert "released: mode_changed" in end_of(run)[0]
    check(folder)


def system_of(mavsdk: Mavsdk, number: int) -> System:
    found: list[System] = []

    def seen() -> bool:
        found[:] = [system for system in mavsdk.get_systems() if system.get_system_id() == number]
        return bool(found)

    assert eventually(seen, 20.0)
    return found[0]


def test_mavsdk_s_offboard_plugin_is_followed(tmp_path: Path) -> None:
    """It sends to component 1 of the system chosen, so the companion must be one: a system of its own."""
    station_port, own = free_port(), ("link.system_id=42", "link.component_id=1")
    with (
        served("--gcs-port", station_port) as port,
        running(f"udpout://127.0.0.1:{port}", tmp_path, *STREAMABLE, *own) as (run, folder),
    ):
        mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
        try:
            assert mavsdk.add_any_connection(f"udpout://127.0.0.1:{station_port}") is ConnectionResult.SUCCESS
            offboard = Offboard(system_of(mavsdk, 42))
            for n, at in enumerate(way()):
                place, speed = PositionNedYaw(at.x_m, 0.0, 0.0, 0.0), VelocityNedYaw(at.vx_m_s, 0.0, 0.0, 0.0)
                if n < 20:
                    offboard.set_position_velocity_acceleration_ned(place, speed, AccelerationNed(at.ax_m_s2, 0.0, 0.0))
                else:
                    offboard.set_position_velocity_ned(place, speed)
        finally:
            mavsdk.destroy()  # which ends its stream: it would resend its last for ever
        assert "245/" in line_with(run, "^streamed by")
        line_with(run, "^stream ended, braking")
        run.send_signal(signal.SIGINT)
        assert "released: operator" in end_of(run)[0]
    check(folder)
