"""Config files: the shipped ones load, a bad one ends as one line that names the file, the key and the reason."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from pydantic import ValidationError

from companion.config import Config, ConfigError, load_config, parse_override
from companion.config.controller import interval
from companion.record.folder import new_folder, open_folder

SHIPPED = Path(__file__).resolve().parents[3] / "config"
RIG = SHIPPED / "antx_rig.yaml"
QUADROTOR = SHIPPED / "paper_quadrotor.yaml"
PX4 = SHIPPED / "px4_quadrotor.yaml"


def complaint(path: Path, *overrides: str) -> str:
    """The one line that a bad config ends with."""
    with pytest.raises(ConfigError) as caught:
        load_config(path, overrides)
    text = str(caught.value)
    assert len(text.splitlines()) == 1, text
    return text


def complaint_about(text: str | bytes, folder: Path) -> str:
    """The same for the text of a file; it must name that file."""
    path = folder / "mine.yaml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    line = complaint(path)
    assert line.startswith(str(path))
    return line.removeprefix(str(path))


# --- what loads -----------------------------------------------------------------------------------------------------


def test_the_shipped_files_load() -> None:
    names = [
        "antx_rig.yaml",
        "paper_quadrotor.yaml",
        "px4_quadrotor.yaml",
        "px4_quadrotor_1_18.yaml",
        "trajectories.yaml",
    ]
    assert sorted(path.name for path in SHIPPED.glob("*.yaml")) == names
    rig, quadrotor = load_config(RIG), load_config(QUADROTOR)
    assert (rig.vehicle.kind, quadrotor.vehicle.kind) == ("rig", "quadrotor")
    assert rig.controller.axes.y is None
    assert (rig.controller.anchor, quadrotor.controller.anchor) == ("engage", "engage")  # the paper's
    assert rig.controller.bias is None
    px4 = load_config(PX4)
    assert px4.controller.anchor == "setpoint"
    assert px4.paper is None
    assert quadrotor.controller.axes.y == quadrotor.controller.axes.x, "one anchor describes both axes"
    assert rig.paper is not None
    assert (rig.paper.hedged.peak_error_m, rig.paper.hedged.rms_error_m) == (0.0860, 0.0275)
    assert (rig.paper.standard.peak_error_m, rig.paper.standard.rms_error_m) == (0.1211, 0.0428)
    assert quadrotor.paper is not None
    assert (quadrotor.paper.hedged.peak_error_m, quadrotor.paper.hedged.rms_error_m) == (0.0805, 0.0136)
    assert (quadrotor.paper.standard.peak_error_m, quadrotor.paper.standard.rms_error_m) == (0.1110, 0.0314)


def test_a_loaded_config_does_not_change() -> None:
    config = load_config(RIG)
    with pytest.raises(ValidationError, match="frozen"):
        config.tick.rate_hz = 5.0  # type: ignore[misc]


def test_defaults_are_those_of_flight(tmp_path: Path) -> None:
    path = tmp_path / "short.yaml"
    path.write_text(
        """
        vehicle: {kind: rig, hover_thrust: 0.5}
        link: {url: "udpin://0.0.0.0:14540"}
        tick: {rate_hz: 100, floor_hz: 80}
        controller:
          envelope: {position_m: 1, velocity_m_s: 1}
          axes:
            x:
              natural_frequency_rad_s: 2.3
              damping_ratio: 0.7
              position_weight_bound: [-0.7, 0.2]
              velocity_weight_bound: 0.35
              adaptation_rate: {hedged: 10, standard: 10}
        attitude: {x: {natural_frequency_rad_s: 9.7, damping_ratio: 0.94, delay_s: 0.03}}
        """
    )
    config = load_config(path)
    assert config.controller.initial_weights == "nominal"
    assert config.controller.hedging is True
    assert config.controller.anchor == "setpoint"
    assert config.controller.limits.speed_m_s is None
    assert config.vehicle.hover_thrust_source == "config"
    assert (config.vehicle.system_id, config.vehicle.component_id) == (1, 1)
    assert (config.link.system_id, config.link.component_id) == (1, 191)
    assert config.mission.waypoints == ()
    assert config.guards.pose_age_s.enabled
    assert config.plant is None
    assert interval(config.controller.axes.x.position_weight_bound) == (-0.7, 0.2)
    assert interval(config.controller.axes.x.velocity_weight_bound) == (-0.35, 0.35)


@pytest.mark.parametrize("path", [RIG, QUADROTOR, PX4], ids=lambda path: path.stem)
def test_the_config_left_in_a_flight_folder_loads_to_the_config_flown(path: Path, tmp_path: Path) -> None:
    flown = load_config(path, ("mission.duration_s=3.5", "mission.waypoints=[]", "controller.hedging=false"))
    folder = new_folder(tmp_path, path.stem)
    assert open_folder(folder, path, flown, blocking=True).close() is None
    assert (folder / "config.yaml").read_text().startswith(f"# as flown, from {path.name}\n")
    assert load_config(folder / "config.yaml") == flown


def test_a_flight_folder_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    blocked = tmp_path / "a file"
    blocked.touch()
    with pytest.raises(ConfigError, match="a file/flight: cannot write the flight folder: Not a directory"):
        open_folder(blocked / "flight", RIG, load_config(RIG), blocking=True)


def test_folders_of_one_second_do_not_collide(tmp_path: Path) -> None:
    folders = [new_folder(tmp_path, "rig") for _ in range(3)]
    assert len(set(folders)) == 3
    assert all(folder.is_dir() for folder in folders)


# --- overrides ------------------------------------------------------------------------------------------------------


def test_an_override_changes_its_key_and_no_other() -> None:
    changed = load_config(RIG, ("controller.axes.x.adaptation_rate.standard=200", "tick.floor_hz=1.5e+2"))
    expected = load_config(RIG).model_dump()
    expected["controller"]["axes"]["x"]["adaptation_rate"]["standard"] = 200.0
    expected["tick"]["floor_hz"] = 150.0
    assert changed == Config.model_validate(expected)


@pytest.mark.parametrize(("changed", "kept"), [("x", "y"), ("y", "x")])
def test_an_override_of_one_axis_does_not_leak_through_the_anchor(changed: str, kept: str) -> None:
    config = load_config(
        QUADROTOR,
        (
            f"controller.axes.{changed}.damping_ratio=0.9",
            f"controller.axes.{changed}.adaptation_rate.hedged=11",
        ),
    )
    axes = config.controller.axes
    assert getattr(axes, changed).damping_ratio == 0.9
    assert getattr(axes, changed).adaptation_rate.hedged == 11.0
    assert getattr(axes, kept) == load_config(QUADROTOR).controller.axes.x


def test_the_last_override_of_a_key_counts() -> None:
    assert load_config(RIG, ("tick.rate_hz=950", "tick.rate_hz=975")).tick.rate_hz == 975.0


def test_an_override_may_add_a_section() -> None:
    config = load_config(RIG, ("guards.pose_age_s.limit=0.5",))
    assert (config.guards.pose_age_s.enabled, config.guards.pose_age_s.limit) == (True, 0.5)
    without = load_config(RIG, ("guards={}", "guards.heartbeat_age_s.limit=9"))
    assert (without.guards.heartbeat_age_s.limit, without.guards.pose_age_s.limit) == (9.0, 0.25)


def test_override_values_are_yaml() -> None:
    assert parse_override("a.b.c=[1, 2.5]") == (["a", "b", "c"], [1, 2.5])
    assert parse_override("a=x=y") == (["a"], "x=y")
    assert parse_override("a=") == (["a"], None)


@pytest.mark.parametrize(
    ("override", "reason"),
    [
        ("nonsense", "--set nonsense: write it as section.key=value"),
        ("=5", "--set =5: write it as section.key=value"),
        ("tick.rate_hz=[", "--set tick.rate_hz=[: '[' is not a YAML value"),
        ("tick.rate_hz=*x", "is not a YAML value"),
        ("tick.rate_hz.deep=5", "--set tick.rate_hz.deep: rate_hz is not a section"),
        ("mission.waypoints.0.at_s=5", "waypoints is not a section"),
        ("tick.rate=5", "antx_rig.yaml: tick.rate: unknown key"),
    ],
)
def test_a_bad_override_is_named(override: str, reason: str) -> None:
    assert reason in complaint(RIG, override)


# --- files that cannot be read --------------------------------------------------------------------------------------


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    assert complaint(tmp_path / "none.yaml") == f"{tmp_path / 'none.yaml'}: no such file"
    assert "none.yaml: no such file" in complaint(tmp_path / "no folder" / "none.yaml")


def test_a_directory_is_named(tmp_path: Path) -> None:
    assert complaint(tmp_path) == f"{tmp_path}: Is a directory"


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (b"\xff\xfe\x00\x01", ": not a text file"),
        (b"vehicle: \x00", ": not valid YAML"),
        ("", ": not a config (a mapping of sections is expected)"),
        ("# nothing but a comment\n", ": not a config (a mapping of sections is expected)"),
        ("- vehicle\n- link\n", ": not a config (a mapping of sections is expected)"),
        ("vehicle: {kind: rig\n", " line 2: expected ',' or '}', but got '<stream end>'"),
        ("vehicle:\n\t- rig\n", r" line 2: found character '\t' that cannot start any token"),
        ("vehicle: {kind: rig}\nlink: *elsewhere\n", " line 2: found undefined alias 'elsewhere'"),
        ("vehicle: !!python/object/apply:os.getcwd []\n", " line 1: could not determine a constructor for the tag"),
        ("vehicle: {}\nlink: {}\nvehicle: {}\n", " line 3: key vehicle given twice"),
        ("tick:\n  rate_hz: 1\n  floor_hz: 1\n  rate_hz: 2\n", " line 4: key rate_hz given twice"),
        ("tick: [{rate_hz: 1, rate_hz: 1}]\n", " line 1: key rate_hz given twice"),
    ],
)
def test_a_file_that_is_no_config_is_named_with_its_line(text: str | bytes, reason: str, tmp_path: Path) -> None:
    assert complaint_about(text, tmp_path).startswith(reason)


def test_a_key_given_twice_in_a_shipped_file_is_refused(tmp_path: Path) -> None:
    text = RIG.read_text().replace("  floor_hz: 900", "  rate_hz: 999\n  floor_hz: 900")
    line = text.splitlines().index("  rate_hz: 999") + 1
    assert complaint_about(text, tmp_path) == f" line {line}: key rate_hz given twice"


# --- what a file may not say ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("override", "key", "reason"),
    [
        # unknown, missing
        ("controler={}", "controler", "unknown key"),
        ("link.baud=57600", "link.baud", "unknown key"),
        ("controller.axes.x.gamma=1", "controller.axes.x.gamma", "unknown key"),
        ("controller.axes.z={}", "controller.axes.z", "unknown key"),
        ("plant.rig.pitch.lag_s=0.1", "plant.rig.pitch.lag_s", "unknown key"),
        ("tick={rate_hz: 100}", "tick.floor_hz", "missing"),
        ("mission.waypoints=[{at_s: 1}]", "mission.waypoints.0.offset_ned_m", "missing"),
        # wrong types
        ("tick.rate_hz=fast", "tick.rate_hz", "a number is wanted"),
        ("tick.rate_hz=[1]", "tick.rate_hz", "valid number"),
        ("tick.rate_hz=", "tick.rate_hz", "valid number"),
        ("link.url=5", "link.url", "valid string"),
        ("link=5", "link", "valid dictionary"),
        ("vehicle=[1]", "vehicle", "valid dictionary"),
        ("vehicle.system_id=1.5", "vehicle.system_id", "valid integer"),
        ("controller.hedging=perhaps", "controller.hedging", "valid boolean"),
        (
            "controller.axes.x.position_weight_bound=wide",
            "controller.axes.x.position_weight_bound",
            "a number is wanted",
        ),
        ("controller.axes.x.position_weight_bound=[1]", "controller.axes.x.position_weight_bound", ""),
        ("mission.waypoints=[{at_s: 1, offset_ned_m: [0, 0, up]}]", "mission.waypoints.0.offset_ned_m.2", "number"),
        ("mission.waypoints=[{at_s: 1, offset_ned_m: [0, 0]}]", "mission.waypoints.0.offset_ned_m.2", "missing"),
        (
            "mission.waypoints=[{at_s: 1, offset_ned_m: [0, 0, 0, 0]}]",
            "mission.waypoints.0.offset_ned_m",
            "at most 3 items",
        ),
        # not numbers to fly with
        ("tick.rate_hz=.nan", "tick.rate_hz", "finite"),
        ("tick.rate_hz=.inf", "tick.rate_hz", "finite"),
        ("vehicle.hover_thrust=.nan", "vehicle.hover_thrust", "finite"),
        ("controller.axes.x.damping_ratio=.nan", "controller.axes.x.damping_ratio", "finite"),
        ("controller.axes.x.position_weight_bound=.nan", "controller.axes.x.position_weight_bound", "finite"),
        ("controller.axes.x.lyapunov_q=[1, .nan]", "controller.axes.x.lyapunov_q.1", "finite"),
        ("controller.axes.x.adaptation_rate.hedged=.inf", "controller.axes.x.adaptation_rate.hedged", "finite"),
        ("mission.waypoints=[{at_s: 1, offset_ned_m: [.nan, 0, 0]}]", "mission.waypoints.0.offset_ned_m.0", "finite"),
        ("mission.waypoints=[{at_s: .nan, offset_ned_m: [0, 0, 0]}]", "mission.waypoints.0.at_s", "finite"),
        ("guards.pose_age_s.limit=.inf", "guards.pose_age_s.limit", "finite"),
        ("plant.parameters={MPC_THR_HOVER: .nan}", "plant.parameters.MPC_THR_HOVER", "finite"),
        ("plant.rig.viscous_friction_1_s=.nan", "plant.rig.viscous_friction_1_s", "finite"),
        # impossible values
        ("vehicle.kind=boat", "vehicle.kind", "'rig' or 'quadrotor'"),
        ("vehicle.hover_thrust=0", "vehicle.hover_thrust", "greater than 0"),
        ("vehicle.hover_thrust=1", "vehicle.hover_thrust", "less than 1"),
        ("vehicle.system_id=0", "vehicle.system_id", "greater than or equal to 1"),
        ("vehicle.component_id=256", "vehicle.component_id", "less than or equal to 255"),
        ("link.system_id=256", "link.system_id", "less than or equal to 255"),
        ("link.connect_timeout_s=0", "link.connect_timeout_s", "greater than 0"),
        ("tick.rate_hz=1001", "tick.rate_hz", "less than or equal to 1000"),
        ("tick.floor_hz=0", "tick.floor_hz", "greater than 0"),
        ("tick.floor_hz=1000.5", "tick", "floor_hz (1000.5) must not be above rate_hz (1000)"),
        ("controller.initial_weights=random", "controller.initial_weights", "'zero' or 'nominal'"),
        ("controller.axes.x.natural_frequency_rad_s=0", "controller.axes.x.natural_frequency_rad_s", "greater than 0"),
        ("controller.axes.x.damping_ratio=-0.7", "controller.axes.x.damping_ratio", "greater than 0"),
        ("controller.axes.x.lyapunov_q=[0, 1]", "controller.axes.x.lyapunov_q.0", "greater than 0"),
        (
            "controller.axes.x.adaptation_rate.standard=-1",
            "controller.axes.x.adaptation_rate.standard",
            "greater than or equal to 0",
        ),
        ("controller.limits.tilt_deg=90", "controller.limits.tilt_deg", "less than or equal to 60"),
        ("controller.limits.thrust_max=1.1", "controller.limits.thrust_max", "less than or equal to 1"),
        ("attitude.x={bandwidth_rad_s: 3, delay_s: -0.1}", "attitude.x.delay_s", "greater than or equal to 0"),
        ("mission.duration_s=0", "mission.duration_s", "greater than 0"),
        ("mission.waypoints=[{at_s: -1, offset_ned_m: [0, 0, 0]}]", "mission.waypoints.0.at_s", "or equal to 0"),
        ("guards.heartbeat_age_s.limit=-3", "guards.heartbeat_age_s.limit", "greater than 0"),
        ("plant.rig.coulomb_width_m_s=0", "plant.rig.coulomb_width_m_s", "greater than 0"),
        ("plant.setpoint_delay_s=-0.01", "plant.setpoint_delay_s", "greater than or equal to 0"),
        ("paper.hedged.rms_error_m=0", "paper.hedged.rms_error_m", "greater than 0"),
        # values that contradict each other
        (
            "controller.axes.x.position_weight_bound=[1, -1]",
            "controller.axes.x",
            "position_weight_bound: the lower bound (1) must be below the upper one (-1)",
        ),
        (
            "controller.axes.x.velocity_weight_bound=[0.5, 0.5]",
            "controller.axes.x",
            "velocity_weight_bound: the lower bound (0.5) must be below the upper one (0.5)",
        ),
        ("controller.limits.thrust_min=0.95", "controller.limits", "thrust_min must be below thrust_max"),
        ("controller.limits.thrust_max=0.4", "vehicle.hover_thrust", "must lie between"),
        ("controller.limits.thrust_min=0.5", "vehicle.hover_thrust", "must lie between"),
        ("attitude.x={}", "attitude.x", "give bandwidth_rad_s, or natural_frequency_rad_s and damping_ratio"),
        ("attitude.x={natural_frequency_rad_s: 3}", "attitude.x", "give bandwidth_rad_s"),
        ("attitude.x={bandwidth_rad_s: 3, damping_ratio: 1}", "attitude.x", "give bandwidth_rad_s"),
        (
            "attitude.x={bandwidth_rad_s: 3, natural_frequency_rad_s: 3, damping_ratio: 1}",
            "attitude.x",
            "give bandwidth_rad_s",
        ),
        (
            "mission.waypoints=[{at_s: 2, offset_ned_m: [0, 0, 0]}, {at_s: 1, offset_ned_m: [0, 0, 0]}]",
            "mission",
            "waypoints must come in order of at_s",
        ),
        (
            "mission.waypoints=[{at_s: 1, offset_ned_m: [0, 0, 0]}, {at_s: 1, offset_ned_m: [1, 0, 0]}]",
            "mission",
            "no two at the same time",
        ),
        ("mission.duration_s=20", "mission", "the last waypoint lies at or after duration_s"),
        ("plant={}", "plant", "give either rig or quadrotor"),
        ("plant.rig.pitch=", "plant.rig", "give either the linear response (pitch) or the cascade"),
        ("plant.rig.cascade={rate: {proportional_1_s: 25}}", "plant.rig", "give either the linear response"),
        ("plant.rig.pitch={}", "plant.rig.pitch", "give bandwidth_rad_s"),
        # a rig has one axis
        ("attitude.y={bandwidth_rad_s: 3}", "a rig has one axis", "remove controller.axes.y and attitude.y"),
        ("vehicle.kind=quadrotor", "a quadrotor needs", "controller.axes.y, controller.altitude and attitude.y"),
    ],
)
def test_what_is_wrong_is_named_with_its_key(override: str, key: str, reason: str) -> None:
    line = complaint(RIG, override)
    assert line.startswith(f"{RIG}: {key}")
    assert re.match(r"[:. ]|$", line.removeprefix(f"{RIG}: {key}")), f"{line!r} names another key"
    assert reason in line


def test_the_value_given_is_shown() -> None:
    assert complaint(RIG, "tick.rate_hz=fast").endswith("(it is 'fast')")
    assert complaint(RIG, "vehicle.system_id=256").endswith("(it is 256)")


def test_further_mistakes_are_counted() -> None:
    assert complaint(RIG, "tick.rate_hz=-1", "link.url=5", "extra=1").endswith("(and 2 more)")


@pytest.mark.parametrize("missing", ["controller.axes.y", "controller.altitude", "attitude.y"])
def test_a_quadrotor_needs_all_of_its_axes(missing: str) -> None:
    line = complaint(QUADROTOR, f"{missing}=")
    assert line == f"{QUADROTOR}: a quadrotor needs controller.axes.y, controller.altitude and attitude.y"


def test_a_rig_refuses_a_second_axis(tmp_path: Path) -> None:
    text = (
        RIG.read_text().replace("    x:\n", "    y: &axis\n", 1).replace("  envelope:", "    x: *axis\n  envelope:", 1)
    )
    assert complaint_about(text, tmp_path) == ": a rig has one axis: remove controller.axes.y and attitude.y"


def test_the_plant_must_be_the_vehicle() -> None:
    rig = "{viscous_friction_1_s: 1, coulomb_friction_m_s2: 0, pitch: {bandwidth_rad_s: 3}}"
    assert complaint(QUADROTOR, f"plant={{rig: {rig}}}").endswith(": plant: give the quadrotor, as vehicle.kind says")


@pytest.mark.parametrize("loop", ["roll", "pitch", "yaw"])
def test_a_quadrotor_plant_has_all_three_responses_or_none(loop: str) -> None:
    assert "give either the linear responses (roll, pitch and yaw) or the cascade" in complaint(
        QUADROTOR, f"plant.quadrotor.{loop}="
    )


# --- known gaps -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "text",
    [
        "tick: {rate_hz: 2024-13-45}\n",
        "tick: {rate_hz: !!int fast}\n",
        "tick: {rate_hz: !!timestamp 5}\n",
        f"tick: {{rate_hz: {'9' * 5000}}}\n",
        "? [a, b]\n: 1\n",
        "vehicle: &v {kind: *v}\n",
        "vehicle: " + "[" * 600,
    ],
    ids=["date", "int", "timestamp", "digits", "list as key", "alias of itself", "depth"],
)
def test_yaml_that_its_parser_chokes_on_is_one_line(text: str, tmp_path: Path) -> None:
    complaint_about(text, tmp_path)


@pytest.mark.parametrize("value", ["2024-13-45", "!!int fast", "!!float fast", "0b_"])
def test_an_override_that_the_yaml_parser_chokes_on_is_one_line(value: str) -> None:
    assert "is not a YAML value" in complaint(RIG, f"tick.rate_hz={value}")


def test_an_axis_may_be_merged_and_changed(tmp_path: Path) -> None:
    path = tmp_path / "merged.yaml"
    path.write_text(QUADROTOR.read_text().replace("y: *axis", "y: {<<: *axis, damping_ratio: 0.9} "))
    axes = load_config(path).controller.axes
    assert axes.y is not None
    assert (axes.x.damping_ratio, axes.y.damping_ratio) == (0.7, 0.9)
    assert axes.y.natural_frequency_rad_s == 4.0


def test_a_key_of_two_lines_is_complained_about_on_one(tmp_path: Path) -> None:
    assert "unknown key" in complaint_about(RIG.read_text() + '\n"two\\nlines": 1\n', tmp_path)


@pytest.mark.parametrize("key", ["controller.axes.x.damping_ratio", "vehicle.system_id", "guards.pose_age_s.limit"])
def test_a_truth_value_is_no_number(key: str) -> None:
    assert key in complaint(RIG, f"{key}=true")


def test_half_a_second_order_response_beside_a_bandwidth_is_refused() -> None:
    assert "give bandwidth_rad_s" in complaint(RIG, "plant.rig.pitch.damping_ratio=0.7")


@pytest.mark.parametrize("override", [".=5", " =5", "tick.=5", "a..b=5"])
def test_an_override_with_an_empty_key_is_refused_as_written(override: str) -> None:
    assert f"--set {override}" in complaint(RIG, override)


def test_a_mistyped_key_is_what_is_named(tmp_path: Path) -> None:
    text = RIG.read_text().replace("  rate_hz: 1000", "  rate: 1000")
    assert complaint_about(text, tmp_path).startswith(": tick.rate: unknown key")


@pytest.mark.parametrize(("bound", "reason"), [("[1, .nan]", "finite"), ("[low, 1]", "'low'")])
def test_what_is_wrong_with_a_pair_is_told(bound: str, reason: str) -> None:
    assert reason in complaint(RIG, f"controller.axes.x.position_weight_bound={bound}")
