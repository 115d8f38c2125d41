"""Firmware and gains, read before stand-by, compared with the config and pinned; the plant's store answers."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import pytest
from harness.fake_autopilot import autopilot_version
from pymavlink.dialects.v20 import development as mavlink

from companion.config import ConfigError, load_config
from companion.flight.readiness.parameters import GAINS, REFERENCE_MODEL
from companion.flight.readiness.pinned import Pinned
from companion.flight.readiness.preflight import Preflight
from companion.flight.vehicle_link.messages import Parameter, firmware
from companion.flight.vehicle_link.odometry import PoseSource
from companion.flight.vehicle_link.requests import ReadParameter, TellFirmware
from sitl.autopilot.parameters import PX4_DEFAULTS, Px4Version

QUADROTOR: Final = Path(__file__).resolve().parents[3] / "config" / "paper_quadrotor.yaml"
NO_HOVER: Final = "vehicle.hover_thrust_source=config"
V1_17, V1_18 = (1, 17, 0), (1, 18, 0)
STORES: Final = dict(zip((V1_17, V1_18), (PX4_DEFAULTS[version] for version in Px4Version), strict=True))


def read(
    version: tuple[int, int, int] | None, store: dict[str, float], *settings: str, compare: bool = True
) -> tuple[Pinned, set[str], float]:
    """What is known of a vehicle that answers at once what it has, what it was asked for, and when that was over."""
    pinned = Pinned(load_config(QUADROTOR, (NO_HOVER, *settings)), compare=compare)
    asked, now_s = set(), 0.0
    while not pinned.over and now_s < 20.0:
        for request in pinned.requests(now_s):
            if isinstance(request, TellFirmware) and version is not None:
                pinned.on_firmware(version)
            if isinstance(request, ReadParameter):
                asked.add(request.name)
                if request.name in store:
                    pinned.on_parameter(Parameter(request.name, store[request.name]))
        now_s += 0.1
    return pinned, asked, now_s


def vehicle(version: tuple[int, int, int], **changes: float) -> dict[str, float]:
    return {**STORES[version], **changes}


@pytest.mark.parametrize(("version", "names"), [(V1_17, GAINS), (V1_18, (*GAINS, *REFERENCE_MODEL))])
def test_what_is_not_stated_is_read_and_pinned(version: tuple[int, int, int], names: tuple[str, ...]) -> None:
    pinned, asked, over_s = read(version, vehicle(version))
    assert asked == set(names)
    assert over_s < 1.5
    assert pinned.stale is None
    (line,) = pinned.remarks()
    assert line.startswith(f"PX4 1.{version[1]}.0; pinned as read: MC_ROLL_P 4, ")
    assert all(name in line for name in names)
    for name in names:
        assert pinned.on_parameter(Parameter(name, 6.5)), name
        assert f"{name} is 6.5, was" in (pinned.stale or "")
        assert not pinned.on_parameter(Parameter(name, 6.5)), "told once"
        assert pinned.on_parameter(Parameter(name, vehicle(version)[name]))
        assert pinned.stale is None
    assert not pinned.on_parameter(Parameter("MPC_XY_P", 9.0)), "nobody has asked"


def test_what_is_stated_is_compared() -> None:
    stated = ('vehicle.px4_version="1.18"', "vehicle.parameters={MC_ROLL_P: 4, MC_REF_W_N: 50, COM_OBL_RC_ACT: 0}")
    pinned, _, _ = read(V1_18, vehicle(V1_18), *stated)
    assert pinned.stale is None
    assert "MC_ROLL_P" not in pinned.remarks()[0]
    faster, _, _ = read(V1_18, vehicle(V1_18, MC_REF_W_N=200.0, MC_ROLL_P=6.5), *stated)
    assert faster.stale is not None
    assert "MC_ROLL_P is 6.5, was 4, MC_REF_W_N is 200, was 50" in faster.stale
    older, _, _ = read(V1_17, vehicle(V1_17), *stated)
    assert older.stale is not None
    assert "PX4 is 1.17, was 1.18, the vehicle does not tell MC_REF_W_N" in older.stale


def test_all_of_it_stated_is_all_there_is_to_say() -> None:
    gains = ", ".join(f"{name}: {STORES[V1_17][name]}" for name in GAINS)
    pinned, _, _ = read(V1_17, vehicle(V1_17), f"vehicle.parameters={{{gains}}}")
    assert pinned.remarks() == ["PX4 1.17.0; its gains are as the config says"]


def test_gains_that_are_not_told_could_be_any() -> None:
    silent = {name: value for name, value in vehicle(V1_17).items() if name not in ("MC_ROLL_P", "MC_YAW_P")}
    pinned, _, over_s = read(V1_17, silent)
    assert over_s < 6.0
    assert (pinned.stale or "").startswith("the vehicle does not tell MC_ROLL_P, MC_YAW_P")
    assert pinned.on_parameter(Parameter("MC_ROLL_P", 4.0)), "late, but told"
    assert "does not tell MC_YAW_P" in (pinned.stale or "")


def test_a_version_that_is_not_told_matters_only_where_it_is_stated() -> None:
    pinned, asked, over_s = read(None, vehicle(V1_18))
    assert asked == set(GAINS)
    assert over_s < 4.0
    assert pinned.stale is None
    assert pinned.remarks()[0].startswith("PX4 unknown version; ")
    stated, _, _ = read(None, vehicle(V1_18), 'vehicle.px4_version="1.18"')
    assert "does not tell its firmware's version" in (stated.stale or "")


def test_nothing_is_read_where_the_vehicle_is_the_plant() -> None:
    pinned, asked, _ = read(V1_17, vehicle(V1_17), compare=False)
    assert (pinned.over, asked, pinned.stale, pinned.remarks()) == (True, set(), None, [])


def test_the_flight_is_refused_or_goes_on_uncertified() -> None:
    config = load_config(QUADROTOR, (NO_HOVER, "vehicle.parameters={MC_ROLL_P: 3}"))
    for uncertified in (False, True):
        preflight = Preflight(config, PoseSource(), uncertified=uncertified)
        for tick in range(30):
            for request in preflight.requests(0.1 * tick, heard=True):
                if isinstance(request, ReadParameter):
                    preflight.pinned.on_parameter(Parameter(request.name, STORES[V1_17][request.name]))
                if isinstance(request, TellFirmware):
                    preflight.pinned.on_firmware(V1_17)
            preflight.on_sample(0.1 * tick)
        refused = preflight.refused()
        assert (refused is None) is uncertified
        assert uncertified or "MC_ROLL_P is 4, was 3" in (refused or "")


def test_a_version_is_read_from_the_message() -> None:
    message = autopilot_version((1, 18, 2))
    packed = bytes(message.pack(mavlink.MAVLink(None)))
    assert firmware(packed[10:-2]).version == (1, 18, 2)


@pytest.mark.parametrize("text", ["1.17", "v1.17", "1"])  # the first is a number to YAML
def test_a_version_is_a_text_of_two_numbers(text: str) -> None:
    with pytest.raises(ConfigError, match=r"vehicle\.px4_version"):
        load_config(QUADROTOR, (f"vehicle.px4_version={text}",))
