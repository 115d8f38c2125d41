"""`companion run` as a process of its own against the scripted autopilot on a socket, by the wall clock.

For what needs a process: signals, terminals, services. Everything else about flights is in `harness.virtual_flight`.
"""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from harness.fake_autopilot import ScriptedAutopilot
from harness.processes import RIG, Process, start, stop
from harness.virtual_flight import SLOW


class AutopilotOnSocket(ScriptedAutopilot):
    """Served from a thread, once `start` is called, to whoever speaks to its port."""

    def __init__(self) -> None:
        super().__init__()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.setblocking(False)
        self.port: int = self._socket.getsockname()[1]
        self._running = True
        self._thread = threading.Thread(target=self._run, daemon=True)

    def start(self) -> None:
        """Begin to listen and to speak."""
        self._thread.start()

    def close(self) -> None:
        """Fall silent for good."""
        self._running = False
        if self._thread.is_alive():
            self._thread.join()
        self._socket.close()

    def _run(self) -> None:
        peer, began_s, count = None, time.monotonic(), 0
        while self._running:
            try:
                while True:
                    data, peer = self._socket.recvfrom(2048)
                    self.hear(data)
            except BlockingIOError:
                pass
            self.now_s = time.monotonic() - began_s
            if peer is not None:
                for word in self.words():
                    self._socket.sendto(word, peer)
            count += 1
            time.sleep(max(0.0, began_s + self.PERIOD_S * count - time.monotonic()))


@contextmanager
def run_against(tmp_path: Path, *arguments: str, stdout: Any = None) -> Iterator[tuple[AutopilotOnSocket, Process]]:
    """The autopilot, which is still silent, and `companion run`, which waits for it."""
    autopilot = AutopilotOnSocket()
    link = f"udpout://127.0.0.1:{autopilot.port}"
    settings = [part for setting in SLOW for part in ("--set", setting)]
    command = ("run", RIG, "--link", link, "--out", tmp_path, "--uncertified", *settings, *arguments)
    process = start(*command) if stdout is None else start(*command, stdout=stdout)
    try:
        yield autopilot, process
    finally:
        autopilot.close()
        stop(process)
