"""Changing values in a YAML text: every other character stays."""

import difflib
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from companion.config.edit import edited, flow, key_paths
from companion.config.numbers import Loader, float32
from companion.flight.readiness.parameters import GAINS, Difference, differences

TEXT = """\
# the head
a: 1        # one
b: &b       # two
  c: {d: 2, e: [1, 2]}   # three
  # between
  f:
    g: x    # four

h: *b
i: {j: 1, k: 2}  # five
"""


def test_a_value_is_replaced_and_its_comment_stays() -> None:
    assert edited(TEXT, {("a",): "7"}) == TEXT.replace("a: 1 ", "a: 7 ")
    assert edited(TEXT, {("b", "c", "e"): "[3]"}) == TEXT.replace("[1, 2]", "[3]")


def test_an_alias_is_replaced_where_it_stands_and_an_anchor_is_kept() -> None:
    text = edited(TEXT, {("h",): "{z: 1}", ("b", "c", "d"): "5"})
    assert yaml.safe_load(text)["h"] == {"z": 1}
    assert yaml.safe_load(text)["b"]["c"]["d"] == 5
    kept = edited(TEXT, {("b",): "{c: 1}"})
    assert yaml.safe_load(kept)["h"] == {"c": 1}
    assert "# three" in kept
    assert "# between" in kept


def test_two_notes_on_one_line_and_a_note_of_the_time_before() -> None:
    notes = {("i", "j"): "found j", ("i", "k"): "found k"}
    text = edited(TEXT, {("i", "j"): "11", ("i", "k"): "22"}, notes)
    assert text.endswith("# found j\n# found k\ni: {j: 11, k: 22}  # five\n")
    once = edited(TEXT, {("a",): "2"}, {("a",): "found there"})
    twice = edited(once, {("a",): "3"}, {("a",): "found here"})
    assert twice == TEXT.replace("a: 1 ", "# found here\na: 3 ")


def test_windows_line_ends_stay() -> None:
    text = edited(TEXT.replace("\n", "\r\n"), {("a",): "2"}, {("a",): "new"})
    assert text == TEXT.replace("a: 1 ", "# new\na: 2 ").replace("\n", "\r\n")


def test_a_path_that_is_not_there_is_an_error() -> None:
    with pytest.raises(KeyError):
        edited(TEXT, {("h", "c"): "1"})  # it is only there by the alias
    assert ("h", "c") not in key_paths(TEXT)


@given(st.sampled_from(sorted(key_paths(TEXT))), st.sampled_from(["1", "[1, 2]", "{q: 3}", "text", "-4.5e-3"]))
def test_only_the_lines_of_the_value_change(path: tuple[str, ...], value: str) -> None:
    text = edited(TEXT, {path: value})
    node = yaml.safe_load(text)
    for key in path:
        node = node[key]
    assert node == yaml.safe_load(value)
    gone = [line for line in difflib.ndiff(TEXT.splitlines(), text.splitlines()) if line.startswith("- ")]
    assert all("#" not in line or line.split("#")[1] in text for line in gone)


@pytest.mark.parametrize(
    "name",
    [
        "antx_rig.yaml",
        "paper_quadrotor.yaml",
        "px4_quadrotor.yaml",
        "px4_quadrotor_1_18.yaml",
        "trajectories.yaml",
    ],
)
def test_the_shipped_files_keep_all_but_what_is_changed(name: str) -> None:
    old = (Path(__file__).parents[3] / "config" / name).read_text(encoding="utf-8")
    new = edited(old, {("controller", "axes", "x", "natural_frequency_rad_s"): "1.5"})
    assert len([d for d in difflib.ndiff(old.splitlines(), new.splitlines()) if d[0] in "+-"]) == 2


# --- what stays true beside a new value -----------------------------------------------------------------------------

SPEAKING = """\
# one, of 2.3: the section's
a:
  # no figure here
  b: 2.3      # the 2.3 of old
              # and more of it
  c: 4        # a word
  # 7 of d
  d: {e: 1,   # first 1
      f: 2}
  # last
g: 5          # five, 5
"""


def test_no_comment_with_a_figure_stays_beside_a_new_value() -> None:
    changes = {("a", "b"): "9", ("a", "c"): "8", ("a", "d"): "{e: 3}", ("g",): "5"}
    expected = """\
# one, of 2.3: the section's
a:
  # no figure here
  b: 9
  c: 8        # a word
  d: {e: 3}
  # last
g: 5          # five, 5
"""
    assert edited(SPEAKING, changes, drop_figures=True) == expected
    first = edited(SPEAKING.replace("  # no figure here\n", ""), changes, drop_figures=True)
    assert first == expected.replace("  # no figure here\n", "").replace("# one, of 2.3: the section's\n", "")
    assert edited(SPEAKING, {("g",): "5.0"}, drop_figures=True).endswith("g: 5.0          # five, 5\n"), "the same"


# --- digits ----------------------------------------------------------------------------------------------------------


def test_ten_thousand_gains_come_back_as_the_32_bits_they_were() -> None:
    rng = np.random.default_rng(13)
    for row in (10.0 ** rng.uniform(-4, 3, (10_000 // len(GAINS) + 1, len(GAINS)))).astype(np.float32):
        vehicle = dict(zip(GAINS, map(float, row), strict=True))
        written = yaml.load(flow(vehicle), Loader=Loader)
        assert {name: float32(value) for name, value in written.items()} == vehicle
        assert differences(written, vehicle) == []


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_any_number_comes_back_as_the_double_it_was(value: float) -> None:
    (found,) = yaml.load(flow({"key": value}), Loader=Loader).values()
    assert found == value or float32(found) == value


def test_both_sides_of_a_difference_show_what_differs() -> None:
    found = float(np.nextafter(np.float32(0.15), np.float32(1)))
    assert str(Difference("MC_ROLLRATE_P", 0.15, found)) == "MC_ROLLRATE_P is 0.15000002, was 0.15"
    assert str(Difference("MC_ROLL_P", 4, 6.5)) == "MC_ROLL_P is 6.5, was 4"
