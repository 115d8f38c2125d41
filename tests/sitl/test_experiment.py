"""`companion sitl`: the paper's tables, the same bytes twice, instability called so."""

import json
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from harness.processes import PATIENT, RIG, ROOT, finish

from companion.config import Config, load_config
from companion.flight.authority.states import Reason
from companion.flight.process import FlightProcess
from companion.record import schema
from companion.record.folder import open_folder
from companion.record.reader import read_flight
from sitl.build import build_world
from sitl.experiment.figures import draw_figures
from sitl.metrics import score
from sitl.wire.memory import LockstepLink

QUADROTOR = ROOT / "config" / "paper_quadrotor.yaml"
SHORT = [
    "--set", "tick.rate_hz=250", "--set", "tick.floor_hz=200", "--set", "mission.duration_s=6",
    "--set", "mission.waypoints=[{at_s: 1, offset_ned_m: [0.2, 0, 0]}]",
]  # fmt: skip


def told(*arguments: object, code: int = 0) -> dict[str, Any]:
    """What `companion sitl --json` says, in a process of its own."""
    ended = finish("sitl", *arguments, "--json")
    assert ended.returncode == code, ended.stderr
    assert "Traceback" not in ended.stderr
    assert len(ended.stdout.strip().splitlines()) == 1  # one JSON object on stdout, nothing else
    report: dict[str, Any] = json.loads(ended.stdout)
    return report


PAPER = {
    "antx_rig": {"hedged": (0.0860, 0.0275), "standard": (0.1211, 0.0428)},
    "paper_quadrotor": {"hedged": (0.0805, 0.0136), "standard": (0.1110, 0.0314)},
}
FIGURES = {
    "antx_rig": ("figure_5", "figure_6", "comparison"),
    "paper_quadrotor": tuple(f"figure_{n}" for n in (1, 2, 3, 4)),
}


@cache
def config_of(vehicle: str, *overrides: str) -> Config:
    return load_config(ROOT / "config" / f"{vehicle}.yaml", overrides)


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Path]:
    """The folder of one of the paper's flights, flown in memory when it is first asked for."""
    out = tmp_path_factory.mktemp("paper")

    @cache
    def fly(vehicle: str, controller: str, *overrides: str) -> Path:
        folder, config = out / "_".join((vehicle, controller, *overrides)), config_of(vehicle, *overrides)
        recorder = open_folder(folder, ROOT / "config" / f"{vehicle}.yaml", config, blocking=True, direct=True)
        link = LockstepLink(build_world(config).autopilot)
        hedging = controller == "hedged"
        summary = FlightProcess(config, link, recorder, hedging=hedging, engage=True, lockstep=True).run()
        assert recorder.close() is None
        assert summary.reason is Reason.MISSION_COMPLETE
        return folder

    return fly


@pytest.mark.slow
@pytest.mark.parametrize("controller", ["hedged", "standard"])
@pytest.mark.parametrize(("vehicle", "tolerance"), [("antx_rig", 0.05), ("paper_quadrotor", 0.10)])
def test_tables_1_and_2(flown: Callable[..., Path], vehicle: str, tolerance: float, controller: str) -> None:
    ours = score(config_of(vehicle), read_flight(flown(vehicle, controller)))
    peak, rms = PAPER[vehicle][controller]
    assert ours.stable
    assert ours.peak_error_m == pytest.approx(peak, rel=tolerance)
    assert ours.rms_error_m == pytest.approx(rms, rel=tolerance)


@pytest.mark.parametrize("vehicle", FIGURES)
def test_every_figure_of_the_paper_is_a_png(flown: Callable[..., Path], vehicle: str, tmp_path: Path) -> None:
    flights = {controller: read_flight(flown(vehicle, controller)) for controller in ("hedged", "standard")}
    drawn = {path.stem: path.read_bytes() for path in draw_figures(config_of(vehicle), flights, tmp_path)}
    assert set(FIGURES[vehicle]) <= set(drawn)
    for data in drawn.values():
        assert data.startswith(b"\x89PNG")
        assert len(data) > 20_000


def test_flight_folder_explains_itself(flown: Callable[..., Path]) -> None:
    folder = flown("paper_quadrotor", "hedged")
    assert (folder / "config.yaml").read_text().startswith("# as flown, from paper_quadrotor.yaml")
    flight = read_flight(folder)
    assert [event.name for event in flight.events][-1] == "released_mission_complete"
    assert {"checking", "standby", "engaged"} <= {event.name for event in flight.events}
    assert set(flight.ticks.dtype.names) == {field.name for field in (*schema.FLOATS, *schema.FLAGS)}
    engaged = flight.ticks[flight.ticks["state"] == 3]
    assert len(engaged) == pytest.approx(64_000, abs=5)
    assert not any(engaged["limited"][1000:])


def test_the_command_flies_both_and_writes_what_it_prints(tmp_path: Path) -> None:
    report = told(RIG, *SHORT, "--out", tmp_path / "a")
    assert json.loads((tmp_path / "a" / "summary.json").read_text()) == report
    assert list(report["controllers"]) == ["hedged", "standard"]
    assert all(one["stable"] and 0.0 < one["rms_error_m"] < 0.2 for one in report["controllers"].values())
    assert [Path(flight).name for flight in report["flights"]] == ["hedged", "standard"]
    assert {path.stem for path in (tmp_path / "a").glob("*.png")} == set(FIGURES["antx_rig"])


GAMMA = tuple(f"controller.axes.{axis}.adaptation_rate.standard=200" for axis in "xy")


@pytest.mark.slow
def test_table_1_at_gamma_200_is_unstable(flown: Callable[..., Path]) -> None:
    ours = score(config_of("paper_quadrotor", *GAMMA), read_flight(flown("paper_quadrotor", "standard", *GAMMA)))
    assert ours.stable is False
    assert ours.peak_error_m > 0.2


LATE = {  # a stair in the last quarter of the flight
    "antx_rig": ("tick.rate_hz=250", "tick.floor_hz=200", "mission.duration_s=25"),
    "px4_quadrotor": (
        "tick.rate_hz=100", "tick.floor_hz=80", "guards.pose_rate_hz.enabled=false", "plant.sensors=null",
        "mission.duration_s=20",
        "mission.waypoints=[{at_s: 2, offset_ned_m: [0.5, 0, 0]}, "
        "{at_s: 16, offset_ned_m: [0, 0, 0]}]",
    ),
}  # fmt: skip


@pytest.mark.parametrize("controller", ["hedged", "standard"])
@pytest.mark.parametrize("vehicle", LATE)
def test_a_late_stair_is_not_instability(flown: Callable[..., Path], vehicle: str, controller: str) -> None:
    overrides = LATE[vehicle]
    ours = score(config_of(vehicle, *overrides), read_flight(flown(vehicle, controller, *overrides)))
    assert 0.05 < ours.peak_error_m < 0.3
    assert ours.stable


def test_an_unstable_flight_is_called_so_instead_of_printed(tmp_path: Path) -> None:
    gamma = [part for setting in GAMMA for part in ("--set", setting.replace("200", "500"))]
    stairs = "[{at_s: 0, offset_ned_m: [0.042, 0.042, 0]}, {at_s: 8, offset_ned_m: [0.084, 0.084, 0]}]"
    mission = ("--set", "mission.duration_s=16", "--set", f"mission.waypoints={stairs}")
    ended = finish("sitl", QUADROTOR, "--no-hedging", *SHORT, *mission, *gamma, "--out", tmp_path / "a")
    assert ended.returncode == 1, ended.stderr
    assert "standard MRAC is unstable" in ended.stdout
    assert "UNSTABLE" in ended.stdout
    report = json.loads((tmp_path / "a" / "summary.json").read_text())["controllers"]["standard"]
    assert report["stable"] is False


def message_data(folder: Path) -> bytes:
    flight = read_flight(folder)
    return flight.ticks.tobytes() + repr(flight.events).encode()


@pytest.mark.parametrize("config", [RIG, QUADROTOR], ids=["rig", "quadrotor"])
def test_same_lockstep_flight_twice_gives_the_same_bytes(config: Path, tmp_path: Path) -> None:
    """Over sockets, plant and companion in processes of their own."""
    reports = [told(config, *SHORT, "--hedging", "--out", tmp_path / name) for name in ("a", "b")]
    flights = [Path(report["flights"][0]) for report in reports]
    first, second = map(message_data, flights)
    assert len(first) > 100_000
    assert first == second
    assert (flights[0] / "traffic.tlog").stat().st_size > 100_000


@pytest.mark.realtime
def test_realtime_option_flies_by_the_wall_clock(tmp_path: Path) -> None:
    report = told(RIG, *SHORT, *PATIENT, "--hedging", "--realtime", "--out", tmp_path / "a")
    assert 0.5 < report["realtime_factor"] < 1.1


def test_out_folder_that_cannot_be_made_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    ended = finish("sitl", RIG, *SHORT, "--hedging", "--out", tmp_path / "file" / "below")
    assert ended.returncode == 2
    assert ended.stderr.strip().count("\n") == 0
    assert "cannot write the flight folder" in ended.stderr
