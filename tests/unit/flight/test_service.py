"""sd_notify over a real socket, the watchdog's conditions, and what the operating system grants."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from companion.cli import read_command_line
from companion.commands import run
from companion.config.service import ServiceSection
from companion.flight.host.service import Notifier, prepare_process

UNIT = Path(__file__).resolve().parents[3] / "systemd" / "companion.service"


class Supervisor:
    """The other end of NOTIFY_SOCKET."""

    def __init__(self, address: str) -> None:
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.socket.bind(address.replace("@", "\0", 1))
        self.socket.setblocking(False)
        self.environment = {"NOTIFY_SOCKET": address}

    def heard(self) -> list[str]:
        told = []
        while True:
            try:
                told.append(self.socket.recv(4096).decode())
            except BlockingIOError:
                return told

    def close(self) -> None:
        self.socket.close()


@pytest.fixture(params=["path", "abstract"])
def supervisor(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Supervisor]:
    address = str(tmp_path / "notify") if request.param == "path" else f"@companion-test-{os.getpid()}"
    with closing(Supervisor(address)) as it:
        yield it


def test_a_start_is_told_once_and_each_status_when_it_changes(supervisor: Supervisor) -> None:
    with closing(Notifier(supervisor.environment)) as notifier:
        notifier.status("connecting")
        notifier.status("connecting")
        notifier.ready("standby")
        notifier.ready("standby")
        notifier.ready("engaged")
        notifier.stopping("released: operator")
        notifier.feed(0.0, 1, due=True)
    notifier.status("too late")
    assert supervisor.heard() == [
        "STATUS=connecting", "READY=1", "STATUS=standby", "STATUS=engaged", "STOPPING=1", "STATUS=released: operator",
    ]  # fmt: skip


def fed(notifier: Notifier, supervisor: Supervisor, calls: list[tuple[float, int, bool]]) -> list[float]:
    """The times at which the watchdog was fed."""
    times = []
    for now_s, ticks, due in calls:
        notifier.feed(now_s, ticks, due=due)
        times += [now_s] * supervisor.heard().count("WATCHDOG=1")
    return times


def test_the_watchdog_is_fed_by_the_loop_before_odometry_and_by_ticks_after_it(supervisor: Supervisor) -> None:
    with closing(Notifier({**supervisor.environment, "WATCHDOG_USEC": "3000000"})) as notifier:
        assert notifier.watchdog_s == pytest.approx(3.0)
        waiting = [(0.1 * n, 0, False) for n in range(30)]
        assert fed(notifier, supervisor, waiting) == pytest.approx([0.0, 1.0, 2.0])
        ticking = [(3.0 + 0.1 * n, n, True) for n in range(30)]
        assert fed(notifier, supervisor, ticking) == pytest.approx([3.1, 4.1, 5.1])
        stuck = [(6.0 + 0.1 * n, 29, True) for n in range(30)]  # the loop runs, the ticks have stopped
        assert fed(notifier, supervisor, stuck) == pytest.approx([6.1][:1])
        assert fed(notifier, supervisor, [(9.0, 30, True)]) == [9.0]


@pytest.mark.parametrize(
    "environment",
    [{}, {"WATCHDOG_USEC": "0"}, {"WATCHDOG_USEC": "x"}, {"WATCHDOG_USEC": "1000", "WATCHDOG_PID": "1"}],
)
def test_a_watchdog_that_is_not_ours_is_not_fed(supervisor: Supervisor, environment: dict[str, str]) -> None:
    with closing(Notifier({**supervisor.environment, **environment})) as notifier:
        assert fed(notifier, supervisor, [(float(n), n, True) for n in range(5)]) == []


def test_without_a_supervisor_or_with_one_that_has_gone_nothing_happens(tmp_path: Path) -> None:
    gone = Supervisor(str(tmp_path / "gone"))
    for environment in ({}, {"NOTIFY_SOCKET": ""}, {"NOTIFY_SOCKET": str(tmp_path / "never")}, gone.environment):
        gone.close()
        with closing(Notifier({**environment, "WATCHDOG_USEC": "1000000"})) as notifier:
            notifier.ready("standby")
            notifier.feed(0.0, 1, due=True)
            notifier.stopping("released")


def test_a_supervisor_that_does_not_listen_never_stops_us(supervisor: Supervisor) -> None:
    with closing(Notifier(supervisor.environment)) as notifier:
        for n in range(5000):
            notifier.status(str(n))
        assert len(supervisor.heard()) < 5000


# --- the operating system -------------------------------------------------------------------------------------------


def test_nothing_is_asked_for_by_default() -> None:
    assert prepare_process(ServiceSection()) == []
    assert os.sched_getscheduler(0) == os.SCHED_OTHER


ASK = """
import os, resource, sys
from companion.config.service import ServiceSection
from companion.flight.host.service import prepare_process
if "limited" in sys.argv:
    resource.setrlimit(resource.RLIMIT_RTPRIO, (0, 0))
    resource.setrlimit(resource.RLIMIT_MEMLOCK, (8 << 20, 8 << 20))
    os.setgroups([]) if os.getuid() == 0 else None
    os.setuid(65534) if os.getuid() == 0 else None
print(*prepare_process(ServiceSection(realtime_priority=10, lock_memory=True)), sep="\\n")
print(os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK == os.SCHED_FIFO)
print(next(line for line in open("/proc/self/status") if line.startswith("VmLck")).split()[1])
child = os.fork()
if child == 0:
    os._exit(os.sched_getscheduler(0))
print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == os.SCHED_OTHER)
"""


def asked(*arguments: str) -> list[str]:
    """In a process of its own: what it is granted would stay with the tests."""
    done = subprocess.run([sys.executable, "-c", ASK, *arguments], capture_output=True, text=True, check=True)
    return done.stdout.splitlines()


def test_what_is_asked_for_is_granted_or_named() -> None:
    scheduled, locked, is_fifo, locked_kib, child_is_ordinary = asked()
    assert scheduled.startswith(("granted: SCHED_FIFO 10", "not granted: SCHED_FIFO 10 ("))
    assert locked.startswith(("granted: memory locked", "not granted: memory lock ("))
    assert (is_fifo == "True") == scheduled.startswith("granted")
    assert (int(locked_kib) > 10_000) == locked.startswith("granted")
    assert child_is_ordinary == "True"


def test_without_permission_both_are_refused_in_plain_words() -> None:
    scheduled, locked, is_fifo, locked_kib, _ = asked("limited")
    assert scheduled == ("not granted: SCHED_FIFO 10 (Operation not permitted): raise LimitRTPRIO or give CAP_SYS_NICE")
    assert locked == "not granted: memory lock (the limit is 8 MiB): set LimitMEMLOCK=infinity"
    assert (is_fifo, locked_kib) == ("False", "0")


# --- the unit -------------------------------------------------------------------------------------------------------


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="no systemd-analyze here")
def test_systemd_has_nothing_to_say_against_the_unit(tmp_path: Path) -> None:
    here = tmp_path / "companion.service"
    here.write_text(UNIT.read_text().replace("/opt/companion/bin/companion", sys.executable))
    done = subprocess.run(["systemd-analyze", "verify", str(here)], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr.strip()) == (0, "")


def test_the_unit_starts_what_the_command_line_knows() -> None:
    settings = dict(line.split("=", 1) for line in UNIT.read_text().splitlines() if "=" in line and line[0] != "#")
    program, *arguments = settings["ExecStart"].split()
    assert program.endswith("/companion")
    module, _ = read_command_line(arguments)
    assert module is run
    assert settings["Type"] == "notify"
    assert settings["Restart"] == "always"
    assert "--engage" not in arguments
