"""`companion sitl`: the paper's tables from flights over real sockets, the same bytes twice, instability called so."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from companion.record import schema
from companion.record.reader import read_flight

ROOT = Path(__file__).resolve().parents[2]
RIG, QUADROTOR = ROOT / "config" / "antx_rig.yaml", ROOT / "config" / "paper_quadrotor.yaml"
SHORT = [
    "--set", "tick.rate_hz=250", "--set", "tick.floor_hz=200", "--set", "mission.duration_s=6",
    "--set", "mission.waypoints=[{at_s: 1, offset_ned_m: [0.2, 0, 0]}]",
]  # fmt: skip


def start(*arguments: str | Path) -> "subprocess.Popen[str]":
    command = [sys.executable, "-m", "companion", "sitl", *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT)


def finish(process: "subprocess.Popen[str]", code: int) -> dict:
    out, err = process.communicate(timeout=280)
    assert process.returncode == code, err
    assert "Traceback" not in err
    assert len(out.strip().splitlines()) == 1  # one JSON object on stdout, nothing else
    return json.loads(out)


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict]:
    """Both of the paper's experiments, side by side."""
    out = tmp_path_factory.mktemp("paper")
    started = {
        name: start(config, "--json", "--out", out / name) for name, config in (("rig", RIG), ("quadrotor", QUADROTOR))
    }
    return {name: finish(process, 0) for name, process in started.items()}


PAPER = {
    "rig": {"hedged": (0.0860, 0.0275), "standard": (0.1211, 0.0428)},
    "quadrotor": {"hedged": (0.0805, 0.0136), "standard": (0.1110, 0.0314)},
}


@pytest.mark.parametrize(("vehicle", "tolerance"), [("rig", 0.05), ("quadrotor", 0.10)])
@pytest.mark.parametrize("controller", ["hedged", "standard"])
def test_tables_1_and_2(flown: dict[str, dict], vehicle: str, tolerance: float, controller: str) -> None:
    ours = flown[vehicle]["controllers"][controller]
    peak, rms = PAPER[vehicle][controller]
    assert ours["stable"] is True
    assert ours["peak_error_m"] == pytest.approx(peak, rel=tolerance)
    assert ours["rms_error_m"] == pytest.approx(rms, rel=tolerance)


def test_every_figure_of_the_paper_is_a_png(flown: dict[str, dict]) -> None:
    wanted = {"rig": ["figure_5", "figure_6", "comparison"], "quadrotor": [f"figure_{n}" for n in (1, 2, 3, 4)]}
    for vehicle, names in wanted.items():
        folder = Path(flown[vehicle]["flights"][0]).parent
        for name in names:
            data = (folder / f"{name}.png").read_bytes()
            assert data.startswith(b"\x89PNG")
            assert len(data) > 20_000


def test_flight_folder_explains_itself(flown: dict[str, dict]) -> None:
    folder = Path(flown["quadrotor"]["flights"][0])
    assert (folder / "config.yaml").read_text().startswith("# as flown, from paper_quadrotor.yaml")
    flight = read_flight(folder)
    assert [event.name for event in flight.events][-1] == "released_mission_complete"
    assert {"checking", "standby", "engaged"} <= {event.name for event in flight.events}
    assert set(flight.ticks.dtype.names) == {field.name for field in (*schema.FLOATS, *schema.FLAGS)}
    engaged = flight.ticks[flight.ticks["state"] == 3]
    assert len(engaged) == pytest.approx(64_000, abs=5)
    assert not any(engaged["limited"][1000:])


def test_table_1_at_gamma_200_is_called_unstable_instead_of_printed(tmp_path: Path) -> None:
    gamma = "controller.axes.{}.adaptation_rate.standard=200"
    arguments = [QUADROTOR, "--no-hedging", "--set", gamma.format("x"), "--set", gamma.format("y")]
    process = start(*arguments, "--out", tmp_path / "a")
    out, err = process.communicate(timeout=200)
    assert process.returncode == 1, err
    assert "standard MRAC is unstable" in out
    assert "UNSTABLE" in out
    report = json.loads((tmp_path / "a" / "summary.json").read_text())["controllers"]["standard"]
    assert report["stable"] is False
    assert report["peak_error_m"] > 0.2


def message_data(folder: Path) -> bytes:
    flight = read_flight(folder)
    return flight.ticks.tobytes() + repr(flight.events).encode()


def test_same_lockstep_flight_twice_gives_the_same_bytes(tmp_path: Path) -> None:
    folders = [tmp_path / name for name in ("a", "b")]
    for config in (RIG, QUADROTOR):
        flights = []
        for process in [start(config, *SHORT, "--hedging", "--json", "--out", f / config.stem) for f in folders]:
            flights.append(Path(finish(process, 0)["flights"][0]))
        first, second = (message_data(flight) for flight in flights)
        assert len(first) > 100_000
        assert first == second
        assert (flights[0] / "traffic.tlog").stat().st_size > 100_000


def test_realtime_option_flies_by_the_wall_clock(tmp_path: Path) -> None:
    report = finish(start(RIG, *SHORT, "--hedging", "--realtime", "--json", "--out", tmp_path / "a"), 0)
    assert 0.5 < report["realtime_factor"] < 1.1


def test_out_folder_that_cannot_be_made_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    process = start(RIG, *SHORT, "--hedging", "--out", tmp_path / "file" / "below")
    _, err = process.communicate(timeout=60)
    assert process.returncode == 2
    assert err.strip().count("\n") == 0
    assert "cannot write the flight folder" in err
