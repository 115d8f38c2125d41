"""A config that makes no sense beside the vehicle, which only the vehicle can tell: over a socket, `companion run`."""

from __future__ import annotations

from pathlib import Path

import pytest
from harness.command import companion
from harness.processes import RIG, ROOT
from harness.running_plant import RunningPlant, autopilot, quadrotor

pytestmark = pytest.mark.realtime
QUADROTOR = ROOT / "config" / "paper_quadrotor.yaml"
SLOW = ("--set", "tick.rate_hz=100", "--set", "tick.floor_hz=40", "--uncertified")


def test_a_hover_thrust_that_is_none_of_this_vehicle_is_refused(tmp_path: Path) -> None:
    with RunningPlant(autopilot(quadrotor(), MPC_THR_HOVER=0.12)) as plant:
        link = f"udpout://127.0.0.1:{plant.port}"
        ended = companion("run", QUADROTOR, "--link", link, "--engage", "--out", tmp_path, *SLOW)
        assert plant.autopilot.commander.armed is False
    assert ended.returncode == 2, ended
    line = ended.stderr.strip().splitlines()[-1]
    assert "the vehicle's MPC_THR_HOVER 0.12" in line
    assert line.endswith("or insist by --anyway")


def test_a_rigs_config_on_a_vehicle_that_flies_is_refused(tmp_path: Path) -> None:
    pilot = autopilot(quadrotor())
    pilot.start_in_air(2.0)
    with RunningPlant(pilot) as plant:
        link = f"udpout://127.0.0.1:{plant.port}"
        ended = companion("run", RIG, "--link", link, "--out", tmp_path, *SLOW)
    assert ended.returncode == 2, ended
    line = ended.stderr.strip().splitlines()[-1]
    assert "vehicle.kind is rig" in line
    assert "in the air, 2.0 m up" in line
