"""What each setting of the vehicle means, as a table; and what the command says in sum."""

from __future__ import annotations

from pathlib import Path

import pytest

from companion.config import Config, load_config
from companion.flight.readiness.parameters import GAINS, REFERENCE_MODEL
from companion.flight.readiness.px4_settings import (
    Setting,
    Verdict,
    judge_firmware,
    judge_health,
    judge_odometry,
    judge_parameters,
    unstated,
    wanted,
    worst,
)
from sitl.autopilot.parameters import PX4_DEFAULTS, Px4Version
from sitl.build import plant_parameters

QUADROTOR = Path(__file__).resolve().parents[3] / "config" / "paper_quadrotor.yaml"
FINE, DIFFERS, DANGEROUS = Verdict
V1_17, V1_18 = (1, 17, 0), (1, 18, 0)
PLANT_17, PLANT_18 = (PX4_DEFAULTS[version] for version in Px4Version)
GOOD = {name: PLANT_17[name] for name in wanted(V1_17)} | {"COM_RC_OVERRIDE": 3}
GOOD_18 = {name: PLANT_18[name] for name in wanted(V1_18)}
HEALTHY = dict.fromkeys(
    ("gyroscope", "accelerometer", "magnetometer", "local position", "global position", "home", "armable"), True
)


def config(*overrides: str) -> Config:
    return load_config(QUADROTOR, overrides)


def row(name: str, value: float, *overrides: str) -> Setting:
    return judged(name, V1_17, {**GOOD, name: value}, *overrides)


def judged(name: str, version: tuple[int, int, int], found: dict[str, float], *overrides: str) -> Setting:
    rows = {setting.name: setting for setting in judge_parameters(config(*overrides), version, found)}
    others = [setting for setting in rows.values() if setting.name != name]
    assert worst(others) is FINE
    return rows[name]


@pytest.mark.parametrize(
    ("name", "value", "verdict", "says"),
    [
        ("MPC_THR_HOVER", 0.51, FINE, "0.5"),
        ("MPC_THR_HOVER", 0.45, DIFFERS, "10%"),
        ("MPC_THR_HOVER", 0.3, DANGEROUS, "40%"),
        ("COM_OF_LOSS_T", 0.5, FINE, "3.3 m away, 2.3 m lower"),
        ("COM_OF_LOSS_T", 1.0, FINE, "10.3 m away, 6.7 m lower; 0.5 s would do: 42 deg, 3.3 m away"),
        ("MPC_MANTHR_MIN", 0.08, FINE, ""),
        ("MPC_MANTHR_MIN", 0.03, DIFFERS, "no landing in OFFBOARD"),
        ("COM_OF_LOSS_T", 0.2, DIFFERS, "guards.pose_age_s"),
        ("COM_OF_LOSS_T", 1.5, DIFFERS, "set it to 0.5"),
        ("COM_OF_LOSS_T", 10.0, DANGEROUS, "a dead companion"),
        ("COM_OBL_RC_ACT", 0, FINE, "NAV_RCL_ACT"),
        ("COM_OBL_RC_ACT", 2, DIFFERS, "by hand"),
        ("COM_OBL_RC_ACT", 3, FINE, ""),
        ("COM_OBL_RC_ACT", 5, FINE, ""),
        ("COM_OBL_RC_ACT", 6, DANGEROUS, "falls"),
        ("COM_OBL_RC_ACT", 7, DANGEROUS, "falls"),
        ("COM_RC_IN_MODE", 4, DIFFERS, "nobody takes over by hand"),
        ("NAV_RCL_ACT", 3, FINE, ""),
        ("NAV_RCL_ACT", 0, DANGEROUS, "nothing happens"),
        ("NAV_RCL_ACT", 5, DANGEROUS, "falls"),
        ("NAV_RCL_ACT", 6, DANGEROUS, "falls"),
        ("NAV_RCL_ACT", 7, DANGEROUS, "nothing happens"),
        ("COM_RCL_EXCEPT", 3, FINE, ""),
        ("COM_RCL_EXCEPT", 7, DANGEROUS, "set it to 3"),
        ("COM_RC_OVERRIDE", 1, DIFFERS, "set it to 3"),
        ("COM_RC_OVERRIDE", 2, FINE, "end OFFBOARD"),
        ("NAV_DLL_ACT", 0, FINE, ""),
        ("NAV_DLL_ACT", 6, DANGEROUS, "ground station"),
        ("MAV_1_RATE", 0, FINE, "half"),
        ("MAV_1_RATE", 1200, DIFFERS, "248000"),
        ("MAV_1_RATE", 300_000, FINE, ""),
    ],
)
def test_each_setting(name: str, value: float, verdict: Verdict, says: str) -> None:
    setting = row(name, value)
    assert setting.verdict is verdict
    assert says in setting.advice
    assert len(setting.advice) < 120, "one line"
    assert setting.advice or verdict is FINE


def test_a_changed_gain_makes_the_certificate_stale() -> None:
    setting = row("MC_ROLL_P", 3.0, "vehicle.parameters={MC_ROLL_P: 4.0}")
    assert setting.verdict is DIFFERS
    assert "was 4" in setting.advice
    assert "stale" in setting.advice
    assert row("MC_ROLL_P", 4.0, "vehicle.parameters={MC_ROLL_P: 4.0}").advice == "as identified"
    assert row("MC_ROLL_P", 3.0).advice == "not compared"


def test_any_parameter_may_be_stated() -> None:
    rows = judge_parameters(config("vehicle.parameters={MC_AIRMODE: 1}"), V1_17, {**GOOD, "MC_AIRMODE": 0})
    assert [setting.verdict for setting in rows if setting.name == "MC_AIRMODE"] == [DIFFERS]


def test_what_the_vehicle_does_not_tell_differs() -> None:
    found = {name: value for name, value in GOOD.items() if name != "MC_ROLL_P"}
    assert worst(judge_parameters(config(), V1_17, found)) is DIFFERS


def test_gains_that_nobody_stated_are_offered() -> None:
    assert unstated(config(), V1_17, GOOD) == {name: GOOD[name] for name in GAINS}
    assert "MC_ROLL_P" not in unstated(config("vehicle.parameters={MC_ROLL_P: 4.0}"), V1_17, GOOD)
    assert set(unstated(config(), V1_18, GOOD_18)) == {*GAINS, *REFERENCE_MODEL}


def test_each_version_is_asked_for_what_it_has() -> None:
    assert set(wanted(V1_17)) < set(PLANT_17)
    assert set(wanted(V1_18)) < set(PLANT_18)
    assert len(set(wanted(V1_18))) == len(wanted(V1_18))
    assert worst(judge_parameters(config(), V1_18, GOOD_18)) is FINE, "the default takes OFFBOARD by the sticks"


@pytest.mark.parametrize(
    ("name", "value", "further", "verdict", "says"),
    [
        ("MAN_OVERRIDE_SPD", 0.0, {}, FINE, "end OFFBOARD"),
        ("MAN_OVERRIDE_SPD", -1.0, {}, DIFFERS, "mode switch"),
        ("NAV_RCL_ACT", 7, {"COM_OBL_RC_ACT": 5}, DIFFERS, "nobody can take over"),
        ("NAV_RCL_ACT", 7, {"COM_OBL_RC_ACT": 0}, DANGEROUS, "COM_OBL_RC_ACT"),
        ("NAV_RCL_ACT", 6, {}, DANGEROUS, "falls"),
        ("NAV_RCL_ACT", 9, {}, DANGEROUS, "nothing happens"),
        ("MC_REF_W_N", 30.0, {}, FINE, "not compared"),
    ],
)
def test_each_setting_of_v1_18(name: str, value: float, further: dict[str, float], verdict: Verdict, says: str) -> None:
    setting = judged(name, V1_18, {**GOOD_18, **further, name: value})
    assert setting.verdict is verdict
    assert says in setting.advice
    assert len(setting.advice) < 120, "one line"
    if name == "NAV_RCL_ACT" and value == 7:
        assert "Hold" in setting.value


def test_the_reference_model_makes_the_certificate_stale() -> None:
    stated = "vehicle.parameters={MC_REF_W_N: 50}"
    assert "stale" in judged("MC_REF_W_N", V1_18, {**GOOD_18, "MC_REF_W_N": 200.0}, stated).advice
    absent = judged("MC_REF_W_N", V1_17, GOOD, stated)
    assert (absent.verdict, absent.value) == (DIFFERS, "-")


def test_firmware() -> None:
    assert judge_firmware(config(), (1, 17, 3), "1.17.3").verdict is FINE
    assert judge_firmware(config(), (1, 18, 0), "1.18.0").verdict is FINE
    assert judge_firmware(config(), (1, 16, 0), "1.16.0").verdict is DIFFERS
    assert judge_firmware(config(), (1, 19, 0), "1.19.0").verdict is DIFFERS
    of_17 = config('vehicle.px4_version="1.17"')
    assert judge_firmware(of_17, (1, 17, 3), "1.17.3").advice == "as identified"
    other = judge_firmware(of_17, (1, 18, 0), "1.18.0")
    assert other.verdict is DIFFERS
    assert "stale" in other.advice


@pytest.mark.parametrize(
    ("missing", "verdict"),
    [((), FINE), (("global position", "home"), FINE), (("armable",), DIFFERS), (("local position",), DANGEROUS)],
)
def test_health(missing: tuple[str, ...], verdict: Verdict) -> None:
    setting = judge_health({name: name not in missing for name in HEALTHY})
    assert setting.verdict is verdict
    assert all(name in setting.value for name in missing)


def test_the_odometry_is_only_told() -> None:
    assert judge_odometry(config(), 29.7) == Setting(
        "ODOMETRY", "30 Hz", FINE, "`companion run` asks for 1000 Hz and measures it"
    )


def test_the_worst_counts() -> None:
    rows = [Setting("a", "", verdict, "") for verdict in (FINE, DANGEROUS, DIFFERS)]
    assert worst(rows) is DANGEROUS
    assert worst(rows[:1]) is FINE
    assert worst([]) is FINE


def test_the_plant_has_the_gains_that_its_response_was_identified_with() -> None:
    stated = ("vehicle.parameters={MC_ROLL_P: 6.5, COM_OBL_RC_ACT: 5, NO_PLANT_HAS_IT: 1}",)
    assert plant_parameters(config(*stated)).number("MC_ROLL_P") == 6.5
    assert plant_parameters(config(*stated)).integer("COM_OBL_RC_ACT") == 5
    other = plant_parameters(config(*stated, "plant.parameters={MC_ROLL_P: 3}"))
    assert other.number("MC_ROLL_P") == 3.0, "unless the plant is told otherwise"
