"""What a supervisor and the operating system are told and asked: sd_notify, a real-time priority, memory that stays.

Source: sd_notify(3), sched(7), mlockall(2).
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import resource
import socket
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from companion.config.service import ServiceSection

_MCL_CURRENT: Final = 1
_MCL_FUTURE: Final = 2
_CAP_IPC_LOCK: Final = 14
_FED_PER_TIMEOUT: Final = 3.0


class Notifier:
    """Tells the supervisor that started us how we are; silent where there is none.

    `environment` is where it left its address: NOTIFY_SOCKET, WATCHDOG_USEC, WATCHDOG_PID.
    """

    def __init__(self, environment: Mapping[str, str] = os.environ) -> None:
        self._socket: socket.socket | None = None
        self._said = ""
        self._ready = False
        self._progress = -1
        self._next_s = 0.0
        self.watchdog_s = _watchdog_s(environment)
        address = environment.get("NOTIFY_SOCKET", "")
        if address[:1] in ("/", "@"):
            self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK | socket.SOCK_CLOEXEC)
            with contextlib.suppress(OSError):  # it has gone: then nobody wants to know
                self._socket.connect(address.replace("@", "\0", 1) if address[0] == "@" else address)

    def ready(self, status: str) -> None:
        """The start is over, the first time this is said; later only the status changes."""
        if not self._ready:
            self._ready = True
            self._send("READY=1")
        self.status(status)

    def status(self, status: str) -> None:
        """One line for whoever asks, sent when it has changed."""
        if status != self._said:
            self._said = status
            self._send(f"STATUS={status}")

    def feed(self, now_s: float, ticks: int, *, due: bool) -> None:
        """Feed the watchdog, thrice within its time; not where ticks are due and none has come since the last time.

        `ticks` counts what must go on; `due` is whether it must, which before any odometry it need not.
        """
        if self.watchdog_s <= 0.0 or now_s < self._next_s or (due and ticks == self._progress):
            return
        self._next_s = now_s + self.watchdog_s / _FED_PER_TIMEOUT
        self._progress = ticks
        self._send("WATCHDOG=1")

    def stopping(self, status: str) -> None:
        """The end has begun, and why."""
        self._send("STOPPING=1")
        self.status(status)

    def close(self) -> None:
        """Say nothing more."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _send(self, text: str) -> None:
        if self._socket is not None:
            with contextlib.suppress(OSError):  # a supervisor that does not listen must not stop a flight
                self._socket.send(text.encode())


def _watchdog_s(environment: Mapping[str, str]) -> float:
    """Within which time the watchdog wants to be fed; zero for no watchdog, or one that is not ours."""
    try:
        if int(environment.get("WATCHDOG_PID", os.getpid())) != os.getpid():
            return 0.0
        return int(environment.get("WATCHDOG_USEC", "0")) * 1e-6
    except ValueError:
        return 0.0


def prepare_process(service: ServiceSection) -> list[str]:
    """Ask for what the config wants of the operating system; a line for each, granted or not.

    To be called in the loop's own thread. Nothing of it is needed to fly: it takes the rare long ticks away.
    """
    lines = []
    if service.realtime_priority:
        lines.append(_run_in_real_time(service.realtime_priority))
    if service.lock_memory:
        lines.append(_lock_memory())
    return lines


def _run_in_real_time(priority: int) -> str:
    try:
        # Children and threads start at ordinary priority: the log's writer and the terminal must not starve others.
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(priority))
    except OSError as error:
        return f"not granted: SCHED_FIFO {priority} ({error.strerror}): raise LimitRTPRIO or give CAP_SYS_NICE"
    return f"granted: SCHED_FIFO {priority}"


def _lock_memory() -> str:
    soft, hard = resource.getrlimit(resource.RLIMIT_MEMLOCK)
    if soft != hard:
        resource.setrlimit(resource.RLIMIT_MEMLOCK, (hard, hard))
    if hard != resource.RLIM_INFINITY and not _has_capability(_CAP_IPC_LOCK):
        # Locked up to a limit, the allocation that passes it would fail in flight.
        return f"not granted: memory lock (the limit is {hard >> 20} MiB): set LimitMEMLOCK=infinity"
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.mlockall(_MCL_CURRENT | _MCL_FUTURE) != 0:
        return f"not granted: memory lock ({os.strerror(ctypes.get_errno())})"
    return "granted: memory locked"


def _has_capability(number: int) -> bool:
    try:
        lines = Path("/proc/self/status").read_bytes().splitlines()
    except OSError:
        return False
    effective = next((int(line.split()[1], 16) for line in lines if line.startswith(b"CapEff:")), 0)
    return bool(effective >> number & 1)
