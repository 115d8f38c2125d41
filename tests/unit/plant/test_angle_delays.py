"""Each angle of the plant is late by a delay of its own; and the text of a config is read as its file would be."""

from __future__ import annotations

from pathlib import Path

import pytest

from companion.attitude_response.kind import LinearResponse
from companion.attitude_response.kinds import FirstOrder
from companion.config import ConfigError, load_config, load_text
from sitl.build import build_vehicle
from sitl.vehicles import quadrotor
from sitl.vehicles.attitude_loop import AngleGains, RateGains
from sitl.vehicles.rotation import euler, quaternion
from sitl.vehicles.vehicle import Quadrotor, Rig, Vehicle

SHIPPED = Path(__file__).resolve().parents[3] / "config"
PX4, RIG = SHIPPED / "px4_quadrotor.yaml", SHIPPED / "antx_rig.yaml"
LEVEL = (1.0, 0.0, 0.0, 0.0)


def moves_after(vehicle: Vehicle, wanted: tuple[float, float, float], steps: int = 120) -> list[int | None]:
    """The millisecond in which roll, pitch and yaw first move after the set-point has changed from level."""
    for _ in range(100):
        vehicle.step(LEVEL, 0.5)
    found: list[int | None] = [None, None, None]
    for k in range(steps):
        vehicle.step(quaternion(*wanted), 0.5)
        for i, angle in enumerate(euler(*vehicle.state.q_wxyz)):
            if found[i] is None and abs(angle) > 1e-6:
                found[i] = k
    return found


def lifted(delay_s: float, angle_delays_s: tuple[float, float, float]) -> Quadrotor:
    loop, none = LinearResponse(FirstOrder, (50.0,)), RateGains(0.0, 0.0, 0.0, 1.0, 0.0)
    params = quadrotor.QuadrotorParams(
        1.0, 0.1, 0.01, 0.01, 0.02, False, loop, loop, loop, AngleGains(0.0, 0.0, 0.0), none, none, none
    )
    vehicle = Quadrotor(params, 0.5, delay_s, angle_delays_s=angle_delays_s)
    vehicle.lift_to(-100.0)
    return vehicle


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("common_s", [0.0, 0.01])
def test_each_angle_is_late_by_its_own_on_top_of_the_common_delay(axis: int, common_s: float) -> None:
    delays_s = (0.061, 0.046, 0.0)
    wanted = tuple(0.1 if i == axis else 0.0 for i in range(3))
    moved = moves_after(lifted(common_s, delays_s), wanted)  # type: ignore[arg-type]
    assert moved[axis] == pytest.approx(1e3 * (delays_s[axis] + common_s), abs=1)


def test_all_at_once_come_one_after_the_other() -> None:
    vehicle = lifted(0.0, (0.06, 0.04, 0.02))
    for _ in range(100):
        vehicle.step(LEVEL, 0.5)
    seen = []
    for _ in range(300):
        vehicle.step(quaternion(0.1, 0.2, 0.3), 0.5)
        seen.append(euler(*vehicle.state.q_wxyz))
    half = [next(k for k, angles in enumerate(seen) if angles[i] > 0.5 * at) for i, at in enumerate((0.1, 0.2, 0.3))]
    assert half[0] - half[1] == pytest.approx(20, abs=2)
    assert half[1] - half[2] == pytest.approx(20, abs=2)
    assert seen[-1] == pytest.approx((0.1, 0.2, 0.3), abs=1e-3), "they all arrive"


def test_the_config_gives_them_by_angle() -> None:
    overrides = tuple(f"plant.quadrotor.{a}.delay_s={s}" for a, s in (("roll", 0.06), ("pitch", 0.03), ("yaw", 0.0)))
    vehicle = build_vehicle(load_config(PX4, (*overrides, "plant.setpoint_delay_s=0.01")))
    assert isinstance(vehicle, Quadrotor)
    vehicle.lift_to(-100.0)
    assert moves_after(vehicle, (0.1, 0.0, 0.0))[0] == pytest.approx(70, abs=1)
    assert moves_after(vehicle, (0.0, 0.1, 0.0), 60)[1] is not None


def test_a_rig_has_the_one_of_pitch() -> None:
    vehicle = build_vehicle(load_config(RIG, ("plant.rig.pitch.delay_s=0.04", "plant.setpoint_delay_s=0.01")))
    assert isinstance(vehicle, Rig)
    assert moves_after(vehicle, (0.0, 0.1, 0.0))[1] == pytest.approx(50, abs=1)


@pytest.mark.parametrize("delay", ["-0.01", "0.6", "soon"])
def test_an_impossible_delay_is_one_line(delay: str) -> None:
    with pytest.raises(ConfigError, match=r"plant\.quadrotor\.roll\.delay_s: ") as caught:
        load_config(PX4, (f"plant.quadrotor.roll.delay_s={delay}",))
    assert len(str(caught.value).splitlines()) == 1


# -- the text of a config --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("path", [PX4, RIG], ids=lambda path: path.stem)
def test_the_text_of_a_config_reads_as_its_file(path: Path) -> None:
    assert load_text(path.read_text(), Path("new.yaml"), path.parent) == load_config(path)


def test_its_paths_start_at_the_folder_given(tmp_path: Path) -> None:
    (tmp_path / "stairs.yaml").write_text("duration_s: 7\n")
    text = PX4.read_text()
    at = text.index("mission:")
    end = text.index("guards:")
    text = text[:at] + "mission: {file: stairs.yaml}\n" + text[end:]
    assert load_text(text, Path("new.yaml"), tmp_path).mission.duration_s == 7
    with pytest.raises(ConfigError, match=r"stairs\.yaml: no such file"):
        load_text(text, Path("new.yaml"), tmp_path / "elsewhere")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", r"not a config"),
        ("vehicle: {kind: rig\n", r"line 2: "),
        ("vehicle: {}\nvehicle: {}\n", r"line 2: key vehicle given twice"),
        (RIG.read_text().replace("hover_thrust: 0.5", "hover_thrust: 1.5"), r"vehicle\.hover_thrust: .*\(it is 1\.5\)"),
    ],
)
def test_a_bad_text_is_one_line_with_the_name_it_was_given(text: str, words: str) -> None:
    with pytest.raises(ConfigError, match=rf"^new\.yaml.*{words}") as caught:
        load_text(text, Path("new.yaml"), SHIPPED)
    assert len(str(caught.value).splitlines()) == 1
