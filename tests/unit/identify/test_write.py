"""`identify --write` changes the attitude section and nothing else, comments included."""

from __future__ import annotations

import os
import stat
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml

from companion.cli import main
from companion.config import ConfigError, load_config
from companion.identify import write as writing
from companion.identify.identification import Identification, identify_log

ROOT = Path(__file__).resolve().parents[3]
QUADROTOR = ROOT / "config" / "paper_quadrotor.yaml"
RIG = ROOT / "config" / "antx_rig.yaml"
Cut = Callable[[str], Path]


@pytest.fixture(scope="module")
def identified(cut: Cut) -> Identification:
    return identify_log([cut("px4_sih_attitude_p4.ulg")])


def attitude(text: str, section: str) -> str:
    """The quadrotor's config with another attitude section."""
    lines = text.splitlines(keepends=True)
    first = next(i for i, line in enumerate(lines) if line.startswith("attitude:"))
    last = next(i for i in range(first + 1, len(lines)) if lines[i].strip() and not lines[i].startswith((" ", "#")))
    return "".join(lines[:first]) + section + "\n" + "".join(lines[last:])


def expect(path: Path, identified: Identification) -> None:
    """The config says what was identified, x being pitch."""
    config = load_config(path)
    for key, axis in (("x", "pitch"), ("y", "roll")):
        response = getattr(config.attitude, key)
        assert response.bandwidth_rad_s is None
        for name, (low, high) in identified.axes[axis].chosen.intervals().items():
            ends = getattr(response, name)
            assert ends[0] <= max(low, 1e-4) < high <= ends[1]  # a delay of zero is written as the least there is
            assert ends == pytest.approx((low, high), rel=2e-3, abs=1e-4)


def test_the_shipped_config_differs_in_its_responses_alone(identified: Identification, tmp_path: Path) -> None:
    path = tmp_path / "my.yaml"
    path.write_bytes(QUADROTOR.read_bytes())
    path.chmod(0o640)
    writing.write(path, identified)
    expect(path, identified)
    old, new = QUADROTOR.read_text().splitlines(), path.read_text().splitlines()
    added = [line for line in new if line not in old]
    assert [line for line in old if line not in new] == [
        line for line in old if "bandwidth_rad_s: " in line and line[:5] in {"  x: ", "  y: "}
    ]
    assert [line.strip()[:2] for line in added] == ["# ", "x:", "# ", "y:"]
    assert added[0].startswith(
        "  # identified from px4_sih_attitude_p4.ulg: second order + delay, 3 manoeuvres, fit 0.99"
    )
    assert "delay up to 48 ms more" in added[0]
    assert added[1].endswith("# pitch")
    assert stat.S_IMODE(path.stat().st_mode) == 0o640
    assert os.listdir(tmp_path) == ["my.yaml"]


def test_writing_twice_changes_nothing_more(identified: Identification, tmp_path: Path) -> None:
    path = tmp_path / "my.yaml"
    path.write_bytes(QUADROTOR.read_bytes())
    writing.write(path, identified)
    once = path.read_bytes()
    writing.write(path, identified)
    assert path.read_bytes() == once


SECTIONS = {
    "block": """attitude:   # the tuned response
  # of pitch
  x:
    # measured by hand
    bandwidth_rad_s: 5.5   # not very well
    delay_s: 0.01
    pade_order: 2
  # of roll
  y:
    natural_frequency_rad_s: [8, 9]
    damping_ratio: 0.7
  # the heading is kept
  yaw_free: false
""",
    "flow over lines": """attitude:
  x: {
    bandwidth_rad_s: 5.5,  # by hand
    pade_order: 2
  }
  y: {bandwidth_rad_s: 9.0}
""",
    "one line": "attitude: {x: {bandwidth_rad_s: 5.5}, y: {bandwidth_rad_s: 9.0}, yaw_free: false}  # all of it\n",
}


@pytest.mark.parametrize("name", SECTIONS)
@pytest.mark.parametrize("newline", ["\n", "\r\n"], ids=["LF", "CRLF"])
def test_however_it_is_written_its_comments_stay(
    name: str, newline: str, identified: Identification, tmp_path: Path
) -> None:
    path = tmp_path / "my.yaml"
    text = attitude(QUADROTOR.read_text(), SECTIONS[name]).replace("\n", newline)
    path.write_bytes(text.encode())
    load_config(path)
    writing.write(path, identified)
    expect(path, identified)
    new = path.read_bytes().decode()
    remarks = [line.partition("#")[2].strip() for line in text.splitlines() if "#" in line]
    assert all(remark in new for remark in remarks)
    assert new.count("\r\n") == (new.count("\n") if newline == "\r\n" else 0)
    before, after = (yaml.safe_load(t) for t in (text, new))
    if "pade_order" in before["attitude"]["x"]:
        assert after["attitude"]["x"]["pade_order"] == 2
    for data in (before, after):
        del data["attitude"]["x"], data["attitude"]["y"]
    assert before == after


@pytest.mark.parametrize(
    "section",
    [
        "attitude:\n  x: &both {bandwidth_rad_s: 9.0}\n  y: *both\n",
        "attitude: {x: &both {bandwidth_rad_s: 9.0}, y: *both}\n",
    ],
)
def test_an_alias_ends_where_two_responses_begin(section: str, identified: Identification, tmp_path: Path) -> None:
    path = tmp_path / "my.yaml"
    path.write_text(attitude(QUADROTOR.read_text(), section))
    writing.write(path, identified)
    expect(path, identified)


def test_what_cannot_be_replaced_is_left_alone(identified: Identification, tmp_path: Path) -> None:
    path = tmp_path / "my.yaml"
    merged = "attitude:\n  <<: {x: {bandwidth_rad_s: 5.5}, y: {bandwidth_rad_s: 9.0}}\n"
    path.write_text(attitude(QUADROTOR.read_text(), merged))
    load_config(path)
    before = path.read_bytes()
    with pytest.raises(ConfigError, match=r"my\.yaml: attitude cannot be replaced without disturbing the rest"):
        writing.write(path, identified)
    assert path.read_bytes() == before
    assert os.listdir(tmp_path) == ["my.yaml"]


def test_a_link_stays_a_link(identified: Identification, tmp_path: Path) -> None:
    (tmp_path / "real").mkdir()
    real, link = tmp_path / "real" / "my.yaml", tmp_path / "link.yaml"
    real.write_bytes(QUADROTOR.read_bytes())
    link.symlink_to(real)
    writing.write(link, identified)
    assert link.is_symlink()
    expect(real, identified)


def test_the_command_writes_draws_and_says_so(cut: Cut, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    config, picture = tmp_path / "my.yaml", tmp_path / "my.png"
    config.write_bytes(RIG.read_bytes())
    log = cut("px4_sih_attitude_p4.ulg")
    with pytest.raises(SystemExit) as ended:
        main(["identify", str(log), "--config", str(config), "--write", "--plot", str(picture)])
    out, err = capsys.readouterr()
    assert (ended.value.code, err) == (0, "")
    for words in ("second order + delay", "(chosen)", "roll, 3 manoeuvres", "lower bound", "written into the attitude"):
        assert words in out
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert picture.stat().st_size > 50_000
    attitude_section = load_config(config).attitude
    assert attitude_section.x.natural_frequency_rad_s is not None
    assert attitude_section.y is None


def test_a_picture_that_cannot_be_written(cut: Cut, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["identify", str(cut("px4_sih_attitude_p4.ulg")), "--plot", str(tmp_path / "no" / "my.png")])
    assert ended.value.code == 2
    assert "my.png: cannot write the picture" in capsys.readouterr().err
