"""Code comes from where it was installed: a folder in the current directory is never imported by any child."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from companion.processes import Processes
from companion.record.recorder import TICK, Recorder
from companion.safe_path import child_environment, python_command

ROOT = Path(__file__).resolve().parents[3]
PLANTED = ("mcap", "multiprocessing", "pickle", "struct", "argparse", "runpy", "yaml")
PYTHON_S = ("typing", "contextlib", "__future__")  # `python -m` takes some before a line of ours has run


@pytest.fixture
def planted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A current directory with folders named as what we import; each says that it was run, and does no harm."""
    folder = tmp_path / "downloads"
    for name in (*PLANTED, *PYTHON_S):
        (folder / name).mkdir(parents=True)
        (folder / name / "__init__.py").write_text(
            f"open({str(tmp_path / f'ran_{name}')!r}, 'w').close()\nraise ImportError('planted')\n"
        )
    monkeypatch.chdir(folder)
    return tmp_path


def ran(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.glob("ran_*"))


def test_the_writer_of_the_log_takes_nothing_from_the_current_directory(planted: Path) -> None:
    flight = planted / "flight"
    flight.mkdir()
    recorder = Recorder(flight)
    recorder.add(TICK, 1, b"\0" * 8)
    assert recorder.close() is None
    assert ran(planted) == []
    assert (flight / "flight.mcap").stat().st_size > 100


def test_nor_do_the_workers_of_a_search(planted: Path) -> None:
    with Processes(elsewhere=True) as processes:
        assert processes.call(abs, -3)() == 3
    assert ran(planted) == []


@pytest.mark.parametrize("path", ["", f"{ROOT}", f":{ROOT}:."], ids=["none", "whole", "relative"])
def test_nor_does_the_command_itself(planted: Path, path: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", path)
    command = python_command("companion", "--version")
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False, env=child_environment())
    assert (done.returncode, done.stderr, done.stdout.split()[0]) == (0, "", "companion")
    assert ran(planted) == []


def test_python_m_takes_no_more_than_its_beginning(planted: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    for name in PYTHON_S:
        shutil.rmtree(name)
    command = [sys.executable, "-m", "companion", "--version"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stdout.split()[:1]) == (0, ["companion"]), done.stderr
    assert set(ran(planted)) <= {"ran_runpy"}  # by Python, before a line of ours has run
