"""A command that is killed takes what it has started with it: no plant and no flight is left behind."""

from __future__ import annotations

import os
import subprocess
import sys
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from harness.processes import RIG, ROOT, Process, eventually, finish, start, stop

pytestmark = pytest.mark.realtime

SEARCH = """
import time
from companion.processes import Processes

if __name__ == "__main__":
    with Processes(True) as elsewhere:
        elsewhere.call(time.sleep, 600.0)()
"""


def descendants(pid: int) -> set[int]:
    """Its children and theirs, that run."""
    children: dict[int, set[int]] = defaultdict(set)
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if fields[0] != "Z":
            children[int(fields[1])].add(int(stat.parent.name))
    found, look = set(), {pid}
    while look:
        look = {child for parent in look for child in children[parent]}
        found |= look
    return found


def runs(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


@contextmanager
def killed(process: Process, least: int) -> Iterator[set[int]]:
    """Kill it once it has so many descendants; which. What is left of them afterwards is killed too."""
    family: set[int] = set()

    def grown() -> bool:
        family.update(descendants(process.pid))
        return len(descendants(process.pid)) >= least

    try:
        assert eventually(grown)
        family = descendants(process.pid)
        process.kill()
        process.wait()
        yield family
    finally:
        stop(process)
        for pid in family:
            if runs(pid):
                os.kill(pid, 9)


@pytest.mark.parametrize(
    ("command", "least"),
    [
        # two flights, a plant and a log's writer for each, and multiprocessing's resource tracker
        (("sitl", RIG, "--set", "mission.duration_s=6000"), 7),
        (("sitl", "--scenarios", "*"), 3),
    ],
    ids=["experiment", "scenarios"],
)
def test_kill_9_leaves_no_orphans(tmp_path: Path, command: tuple[object, ...], least: int) -> None:
    with killed(start(*command, "--out", tmp_path / "out"), least) as family:
        assert eventually(lambda: not any(map(runs, family)), 20.0), [
            Path(f"/proc/{pid}/cmdline").read_bytes() for pid in family if runs(pid)
        ]


def test_a_search_ends_with_who_wanted_it(tmp_path: Path) -> None:
    (tmp_path / "search.py").write_text(SEARCH)
    process = subprocess.Popen(
        [sys.executable, str(tmp_path / "search.py")],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    with killed(process, 3) as family:
        assert eventually(lambda: not any(map(runs, family)), 20.0)


def test_a_plant_that_nobody_holds_ends_when_it_was_told_so() -> None:
    """Its input is /dev/null here; without the option that means nothing, as `served` shows in every other test."""
    assert finish("sitl", RIG, "--serve", "--port", 0, "--end-with-input", timeout_s=30.0).returncode == 1
