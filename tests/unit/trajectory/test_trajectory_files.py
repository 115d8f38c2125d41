"""Samples and plans: what is read is what was written, and a bad file is one line."""

import builtins
import json
import math
from pathlib import Path
from typing import Any

import pytest

from companion.trajectory.curves import Lemniscate
from companion.trajectory.plan import read_plan
from companion.trajectory.samples import read_samples

HOME = [47.4, 8.5, 500.0]
DEGREE_M = math.radians(1.0) * 6371000.0


def table(path: Path, *, motion: bool, step_s: float = 0.1) -> Lemniscate:
    """A figure of eight as CSV."""
    flown = Lemniscate(4.0, 2.0, 1.5, 1.0, 3.0)
    names = ["time_s", "x_m", "y_m", "z_m", "yaw_deg"] + (
        ["vx_m_s", "vy_m_s", "vz_m_s", "ax_m_s2", "ay_m_s2", "az_m_s2"] if motion else []
    )
    lines = [",".join(names)]
    for k in range(int(flown.duration_s / step_s) + 1):
        at = flown.at(step_s * k)
        row = [step_s * k, *at[:3], 30.0, *(at[3:9] if motion else ())]
        lines.append(",".join(repr(float(value)) for value in row))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return flown


@pytest.mark.parametrize(("motion", "place", "acceleration"), [(True, 1e-5, 0.02), (False, 1e-4, 0.1)])
def test_samples_give_the_curve_that_they_are_of(
    motion: bool, place: float, acceleration: float, tmp_path: Path
) -> None:
    flown = table(tmp_path / "eight.csv", motion=motion)
    read = read_samples(tmp_path / "eight.csv")
    for k in range(20, 400, 7):
        time_s = flown.duration_s * k / 420.0
        is_, was = read.at(time_s), flown.at(time_s)
        assert is_[:3] == pytest.approx(was[:3], abs=place)
        assert is_[6:9] == pytest.approx(was[6:9], abs=acceleration)
        assert is_.yaw_rad == pytest.approx(math.radians(30.0))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "empty"),
        ("time_s,x_m,y_m\n0,0,0\n1,1,1\n", "no column 'z_m'"),
        ("time_s,x_m,y_m,z_m,q\n0,0,0,0,0\n1,1,1,1,1\n", "unknown column 'q'"),
        ("time_s,x_m,y_m,z_m,x_m\n0,0,0,0,0\n", "there twice"),
        ("time_s,x_m,y_m,z_m,vx_m_s\n0,0,0,0,0\n1,1,1,1,1\n", "'vx_m_s' without 'vy_m_s'"),
        ("time_s,x_m,y_m,z_m\n0,0,0,0\n", "fewer than two"),
        ("time_s,x_m,y_m,z_m\n0,0,0,0\n1,0,0,0\n2,0,0,0\n", "fewer than four"),
        ("time_s,x_m,y_m,z_m\n0,0,0,0\n1,nan,0,0\n2,0,0,0\n3,0,0,0\n", "sample 2 holds"),
        ("time_s,x_m,y_m,z_m\n0,0,0,0\n0,1,0,0\n2,0,0,0\n3,0,0,0\n", "sample 2 at 0 s does not come after"),
        ("time_s,x_m,y_m,z_m\n0,0,0,0\n1,a,0,0\n", "row 3, x_m: 'a' is not a number"),
        ("time_s,x_m,y_m,z_m\n0,0,0\n", "row 2 has 3 values for 4"),
    ],
)
def test_bad_samples_are_one_line(text: str, words: str, tmp_path: Path) -> None:
    path = tmp_path / "bad.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ValueError, match=words) as caught:
        read_samples(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


def test_no_file_and_no_text_are_one_line(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no such file"):
        read_samples(tmp_path / "none.csv")
    (tmp_path / "binary.csv").write_bytes(b"\xff\xfe\x00\x80")
    with pytest.raises(ValueError, match="not a text file"):
        read_samples(tmp_path / "binary.csv")


def test_parquet_without_pyarrow_says_how_to_get_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real = builtins.__import__

    def without(name: str, *rest: Any, **options: Any) -> Any:
        if name.partition(".")[0] == "pyarrow":
            raise ImportError(name)
        return real(name, *rest, **options)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(ValueError, match=r"needs pyarrow: pip install 'companion\[parquet\]'"):
        read_samples(tmp_path / "eight.parquet")


def test_parquet_is_read_as_csv_is(tmp_path: Path) -> None:
    pyarrow = pytest.importorskip("pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet")
    csv = pytest.importorskip("pyarrow.csv")
    table(tmp_path / "eight.csv", motion=True)
    parquet.write_table(csv.read_csv(tmp_path / "eight.csv"), tmp_path / "eight.parquet")
    assert read_samples(tmp_path / "eight.parquet") == read_samples(tmp_path / "eight.csv")
    (tmp_path / "bad.parquet").write_bytes(b"no parquet")
    with pytest.raises(ValueError, match=r"bad\.parquet: "):
        read_samples(tmp_path / "bad.parquet")
    parquet.write_table(pyarrow.table({"time_s": ["a", "b"]}), tmp_path / "text.parquet")
    with pytest.raises(ValueError, match="column 'time_s' holds what is not a number"):
        read_samples(tmp_path / "text.parquet")


def item(command: int, *params: float | None, frame: int = 3) -> dict[str, Any]:
    return {"type": "SimpleItem", "command": command, "frame": frame, "params": list(params)}


def plan(path: Path, *items: Any) -> Path:
    path.write_text(json.dumps({"fileType": "Plan", "mission": {"items": items, "plannedHomePosition": HOME}}))
    return path


def waypoint(
    north_m: float, east_m: float, up_m: float, hold_s: float | None = 0.0, yaw: float | None = None, frame: int = 3
) -> Any:
    east = HOME[1] + east_m / DEGREE_M / math.cos(math.radians(HOME[0]))
    return item(
        16, hold_s, 0, 0, yaw, HOME[0] + north_m / DEGREE_M, east, up_m + (HOME[2] if frame == 0 else 0.0), frame=frame
    )


def test_a_plan_has_its_places_around_home(tmp_path: Path) -> None:
    path = plan(
        tmp_path / "field.plan",
        item(22, 0, 0, 0, None, *HOME[:2], 5.0),
        waypoint(10.0, 5.0, 6.0), waypoint(20.0, -5.0, 7.0, 3.0, 90.0, frame=0),
        item(20, 0, 0, 0, 0, 0, 0, 0), "never read",
    )  # fmt: skip
    first, second = read_plan(path)
    assert first.place == pytest.approx((10.0, 5.0, -6.0, 0.0), abs=1e-3)
    assert second.place == pytest.approx((20.0, -5.0, -7.0, math.pi / 2), abs=1e-3)
    assert (first.hold_s, second.hold_s, first.heading_given, second.heading_given) == (0.0, 3.0, False, True)


@pytest.mark.parametrize(
    ("items", "words"),
    [
        ((), "fewer than two waypoints"),
        ((waypoint(0, 0, 5), {"type": "ComplexItem"}), "item 2 is no simple item"),
        ((waypoint(0, 0, 5), item(178, 1, 2, 3, 4, 5, 6, 7)), "item 2 is command 178"),
        ((waypoint(0, 0, 5, frame=10), waypoint(1, 0, 5)), "item 1: frame 10"),
        ((item(16, 0, 0, 0, None, None, 8.5, 5), waypoint(1, 0, 5)), "item 1: 3 finite numbers"),
        ((item(16, 0, 0, 0, None, 147.0, 8.5, 5), waypoint(1, 0, 5)), "no place on Earth"),
        ((item(16, 0, 0), waypoint(1, 0, 5)), "params: seven numbers"),
    ],
)  # fmt: skip
def test_a_bad_plan_is_one_line(items: tuple[Any, ...], words: str, tmp_path: Path) -> None:
    path = plan(tmp_path / "bad.plan", *items)
    with pytest.raises(ValueError, match=words) as caught:
        read_plan(path)
    assert str(caught.value).startswith(f"{path}: ")


@pytest.mark.parametrize(
    ("text", "words"), [("{", "not JSON"), ("[]", "not a plan"), ('{"mission": {"items": []}}', "plannedHome")]
)
def test_what_is_no_plan_is_one_line(text: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "bad.plan").write_text(text)
    with pytest.raises(ValueError, match=words):
        read_plan(tmp_path / "bad.plan")
