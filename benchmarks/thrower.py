"""A process that makes hostile inputs and throws them from the vehicle's own socket.

    python benchmarks/thrower.py FD GENUINE --attack mixed --inputs N --seed N

`GENUINE` is a file of signed frames of the vehicle, to be replayed. It answers with the number of datagrams, and then
to each line of a number and a rate on standard input with 0 once so many are out.
"""

from __future__ import annotations

import argparse
import contextlib
import itertools
import os
import random
import select
import subprocess
import sys
import time
from pathlib import Path

from attacker import FLOODS, Attacker, datagrams
from hostile_vehicle import Vehicle

from companion.mavlink.codec import FrameParser

_RATE_HZ = 250.0
_DIFFERENT = 500  # datagrams of a flood
_BURST = 20  # datagrams of a flood between two looks at the clock


class Thrower:
    """A process that throws from the vehicle's own socket, at times that it cannot know. Attribute: `left`."""

    def __init__(self, vehicle: Vehicle, attack: str, inputs: int, seed: int, genuine: Path) -> None:
        fd = vehicle.fileno()
        command = [sys.executable, str(Path(__file__)), str(fd), str(genuine), "--attack", attack]
        command += ["--inputs", str(inputs), "--seed", str(seed)]
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, pass_fds=(fd,), text=True, bufsize=1
        )
        self.left = self.answer(vehicle)

    def answer(self, vehicle: Vehicle) -> int:
        """What it says next, the vehicle flying on meanwhile."""
        assert self._process.stdout is not None
        while not select.select([self._process.stdout], [], [], 0.0)[0]:
            vehicle.play(_RATE_HZ, 0.05)
        return int(self._process.stdout.readline())

    def throw(self, rate_hz: float, seconds: float) -> None:
        """Datagrams for so long at most; it answers when they are out."""
        assert self._process.stdin is not None
        count = min(self.left, max(1, round(rate_hz * seconds)))
        self.left -= count
        self._process.stdin.write(f"{count} {rate_hz}\n")

    def close(self) -> None:
        self._process.kill()
        self._process.communicate()


def throw(fd: int, attack: str, genuine: list[bytes], inputs: int, seed: int) -> None:
    """The thrower's own process."""
    attacker = Attacker(seed, genuine, attack)
    if attack in FLOODS:
        made = itertools.islice(itertools.cycle([attacker.one() for _ in range(_DIFFERENT)]), inputs)
        print(inputs, flush=True)
    else:
        packed = datagrams(attacker, inputs)
        made = iter(packed)
        print(len(packed), flush=True)
    chosen = random.Random(seed)
    for line in sys.stdin:
        count, rate_hz = line.split()
        between_looks = _BURST if attack in FLOODS else 1
        due_s = time.monotonic()
        for n, datagram in enumerate(itertools.islice(made, int(count))):
            due_s += chosen.expovariate(float(rate_hz))
            if not n % between_looks:
                time.sleep(max(0.0, due_s - time.monotonic()))
            with contextlib.suppress(BlockingIOError, ConnectionRefusedError):
                os.write(fd, datagram)
        print(0, flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Throw hostile inputs from a socket that is inherited.")
    parser.add_argument("fd", type=int)
    parser.add_argument("genuine", type=Path)
    parser.add_argument("--attack", required=True)
    parser.add_argument("--inputs", type=int, required=True)
    parser.add_argument("--seed", type=int, required=True)
    given = parser.parse_args()
    frames = [frame.raw for frame in FrameParser(stream=True).feed(given.genuine.read_bytes())]
    throw(given.fd, given.attack, frames, given.inputs, given.seed)
