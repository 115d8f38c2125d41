"""Candidates as processes: started, watched for the line that says they are ready, and how much processor they took."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path
from typing import IO

import harness_path  # noqa: F401 - finds `harness`
from harness.processes import eventually

_TICKS_PER_S = os.sysconf("SC_CLK_TCK")


class Candidate:
    """One running candidate. Its output goes to a file, which no full pipe can stop."""

    def __init__(self, command: list[str], ready: str, output: Path) -> None:
        self._ready = ready
        self._output = output
        with output.open("wb") as stream:
            stdout: IO[bytes] = stream
            environment = {**os.environ, "PYTHONUNBUFFERED": "1"}
            self.process = subprocess.Popen(command, stdout=stdout, stderr=subprocess.STDOUT, env=environment)

    def output(self) -> str:
        return self._output.read_text(errors="replace")

    def is_ready(self) -> bool:
        """Raises `RuntimeError` with its output when it has ended instead."""
        if self.process.poll() is not None:
            raise RuntimeError(f"{self.process.args!r} ended: {self.output().strip()}")
        return any(line.startswith(self._ready) for line in self.output().splitlines())

    def cpu_s(self) -> tuple[float, float]:
        """Processor time so far, of the process itself and of its whole tree."""
        own = processor_time_s(self.process.pid)
        return own, own + sum(processor_time_s(pid) for pid in descendants(self.process.pid))

    def ends(self, timeout_s: float) -> bool:
        """Whether it ends by itself within the time."""
        return eventually(lambda: self.process.poll() is not None, timeout_s)

    def kill(self) -> None:
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()


def processor_time_s(pid: int) -> float:
    """All threads of a process: the scheduler's nanoseconds where the kernel counts them, else utime + stime."""
    try:
        return (
            sum(int((task / "schedstat").read_text().split()[0]) for task in Path(f"/proc/{pid}/task").iterdir()) / 1e9
        )
    except (OSError, IndexError):
        fields = _stat(pid)
        return (int(fields[11]) + int(fields[12])) / _TICKS_PER_S if fields else 0.0


def descendants(pid: int) -> list[int]:
    """Children and theirs, by the parent that each process names."""
    parents = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit() and (fields := _stat(int(entry.name))):
            parents[int(entry.name)] = int(fields[1])
    found = [pid]
    for parent in found:  # grows while it is walked
        found += [child for child, its_parent in parents.items() if its_parent == parent]
    return found[1:]


class OtherWork:
    """How busy the machine is with what is not ours, since this was made: figures from a busy one are no figures."""

    def __init__(self) -> None:
        self._before = self._now()

    def percent(self) -> float:
        """Of all cores; children count as ours once they have ended."""
        all_s, busy_s, ours_s = (now - then for now, then in zip(self._now(), self._before, strict=True))
        return round(max(0.0, 100.0 * (busy_s - ours_s) / all_s), 1) if all_s else 0.0

    @staticmethod
    def _now() -> tuple[float, float, float]:
        user, nice, system, idle, iowait, irq, softirq, steal = (
            int(text) / _TICKS_PER_S for text in Path("/proc/stat").read_text().split()[1:9]
        )
        busy = user + nice + system + irq + softirq + steal
        return busy + idle + iowait, busy, sum(os.times()[:4])


def _stat(pid: int) -> list[str]:
    """Fields of /proc/PID/stat from the state on; none when the process has gone."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return []
