"""Missions: headings, mission files, and what of them is refused for the envelope."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from companion.config import Config, ConfigError, load_config
from companion.config.mission import MissionSection, Waypoint
from companion.control.types import PositionSetpoint
from companion.flight.pilot.mission import Mission

SHIPPED = Path(__file__).resolve().parents[3] / "config"
PX4 = SHIPPED / "px4_quadrotor.yaml"
RIG = SHIPPED / "antx_rig.yaml"


def test_heading_counts_from_engagement_and_stays_until_told_otherwise() -> None:
    section = MissionSection(
        waypoints=(
            Waypoint(at_s=1, offset_ned_m=(1, 0, 0)),
            Waypoint(at_s=2, offset_ned_m=(1, 2, 0), yaw_deg=90),
            Waypoint(at_s=3, offset_ned_m=(1, 2, -3)),
            Waypoint(at_s=4, offset_ned_m=(0, 0, 0), yaw_deg=0),
        )
    )
    mission, origin = Mission(section), PositionSetpoint(10.0, 20.0, -5.0, 0.5)
    assert mission.command(0.0, origin) == origin
    assert mission.command(1.0, origin) == (11.0, 20.0, -5.0, 0.5)
    assert mission.command(2.5, origin) == (11.0, 22.0, -5.0, pytest.approx(0.5 + math.pi / 2))
    assert mission.command(3.0, origin) == (11.0, 22.0, -8.0, pytest.approx(0.5 + math.pi / 2))
    assert mission.command(9.0, origin) == origin


# --- mission files --------------------------------------------------------------------------------------------------


def write(folder: Path, mission: str, stairs: str | None = None) -> Path:
    """The shipped quadrotor's config with another mission section, and a mission file beside it."""
    text = PX4.read_text()
    start, end = text.index("\nmission:"), text.index("\nguards:")
    path = folder / "mine.yaml"
    path.write_text(f"{text[:start]}\nmission: {mission}\n{text[end:]}")
    if stairs is not None:
        (folder / "missions").mkdir()
        (folder / "missions" / "stairs.yaml").write_text(stairs)
    return path


STAIRS = """
duration_s: 12
waypoints:
  - {at_s: 2, offset_ned_m: [1, 0, 0]}
  - {at_s: 6, offset_ned_m: [1, 1, 0], yaw_deg: 45}
"""


def test_a_mission_file_is_found_from_the_config_and_what_stands_beside_it_counts_more(tmp_path: Path) -> None:
    path = write(tmp_path, "{file: missions/stairs.yaml}", STAIRS)
    config = load_config(path)
    assert config.mission.duration_s == 12
    assert [w.yaw_deg for w in config.mission.waypoints] == [None, 45]
    assert load_config(path, ("mission.duration_s=9",)).mission.duration_s == 9
    assert load_config(path, ("mission.waypoints=[]",)).mission.waypoints == ()
    assert Config.model_validate(config.model_dump()) == config  # what a flight folder keeps needs no other file


@pytest.mark.parametrize(
    ("mission", "stairs", "complaint"),
    [
        ("{file: missions/none.yaml}", STAIRS, "missions/none.yaml: no such file"),
        ("{file: 3}", STAIRS, "mission.file: a path is wanted"),
        ("{file: missions/stairs.yaml}", "duration_s: [", "missions/stairs.yaml line 1"),
        ("{file: missions/stairs.yaml}", "- 1", "missions/stairs.yaml: not a mission"),
        ("{file: missions/stairs.yaml}", "duration_s: -1", "missions/stairs.yaml: duration_s: "),
        ("{file: missions/stairs.yaml}", "file: more.yaml", "missions/stairs.yaml: file: unknown key"),
        ("{file: missions/stairs.yaml}", "waypoints: [{at_s: 1, offset_ned_m: [0, 0, 0], yaw_deg: .nan}]", "yaw_deg"),
    ],
)
def test_a_bad_mission_file_is_one_line(tmp_path: Path, mission: str, stairs: str, complaint: str) -> None:
    path = write(tmp_path, mission, stairs)
    with pytest.raises(ConfigError) as caught:
        load_config(path)
    assert complaint in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


# --- reach ----------------------------------------------------------------------------------------------------------

FAR = "mission.waypoints=[{at_s: 2, offset_ned_m: [20, 0, 0]}]"
STEPS = "mission.waypoints=[{at_s: 2, offset_ned_m: [1, 1, 0]}, {at_s: 3, offset_ned_m: [2, 2, 0]}]"


def refused(*overrides: str, path: Path = PX4) -> str:
    with pytest.raises(ConfigError) as caught:
        load_config(path, overrides)
    assert len(str(caught.value).splitlines()) == 1
    return str(caught.value)


def test_anchored_at_the_setpoint_the_largest_jump_counts_and_a_speed_leaves_none() -> None:
    assert load_config(PX4, (FAR,)).mission.waypoints[0].offset_ned_m == (20, 0, 0)  # travelling, not jumping
    jumps = "controller.limits.speed_m_s=null"
    assert "20 m from the one before" in refused(FAR, jumps)
    assert load_config(PX4, (STEPS, jumps)).controller.limits.speed_m_s is None  # 1.41 m at a time, envelope 1.5 m


def test_anchored_at_engagement_the_farthest_waypoint_counts_whatever_the_speed() -> None:
    assert "2.82843 m from where control begins" in refused(STEPS, "controller.anchor=engage")
    assert "0.6 m from where" in refused("mission.waypoints=[{at_s: 1, offset_ned_m: [0.6, 0, 0]}]", path=RIG)


def test_a_speed_must_leave_the_vehicle_within_the_envelope() -> None:
    assert "is beyond controller.envelope.velocity_m_s" in refused("controller.limits.speed_m_s=2.6")
    lagging = refused("controller.limits.speed_m_s=2", "controller.envelope.position_m=1.2")
    assert "the vehicle lags 1.2 m behind its set-point" in lagging  # 2 zeta / wn times 2 m/s is 1.217 m


@pytest.mark.parametrize(
    "override",
    ["vehicle.hover_thrust_source=estimated", "mission.waypoints=[{at_s: 1, offset_ned_m: [0, 0, 0], yaw_deg: 9}]"],
)
def test_a_rig_has_one_heading_and_one_thrust(override: str) -> None:
    assert "a rig keeps its thrust and its heading" in refused(override, path=RIG)


@pytest.mark.parametrize(
    ("override", "key"),
    [
        ("controller.anchor=home", "controller.anchor"),
        ("controller.bias={bound: 0.2}", "controller.bias.adaptation_rate"),
        ("controller.bias.adaptation_rate=1", "controller.bias.adaptation_rate"),
        ("controller.bias.bound=0", "controller.bias.bound"),
        ("controller.limits.acceleration_m_s2=0", "controller.limits.acceleration_m_s2"),
        ("controller.limits.yaw_rate_deg_s=-1", "controller.limits.yaw_rate_deg_s"),
        ("controller.limits.speed_m_s=.inf", "controller.limits.speed_m_s"),
        ("vehicle.hover_thrust_source=guess", "vehicle.hover_thrust_source"),
    ],
)
def test_an_impossible_value_names_its_key(override: str, key: str) -> None:
    assert f"{key}: " in refused(override)
