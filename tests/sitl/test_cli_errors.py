"""Whatever is wrong with command line, config or link: one clear line on stderr, exit code 2, no traceback."""

from __future__ import annotations

import os
import re
import socket
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import NamedTuple

import pytest
from harness.command import companion
from harness.ports import free_port
from harness.processes import ROOT, finish

RIG = str(ROOT / "config" / "antx_rig.yaml")
QUICK = ("--set", "link.connect_timeout_s=0.5")
NO_VEHICLE = r"no heartbeat of vehicle 1/1 within 0\.5 s: check the link and vehicle\.system_id"


class Case(NamedTuple):
    """A command line, and the line it must end with."""

    arguments: tuple[str, ...]
    line: str  # a regular expression


# {busy} is a UDP port that somebody has, {free} one that nobody has, {tty} a silent serial line.
CASES = {
    # the command line
    "no command": Case((), r"companion: .* required: COMMAND"),
    "unknown command": Case(("fly",), r"companion: .*invalid choice: 'fly'"),
    "no config": Case(("run",), r"companion run: .* required: config"),
    "port out of range": Case(("sitl", "--port", "65536"), r"companion: --port 65536: not a UDP port"),
    # the file
    "missing file": Case(("run", "none.yaml"), r"companion: none\.yaml: no such file"),
    "directory": Case(("sitl", "."), r"companion: \.: Is a directory"),
    "bad YAML": Case(("run", "bad.yaml"), r"companion: bad\.yaml line 2: "),
    # the keys
    "unknown key": Case(("run", "unknown.yaml"), r"companion: unknown\.yaml: tick\.rate: unknown key"),
    "wrong type": Case(("run", "type.yaml"), r"companion: type\.yaml: tick\.rate_hz: .*number.*'fast'"),
    "impossible value": Case(("run", "value.yaml"), r"companion: value\.yaml: vehicle\.hover_thrust: .*\(it is 1\.5\)"),
    "override without a value": Case(
        ("run", RIG, "--set", "tick.rate_hz"), r"companion: --set tick\.rate_hz: write it"
    ),
    "override that is no YAML": Case(("sitl", "--set", "tick.rate_hz=["), r"companion: --set tick\.rate_hz=\[: "),
    "no plant": Case(("sitl", RIG, "--set", "plant="), r"companion: .*antx_rig\.yaml: no plant section"),
    # the link
    "busy port": Case(
        ("run", RIG, "--link", "udpin://127.0.0.1:{busy}"), r"companion: link udpin://127\.0\.0\.1:{busy}: .*in use"
    ),
    "busy port of the plant": Case(
        ("sitl", "--serve", "--port", "{busy}"), r"companion: plant: UDP port {busy} is busy"
    ),
    "absent serial device": Case(
        ("run", RIG, "--link", "serial:///dev/absent:921600"),
        r"companion: link serial:///dev/absent:921600: cannot open /dev/absent: No such file or directory",
    ),
    "absent serial device of the plant": Case(
        ("sitl", "--serve", "--link", "serial:///dev/absent:921600"),
        r"companion: plant: .*/dev/absent cannot be opened",
    ),
    "no link URL": Case(("run", RIG, "--link", "tcp://localhost:1"), r"companion: link tcp://.*: not a link URL"),
    # nobody there
    "no vehicle where it should be": Case(
        ("run", RIG, "--link", "udpout://127.0.0.1:{free}", *QUICK), rf"companion: {NO_VEHICLE}"
    ),
    "no vehicle calls": Case(("run", RIG, "--link", "udpin://127.0.0.1:{free}", *QUICK), rf"companion: {NO_VEHICLE}"),
    "no vehicle on the line": Case(
        ("run", RIG, "--link", "serial://{tty}:921600", *QUICK), rf"companion: {NO_VEHICLE}"
    ),
    # logs, and what is made of them
    "identify without a log": Case(("identify",), r"companion identify: .* required: LOG"),
    "identify a log that is not there": Case(("identify", "none.ulg"), r"companion: none\.ulg: no such file"),
    "identify what is no log": Case(("identify", "bad.yaml"), r"companion: bad\.yaml: "),
    "identify and write into nothing": Case(
        ("identify", "none.ulg", "--write"), r"companion: --write: give the config"
    ),
    "identify for a config that is not there": Case(
        ("identify", "none.ulg", "--config", "none.yaml"), r"companion: none\.yaml: no such file"
    ),
    "design without a template": Case(("design", "none.ulg", "--out", "new.yaml"), r"companion design: .*--template"),
    "design with a log that is not there": Case(
        ("design", "none.ulg", "--template", RIG, "--out", "new.yaml"), r"companion: none\.ulg: no such file"
    ),
    "design with a template that is not there": Case(
        ("design", "none.ulg", "--template", "none.yaml", "--out", "new.yaml"), r"companion: none\.yaml: no such file"
    ),
    "design with a margin out of range": Case(
        ("design", "none.ulg", "--template", RIG, "--out", "new.yaml", "--margin", "1"),
        r"companion: --margin 1: a frac",
    ),
    "design with a margin that is no number": Case(
        ("design", "none.ulg", "--template", RIG, "--out", "new.yaml", "--margin", "nan"), r"companion: --margin nan: "
    ),
    "design with a link of a second": Case(
        ("design", "none.ulg", "--template", RIG, "--out", "new.yaml", "--link-delay", "1"),
        r"companion: --link-delay 1: seconds",
    ),
    "design onto what is there": Case(
        ("design", "none.ulg", "--template", RIG, "--out", "bad.yaml"), r"companion: bad\.yaml: exists: .*--force"
    ),
    "design into a folder that is not there": Case(
        ("design", "none.ulg", "--template", RIG, "--out", "none/new.yaml"), r"companion: none/new\.yaml: cannot write"
    ),
    "doublets beyond the envelope": Case(
        ("sitl", "--identify", "--set", "mission.identification.amplitude_deg=15"),
        r"companion: .*mission\.identification: a doublet .* beyond controller\.envelope\..*: an amplitude_deg of ",
    ),
    # what asks the vehicle
    "vehicle without a config": Case(("vehicle",), r"companion vehicle: .* required: config"),
    "vehicle by a config that is not there": Case(("vehicle", "none.yaml"), r"companion: none\.yaml: no such file"),
    "no vehicle to ask": Case(
        ("vehicle", RIG, "--link", "udpout://127.0.0.1:{free}", *QUICK), r"companion: udpout:.*: no heartbeat"
    ),
    "logs by a config that is not there": Case(("logs", "none.yaml"), r"companion: none\.yaml: no such file"),
    "logs that are to be listed and fetched": Case(
        ("logs", RIG, "--list", "--latest"), r"companion logs: .*not allowed"
    ),
    "no vehicle with logs": Case(
        ("logs", RIG, "--link", "udpout://127.0.0.1:{free}", *QUICK), r"companion: udpout:.*: no heartbeat"
    ),
    # scenarios
    "a scenario that is not there": Case(
        ("sitl", "--scenarios", "no_such"), r"companion: --scenarios .*no_such.*: no such scenario"
    ),
    "scenarios by the wall clock": Case(
        ("sitl", "--scenarios", "--realtime"), r"companion: --scenarios brings its own plant .*--realtime"
    ),
    # nowhere to write
    "flight folder inside a file": Case(
        ("run", RIG, "--link", "udpout://127.0.0.1:{free}", "--out", "empty.yaml"),
        r"companion: empty\.yaml/.*: cannot write the flight folder: Not a directory",
    ),
    "busy port of the experiment": Case(
        ("sitl", "--port", "{busy}", "--out", "busy"),
        r"companion: plant: UDP port {busy} is busy",
    ),
    "parameter that the plant does not have": Case(
        ("sitl", "--serve", "--set", "plant.parameters={{NO_SUCH: 1}}"),
        r"companion: .*plant\.parameters.*no parameter.*NO_SUCH",
    ),
    "parameter that no float holds": Case(
        ("sitl", "--serve", "--port", "{busy}", "--set", "plant.parameters={{MIS_TAKEOFF_ALT: 1.0e+300}}"),
        r"companion: .*plant\.parameters: a value does not fit",
    ),
}

FILES = {
    "bad.yaml": "vehicle: {kind: rig\n",
    "empty.yaml": "",
    "unknown.yaml": Path(RIG).read_text().replace("  floor_hz: 900", "  floor_hz: 900\n  rate: 1000"),
    "type.yaml": Path(RIG).read_text().replace("  rate_hz: 1000", "  rate_hz: fast"),
    "value.yaml": Path(RIG).read_text().replace("hover_thrust: 0.5", "hover_thrust: 1.5"),
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the files are."""
    made = tmp_path_factory.mktemp("cli")
    for name, text in FILES.items():
        (made / name).write_text(text)
    return made


@pytest.fixture
def places() -> Iterator[dict[str, str]]:
    """What stands for the places in a case."""
    ours, theirs = os.openpty()
    with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as taken:
        taken.bind(("127.0.0.1", 0))
        yield {"busy": str(taken.getsockname()[1]), "free": str(free_port()), "tty": os.ttyname(theirs)}
    os.close(ours)
    os.close(theirs)


def check_line(case: Case, places: dict[str, str], code: int, err: str) -> None:
    assert code == 2
    pattern = case.line
    for place, value in places.items():
        pattern = pattern.replace(f"{{{place}}}", value)
    (line,) = err.splitlines()
    assert re.match(pattern, line), line


@pytest.mark.parametrize("name", CASES)
def test_one_clear_line_and_exit_code_2(name: str, folder: Path, places: dict[str, str]) -> None:
    case = CASES[name]
    ended = companion(*(argument.format(**places) for argument in case.arguments), cwd=folder)
    check_line(case, places, ended.returncode, ended.stderr)


@pytest.mark.parametrize("name", ["no command", "missing file", "unknown key", "no vehicle calls"])
def test_a_process_of_its_own_says_the_same(name: str, folder: Path, places: dict[str, str]) -> None:
    case = CASES[name]
    ended = finish(*(argument.format(**places) for argument in case.arguments), cwd=folder)
    check_line(case, places, ended.returncode, ended.stderr)
    assert "Traceback" not in ended.stdout


def test_a_refused_flight_leaves_its_folder(tmp_path: Path) -> None:
    ended = companion("run", RIG, "--link", f"udpout://127.0.0.1:{free_port()}", *QUICK, "--out", "log", cwd=tmp_path)
    assert ended.returncode == 2
    (flight,) = (tmp_path / "log").iterdir()
    assert {path.name for path in flight.iterdir()} == {"config.yaml", "traffic.tlog", "flight.mcap"}


def test_what_run_prints_names_the_folder(tmp_path: Path) -> None:
    ended = finish("run", RIG, "--link", f"udpout://127.0.0.1:{free_port()}", *QUICK, "--out", "log", cwd=tmp_path)
    (flight,) = (tmp_path / "log").iterdir()
    assert str(flight.relative_to(tmp_path)) in ended.stdout


def test_help_and_version_are_no_errors(tmp_path: Path) -> None:
    for arguments in (("--help",), ("--version",)):
        ended = companion(*arguments, cwd=tmp_path)
        assert (ended.returncode, ended.stderr) == (0, "")
        assert "companion" in ended.stdout


def test_an_experiment_on_a_full_disk_ends_without_a_traceback(tmp_path: Path) -> None:
    (tmp_path / "out" / "hedged").mkdir(parents=True)
    (tmp_path / "out" / "hedged" / "flight.mcap").symlink_to("/dev/full")
    short = ("--set", "mission.duration_s=0.5", "--set", "mission.waypoints=[]")
    ended = finish("sitl", "--hedging", *short, "--out", "out", cwd=tmp_path)
    assert ended.returncode != 0
    assert "No space left on device" in ended.stderr
    assert "Traceback" not in ended.stdout + ended.stderr
