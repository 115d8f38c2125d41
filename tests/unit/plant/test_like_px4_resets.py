"""When EKF2's resets are counted, beside a real PX4 v1.17 whose GPS comes and goes."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import pytest
from harness.plant_client import clients
from pymavlink.dialects.v20 import development as mavlink

from companion.config import load_config
from sitl.messages.streams import Profile
from sitl.scenarios.faults import LoseGps, RegainGps
from sitl.scenarios.run import Happening, ScenarioRun
from sitl.scenarios.settled import settled_world

PX4: Final = Path(__file__).resolve().parents[3] / "config" / "px4_quadrotor.yaml"


def odometry(*happens: tuple[float, Happening]) -> list[Any]:
    """Six seconds of ODOMETRY in the air, in which these happen."""
    world = settled_world(load_config(PX4, ("plant.telemetry=px4",)))
    run = ScenarioRun(
        world, happens, before=(), limit_s=60.0, coast_s=1.0, pilot=False, engage=False, companion_ids=(1, 191)
    )
    (companion,) = clients(run.autopilot, (Profile.ONBOARD, 191))
    companion.heartbeat()
    companion.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, mavlink.MAVLINK_MSG_ID_ODOMETRY, 8_000)
    return [m for m in companion.collect(6.0) if m.get_type() == "ODOMETRY"]


def test_no_count_when_gps_goes_and_four_in_one_sample_when_it_returns() -> None:
    heard = odometry((1.0, LoseGps(for_s=3.0)), (4.0, RegainGps()))
    assert {m.reset_counter for m in heard} == {12, 16}
    ((before, after),) = [(a, b) for a, b in pairwise(heard) if a.reset_counter != b.reset_counter]
    assert after.z - before.z == pytest.approx(1.4, abs=0.1)
    assert before.pose_covariance[0] > 0.2 > after.pose_covariance[0]


def test_gps_switched_off_and_on_counts_once_and_slides_uncounted() -> None:
    heard = odometry((1.0, RegainGps(1, (0.0, 0.0, 0.2), (-5.7, 0.0, 0.0))))
    assert {m.reset_counter for m in heard} == {12, 13}
    first = next(m for m in heard if m.reset_counter == 13)
    slid = [m for m in heard if m.time_usec - first.time_usec <= 910_000 and m.reset_counter == 13]
    assert slid[-1].x - first.x == pytest.approx(-5.7, abs=0.4)
