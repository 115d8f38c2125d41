"""What a campaign draws, the random numbers of its compiled loop, and its table on disk."""

from __future__ import annotations

from pathlib import Path
from random import Random

import numpy as np
import pytest

from companion.cli import main
from companion.config import ConfigError
from sitl.campaign import free_vehicle, guided_vehicle, loop, mersenne
from sitl.campaign.compiled import compiled
from sitl.campaign.draws import draw, read_distributions
from sitl.campaign.results import BATCH, Results, ResultsError

ROOT = Path(__file__).resolve().parents[3]
QUADROTOR = str(ROOT / "config" / "px4_quadrotor.yaml")
GOOD = """
plant.mismatch.mass: {uniform: [0.8, 1.2]}
plant.mismatch.drag: {log_uniform: [0.5, 2]}
plant.setpoint_delay_s: {normal: [0.03, 0.02], within: [0.01, 0.05]}
plant.wind.mean_ned_m_s: {uniform: [[-4, -4, 0], [4, 4, 0]]}
"""


def written(folder: Path, text: str) -> Path:
    path = folder / "vary.yaml"
    path.write_text(text)
    return path


def test_a_flights_draw_is_its_own_and_comes_again(tmp_path: Path) -> None:
    distributions = read_distributions(written(tmp_path, GOOD))
    draws = [draw(distributions, 1, flight) for flight in range(400)]
    assert draws[7] == draw(distributions, 1, 7)
    assert draws[7] != draw(distributions, 2, 7)
    assert len({one.columns["plant.seed"] for one in draws}) == 400
    mass = [one.columns["plant.mismatch.mass"] for one in draws]
    delay = [one.columns["plant.setpoint_delay_s"] for one in draws]
    assert np.mean(mass) == pytest.approx(1.0, abs=0.03)
    assert 0.8 <= min(mass) < 0.81 < 1.19 < max(mass) <= 1.2
    assert 0.01 <= min(delay) < 0.012 < 0.048 < max(delay) <= 0.05
    assert {one.columns["plant.wind.mean_ned_m_s[2]"] for one in draws} == {0.0}
    assert np.std([one.columns["plant.wind.mean_ned_m_s[0]"] for one in draws]) == pytest.approx(8 / 12**0.5, rel=0.1)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "write a line for each key"),
        ("a: 3", "a: write a distribution"),
        ("a: {triangle: [1, 2]}", "write one of uniform, log_uniform, normal"),
        ("a: {uniform: [2, 1]}", "uniform from 2 to 1 is impossible"),
        ("a: {uniform: [1, .nan]}", "finite numbers"),
        ("a: {log_uniform: [0, 1]}", "log_uniform from 0 to 1 is impossible"),
        ("a: {normal: [0, -1]}", "not negative"),
        ("a: {normal: [0, 1], within: [10, 11]}", "never come within 10 to 11"),
        ("a: {uniform: [0, 1], within: [3, 2]}", "upside down"),
        ("a: {uniform: [[0, 1], [1, 2, 3]]}", "not of one length"),
        ("a: {uniform: [yes, 1]}", "two numbers are wanted"),
        ("a: {uniform: [", "not valid YAML"),
    ],
)
def test_an_impossible_distribution_is_one_line(text: str, complaint: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=complaint) as error:
        read_distributions(written(tmp_path, text))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (("--flights", "0"), "--flights 0: at least 1 is wanted"),
        (("--workers", "0"), "--workers 0: at least 1 is wanted"),
        (("--vary", "missing.yaml"), "missing.yaml: No such file"),
        (("--set", "plant.mass=3"), "plant.mass: unknown key"),
    ],
)
def test_bad_input_is_one_line(
    arguments: tuple[str, ...], complaint: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("numba")
    with pytest.raises(SystemExit) as ended:
        main(["campaign", QUADROTOR, "--out", str(tmp_path / "out"), *arguments])
    said = capsys.readouterr().err
    assert ended.value.code == 2
    assert complaint in said
    assert said.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_compiled_random_numbers_are_pythons() -> None:
    pytest.importorskip("numba")
    normal, uniform = compiled(mersenne.normal), compiled(mersenne.uniform)
    random = Random("7 estimator")
    random.gauss(0.0, 1.0)  # so that there is one kept
    words, kept = mersenne.state_of(random)
    for place in range(3000):
        if place % 3:
            assert normal(words, kept) == random.gauss(0.0, 1.0)
        else:
            assert uniform(words) == random.random()


def test_what_is_compiled_for_one_vehicle_is_not_called_as_for_another() -> None:
    """Kept on disk by two processes, `loop.arrive` of rig and quadrotor was one symbol: the rig's flew both."""
    pytest.importorskip("numba")
    names = {compiled(loop.fly, vehicle=each).py_func.__qualname__ for each in (free_vehicle, guided_vehicle)}  # type: ignore[attr-defined]
    assert names == {"fly_free_vehicle", "fly_guided_vehicle"}


def test_a_table_takes_each_flight_once_and_goes_on_after_a_kill(tmp_path: Path) -> None:
    pytest.importorskip("pyarrow")
    results = Results(tmp_path, {"seed": 1})
    first, second = results.missing(BATCH + 3)
    results.add(first, [{"flight": flight} for flight in first])
    (tmp_path / "parts" / "00000001.parquet").write_bytes(b"PAR1 cut off")  # as a file system leaves it without power
    again = Results(tmp_path, {"seed": 1})
    assert again.missing(BATCH + 3) == [second]
    again.add(second, [{"flight": flight} for flight in second])
    assert again.merge(BATCH + 3)["flight"].to_pylist() == list(range(BATCH + 3))
    assert again.missing(BATCH + 4) == [range(BATCH, BATCH + 4)]  # a batch that was cut short is flown anew
    with pytest.raises(ResultsError, match="holds another campaign"):
        Results(tmp_path, {"seed": 2})
