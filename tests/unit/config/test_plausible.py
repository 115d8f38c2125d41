"""Values that only a slip of unit explains: one line, and `--anyway` to insist."""

from __future__ import annotations

from pathlib import Path

import pytest
from harness.command import companion
from harness.processes import ROOT

from companion.config import load_config
from companion.config.plausible import slips

PX4 = ROOT / "config" / "px4_quadrotor.yaml"
RIG = ROOT / "config" / "antx_rig.yaml"

# A setting that is a slip, what is told of it, and one near it that is none.
SLIPS = {
    "attitude in deg/s": (
        RIG, "attitude.x={bandwidth_rad_s: 516}", "faster than any attitude loop: degrees/s? That would be 9.01",
        "attitude.x={bandwidth_rad_s: 60}",
    ),
    "an interval in deg/s": (
        PX4, "attitude.y={natural_frequency_rad_s: [9, 516], damping_ratio: 1, delay_s: 0.03}", "attitude.y.natural",
        "attitude.y={natural_frequency_rad_s: [9, 60], damping_ratio: 1, delay_s: 0.03}",
    ),
    "the plant's in deg/s": (
        PX4, "plant.quadrotor.yaw={natural_frequency_rad_s: 230, damping_ratio: 1}", "plant.quadrotor.yaw.natural_freq",
        "plant.quadrotor.yaw={natural_frequency_rad_s: 23, damping_ratio: 1}",
    ),
    "guard in ms": (
        PX4, "guards.pose_age_s.limit=250", "guards.pose_age_s.limit is 250 s, by when there is nothing left to guard: "
        "milliseconds? That would be 0.25", "guards.pose_age_s.limit=2.5",
    ),
    "timeout in ms": (
        PX4, "guards.tilt_deg.timeout_s=200", "guards.tilt_deg.timeout_s is 200 s", "guards.tilt_deg.timeout_s=20",
    ),
    "tilt in rad": (
        PX4, "controller.limits.tilt_deg=0.52", "limits.tilt_deg is 0.52 degrees: radians? That would be 29.8",
        "controller.limits.tilt_deg=5.2",
    ),
    "yaw rate in rad/s": (
        PX4, "controller.limits.yaw_rate_deg_s=0.785", "degrees/s: radians/s? That would be 45",
        "controller.limits.yaw_rate_deg_s=7.85",
    ),
    "down for up": (
        PX4, "mission.waypoints=[{at_s: 2, offset_ned_m: [0, 0, 5]}]",
        "the waypoint at 2 s is 5 m down, and a take-off goes 2.5 m up: z points down; is -5 meant?",
        "mission.waypoints=[{at_s: 2, offset_ned_m: [0, 0, 1]}]",
    ),
    "hover thrust": (
        PX4, "vehicle.parameters={MPC_THR_HOVER: 0.12}", "hover_thrust is 0.49 and the vehicle's MPC_THR_HOVER 0.12",
        "vehicle.parameters={MPC_THR_HOVER: 0.4}",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", SLIPS)
def test_a_slip_is_told_in_one_line_and_what_is_near_it_is_none(name: str) -> None:
    path, slip, told, near = SLIPS[name]
    (line,) = slips(load_config(path, (slip,)))
    assert told in line
    assert list(slips(load_config(path, (near,)))) == []


def test_a_guard_that_is_off_guards_nothing_and_a_flight_may_take_its_time() -> None:
    off = "guards={pose_age_s: {enabled: false, limit: 250}, flight_time_s: {enabled: true, limit: 1200}}"
    assert list(slips(load_config(PX4, (off,)))) == []


@pytest.mark.parametrize("path", sorted((ROOT / "config").glob("*.yaml")), ids=lambda path: path.name)
def test_the_shipped_files_are_plausible(path: Path) -> None:
    assert list(slips(load_config(path))) == []


@pytest.mark.parametrize("command", ["check", "sitl", "run", "design"])
def test_commands_that_act_on_the_numbers_refuse_until_somebody_insists(command: str, tmp_path: Path) -> None:
    path = tmp_path / "deg.yaml"
    path.write_text(RIG.read_text().replace("{bandwidth_rad_s: 3.0}", "{bandwidth_rad_s: 516}", 1))
    arguments: tuple[object, ...] = (path,)
    if command == "design":
        arguments = (tmp_path / "none.ulg", "--template", path, "--out", tmp_path / "new.yaml")
    ended = companion(command, *arguments)
    assert ended.returncode == 2
    (line,) = ended.stderr.splitlines()
    assert line.startswith(f"companion: {path}: attitude.x.bandwidth_rad_s is 516 rad/s")
    assert line.endswith("--anyway if it is meant so")
    if command == "check":
        meant = companion(command, *arguments, "--anyway", "--quick")
        assert (meant.returncode, meant.stderr) == (0, "")


def test_whom_the_numbers_do_not_concern_does_not_ask(tmp_path: Path) -> None:
    ended = companion(
        "vehicle", PX4, "--set", "guards.pose_age_s.limit=250", "--set", "link.connect_timeout_s=0.1",
        "--link", f"serial://{tmp_path / 'none'}:57600",
    )  # fmt: skip
    assert "cannot open" in ended.stderr
    assert "milliseconds" not in ended.stderr
