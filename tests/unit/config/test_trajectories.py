"""`mission.trajectories`: what asks for too much is refused, and says where and by how much; and what slows it."""

import math
from pathlib import Path

import pytest
from harness.processes import ROOT

from companion.config import ConfigError, load_config
from companion.config.mission.flown import legs_of, limits_of
from companion.control.types import PositionSetpoint
from companion.flight.pilot.mission import TrajectoryMission
from companion.trajectory.feasibility import excess

QUADROTOR = ROOT / "config" / "px4_quadrotor.yaml"


def mission(*trajectories: str, more: str = "") -> str:
    return f"mission={{trajectories: [{', '.join(trajectories)}]{more}}}"


EIGHT = "{lemniscate: {speed_m_s: %g}}"


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        ((mission(EIGHT % 3),), "acceleration of 4.78 m/s2, 20 % above the 4 there are, at"),
        ((mission(EIGHT % 3),), "--stretch makes it 1.09 times as long"),
        ((mission("{circle: {radius_m: 10, speed_m_s: 6}}"),), "speed of 6 m/s, 20 % above the 5"),
        ((mission("{circle: {radius_m: 0.5, speed_m_s: 1, heading: path}}"),), "yaw rate of 115 deg/s"),
        (
            (mission(EIGHT % 1), "guards.fence={enabled: true, radius_m: 1.5}"),
            "mission.trajectories.0.lemniscate leaves guards.fence",
        ),
        ((mission("{hold_s: 5, circle: {radius_m: 1, speed_m_s: 1}}"),), "give exactly one of"),
        ((mission("{}"),), "give exactly one of"),
        ((mission(EIGHT % 1, more=", duration_s: 5"),), "trajectories end by themselves"),
        (
            (mission(EIGHT % 1), "controller.anchor=engage", "controller.envelope.position_m=9"),
            "need controller.anchor",
        ),
        ((mission("{samples: {file: none.csv}}"),), "none.csv: no such file"),
        ((mission("{plan: {file: none.plan}}"),), "none.plan: no such file"),
        ((mission("{through: {places: [{offset_ned_m: [0,0,0]}, {offset_ned_m: [0,0,0]}]}}"),), "place 2 is where"),
    ],
)
def test_what_cannot_be_flown_is_one_line(overrides: tuple[str, ...], words: str) -> None:
    with pytest.raises(ConfigError) as caught:
        load_config(QUADROTOR, overrides)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_rig_flies_no_trajectories() -> None:
    with pytest.raises(ConfigError, match="flies along one axis"):
        load_config(ROOT / "config" / "antx_rig.yaml", (mission(EIGHT % 1), "paper=null"))


def test_stretch_slows_it_by_as_much_as_the_refusal_said() -> None:
    config = load_config(QUADROTOR, (mission(EIGHT % 3, more=", stretch: true"),))
    limits = limits_of(config.mission, config.controller, config.attitude, config.vehicle.hover_thrust)
    (leg,) = legs_of(config.mission, limits)
    assert excess(leg.trajectory, limits) is None
    asked = load_config(QUADROTOR, (mission(EIGHT % 2),))
    (as_asked,) = legs_of(asked.mission, limits)
    assert leg.trajectory.duration_s == pytest.approx(
        1.093 * (2.0 / 3.0 * (as_asked.trajectory.duration_s - 3.0) + 3.0), rel=0.01
    )


def test_the_envelope_bounds_the_jerk() -> None:
    small = load_config(QUADROTOR, ("controller.envelope.velocity_m_s=1.5", mission(EIGHT % 1)))
    limits = limits_of(small.mission, small.controller, small.attitude, 0.49)
    assert limits.jerk_m_s3 == 20.0
    tiny = small.controller.model_copy(
        update={"envelope": small.controller.envelope.model_copy(update={"position_m": 0.05})}
    )
    spread = 2.0 / 9.0 + 0.045 - 0.2303
    assert limits_of(small.mission, tiny, small.attitude, 0.49).jerk_m_s3 == pytest.approx(
        0.05 * 2.3**2 / spread, rel=0.03
    )


def test_a_mission_goes_along_with_an_estimate_that_jumps() -> None:
    flown = TrajectoryMission(load_config(QUADROTOR, (mission("{hold_s: 1}", EIGHT % 1),)))
    origin = PositionSetpoint(1.0, 2.0, -3.0, 0.5)
    flown.begin(origin)
    before, _ = flown.wanted(5.0, origin)
    after, instant = flown.wanted(5.0, origin._replace(x_m=1.5))
    assert after == before._replace(x_m=pytest.approx(before.x_m + 0.5))
    assert instant is not None
    assert not flown.over(5.0)
    assert flown.over(100.0)


def test_plans_stop_where_they_are_told_to(tmp_path: Path) -> None:
    degree = 1.0 / (math.radians(1.0) * 6371000.0)
    items = ", ".join(
        f'{{"type": "SimpleItem", "command": 16, "frame": 3, "params": [{hold}, 0, 0, null, {1 + way * degree}, 2, 5]}}'
        for way, hold in ((0, 0), (4, 3), (8, 0))
    )
    path = tmp_path / "field.plan"
    path.write_text(f'{{"mission": {{"plannedHomePosition": [1, 2, 0], "items": [{items}]}}}}')
    flown = TrajectoryMission(load_config(QUADROTOR, (mission(f"{{plan: {{file: {path}}}}}"),)))
    flown.begin(PositionSetpoint(0.0, 0.0, -5.0, 0.0))
    places = []
    time_s = 0.0
    while not flown.over(time_s):
        places.append(flown.wanted(time_s, PositionSetpoint(0.0, 0.0, -5.0, 0.0))[0])
        time_s += 0.1
    assert 29 <= sum(abs(place.x_m - 4.0) < 1e-6 for place in places) <= 33
    assert places[-1].x_m == pytest.approx(8.0, abs=0.02)
    assert {round(place.z_m, 6) for place in places} == {-5.0}
