"""`companion run` and the plant, each in a process of its own: over UDP, or over a cable that may be unplugged."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from companion.record.reader import read_flight
from harness.cable import Cable
from harness.fake_autopilot import OFFBOARD
from harness.ground_station import GroundStation
from harness.ports import free_port
from harness.processes import PATIENT, RIG, Process, folder_of, line_with, plant, served, start, stop

SHORT = [
    "--uncertified",  # the certificate of the shipped config is for its own tick rate
    "--set", "tick.rate_hz=125", "--set", "tick.floor_hz=100", "--set", "mission.duration_s=4",
    "--set", "mission.waypoints=[{at_s: 1, offset_ned_m: [0.2, 0, 0]}]",
    *PATIENT,
]  # fmt: skip
ENDLESS = ["--set", "mission.duration_s=600"]
Flown = tuple[Process, GroundStation, Path]


def check_flight(folder: Path, reason: str) -> None:
    """It ended so, and where the mission of `SHORT` goes."""
    flight = read_flight(folder)
    assert flight.events[-1].name == f"released_{reason}"
    engaged = flight.ticks[flight.ticks["state"] == 3]
    assert abs(engaged["position_m"][-1, 0] - 0.2) < 0.12
    assert 0.0 < np.median(engaged["latency_s"]) < 0.02


@contextmanager
def running(link: str, out: Path, *settings: str) -> Iterator[tuple[Process, Path]]:
    """A flight in control that does not end by itself, and its folder."""
    given = [part for setting in settings for part in ("--set", setting)]
    run = start("run", RIG, "--link", link, "--engage", "--out", out, *SHORT, *ENDLESS, *given)
    try:
        folder = folder_of(line_with(run, "log "))
        line_with(run, "^engaged")
        yield run, folder
    finally:
        stop(run)


@contextmanager
def in_control(link: str, out: Path, station_port: int, *settings: str) -> Iterator[Flown]:
    """The same, and a ground station beside it."""
    with running(link, out, *settings) as (run, folder):
        station = GroundStation(station_port)
        try:
            yield run, station, folder
        finally:
            station.link.close()


@contextmanager
def engaged(tmp_path: Path, *settings: str) -> Iterator[Flown]:
    """A flight in control over UDP."""
    station_port = free_port()
    with (
        served("--gcs-port", station_port) as port,
        in_control(f"udpout://127.0.0.1:{port}", tmp_path, station_port, *settings) as flight,
    ):
        flight[1].mode_becomes(OFFBOARD)
        yield flight


@contextmanager
def flying_over(cable: Cable, out: Path) -> Iterator[Flown]:
    """A flight in control over a cable."""
    station_port = free_port()
    with plant("--link", cable.plant, "--gcs-port", station_port) as process:
        line_with(process, "plant ready")
        with in_control(cable.link, out, station_port) as flight:
            yield flight
