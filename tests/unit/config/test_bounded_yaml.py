"""A config that would cost more than it looks like is one clear line, at once.

The inputs here are small: it is what they would become that is refused, and counted, never built.
"""

from __future__ import annotations

import time
from pathlib import Path

import pytest
from harness.command import companion

from companion.config.load import ConfigError, load_config, parse_override
from companion.config.text.bounded_yaml import MOST_CHARACTERS, MOST_DEPTH, MOST_VALUES
from companion.identify.vehicle import vehicle_of

ROOT = Path(__file__).resolve().parents[3]
RIG = ROOT / "config" / "antx_rig.yaml"


def aliases(levels: int, each: int) -> str:
    """Each level is a list of aliases of the one before."""
    lines = ["a0: &a0 [0]"]
    lines += [f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * each)}]" for n in range(1, levels)]
    return "\n".join(lines)


def merges(levels: int, each: int) -> str:
    """Each level merges the one before several times."""
    lines = ["m0: &m0 {k: 0}"]
    lines += [f"m{n}: &m{n} {{<<: [{', '.join([f'*m{n - 1}'] * each)}], k{n}: 0}}" for n in range(1, levels)]
    return "\n".join(lines)


# What each stands for is just above its bound: an ordinary parser survives it, and must not get to see it.
REFUSED = {
    "aliases": (aliases(7, 6), f"line 7: more than {MOST_VALUES} values, with what aliases stand for"),
    "merges": (merges(7, 6), f"line 7: more than {MOST_VALUES} values, with what aliases stand for"),
    "an alias of itself": ("a: &a [1, *a]", "line 1: alias a stands for what it is itself in"),
    "a merge of itself": ("a: &a {<<: *a}", "line 1: alias a stands for what it is itself in"),
    "lists in lists": ("a: " + "[" * MOST_DEPTH + "]" * MOST_DEPTH, f"line 1: nested more than {MOST_DEPTH} deep"),
    "blocks in blocks": (
        "\n".join(f"{' ' * n}k:" for n in range(MOST_DEPTH + 1)),
        f"line {MOST_DEPTH}: nested more than {MOST_DEPTH} deep",
    ),
    "hexadecimal": ("a: 0x" + "f" * 400, "line 1: 0xf.* is longer than the 100 characters of a number"),
    "decimal": ("a: " + "9" * 400, "line 1: 9.* is longer than the 100 characters of a number"),
    "a tag": ("a: !!float '" + "9" * 400 + "'", "line 1: 9.* is longer than the 100 characters of a number"),
    "sixtieths": ("a: 1" + ":30" * 200, "line 1: 1:30.* is longer than the 100 characters of a number"),
    "fraction": ("a: 1." + "3" * 400, "line 1: 1.3.* is longer than the 100 characters of a number"),
    "exponent": ("a: 1" + "0" * 400 + "e1", "line 1: 10.* is longer than the 100 characters of a number"),
    "a long file": ("#" * (MOST_CHARACTERS + 1), f": more than {MOST_CHARACTERS} characters"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_passes_a_bound_is_one_line_that_says_which(name: str, tmp_path: Path) -> None:
    text, why = REFUSED[name]
    path = tmp_path / "bad.yaml"
    path.write_text(text)
    began_s = time.process_time()
    with pytest.raises(ConfigError, match=f"^{path}.*{why}$") as caught:
        load_config(path)
    assert time.process_time() - began_s < 2.0
    assert len(str(caught.value)) < 600


def test_the_bounds_are_far_above_a_config_and_hold_to_the_last(tmp_path: Path) -> None:
    """Hundreds of waypoints are read; and where the counting is exact, one value more is refused."""
    path = tmp_path / "long.yaml"
    waypoints = "".join(f"    - {{at_s: {n}, offset_ned_m: [0.01, 0, 0]}}\n" for n in range(500))
    text = RIG.read_text()
    path.write_text(text.replace("  waypoints:\n", f"  waypoints:\n{waypoints}").replace("at_s: 10,", "at_s: 600,"))
    config = load_config(path, ("mission.duration_s=4000", "mission.waypoints=[]"))
    assert config.mission.waypoints == ()

    def counted(zeros: int) -> str:
        """A mapping of three keys: 1000 values, 48 times those, and so many more."""
        again, more = ", ".join(["*a"] * 48), ", ".join("0" * zeros)
        return f"{{a: &a [{', '.join('0' * 999)}], b: [{again}], c: [{more}]}}"

    zeros = MOST_VALUES - (1 + 3 + 1000 + 48001 + 1)
    assert len(parse_override(f"x={counted(zeros)}")[1]["c"]) == zeros
    with pytest.raises(ConfigError, match=f"more than {MOST_VALUES} values"):
        parse_override(f"x={counted(zeros + 1)}")


def test_every_command_that_reads_a_config_refuses_it(tmp_path: Path) -> None:
    path = tmp_path / "bad.yaml"
    path.write_text(REFUSED["aliases"][0])
    for command in ("run", "check", "sitl"):
        done = companion(command, str(path))
        assert (done.returncode, done.stderr.count("\n")) == (2, 1)
        assert done.stderr.startswith(f"companion: {path} line 7: more than")


def test_a_flight_folder_with_such_a_config_tells_nothing_of_its_vehicle(tmp_path: Path) -> None:
    (tmp_path / "config.yaml").write_text("vehicle: {kind: rig, system_id: 7}\n")
    assert vehicle_of([tmp_path], None).system_id == 7
    (tmp_path / "config.yaml").write_text(f"vehicle: {{kind: rig, system_id: 7}}\n{aliases(7, 6)}")
    assert vehicle_of([tmp_path], None).system_id is None


@pytest.mark.parametrize("key", ["k" * 5000, "vehicle.system_id"])
def test_a_word_as_long_as_a_file_is_not_shown_whole(key: str) -> None:
    with pytest.raises(ConfigError) as caught:
        load_config(RIG, (f"{key}={'v' * 5000}",))
    assert len(str(caught.value)) < 700
