"""`companion identify` on a large ULog beside plain `pyulog.ULog(path)`: seconds and peak memory, in one run.

python benchmarks/identification_reading.py [LOG.ulg] [--megabytes N] [--rounds N]

Without a log the full recording beside the clone is taken, or the cut under tests/data; it is flown again and again,
its time running on, until the file has the size wanted. Each reading is a process of its own, the two in turns.
"""

from __future__ import annotations

import argparse
import lzma
import os
import statistics
import struct
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
FULL = ROOT.parent / "shared" / "data" / "px4_sih_attitude_p4.ulg"
CUT = ROOT / "tests" / "data" / "px4_sih_attitude_p4.ulg.xz"
MOST_S, MOST_MB = 3.0, 300.0
COMMANDS = {
    "pyulog": [sys.executable, "-c", "import sys; from pyulog import ULog; ULog(sys.argv[1])"],
    "identify": [sys.executable, "-m", "companion", "identify", "--json"],
}


def grown(data: bytes, size: int) -> bytes:
    """The log with its data repeated, stamps running on, to at least a size in bytes."""
    messages, at = [], 16
    while at + 3 <= len(data):
        length, kind = struct.unpack_from("<HB", data, at)
        messages.append((kind, data[at : at + 3 + length]))
        at += 3 + length
    samples = [raw for kind, raw in messages if kind == ord("D")]
    stamps = [struct.unpack_from("<Q", raw, 5)[0] for raw in samples]
    length_us = max(stamps) - min(stamps) + 1_000_000
    parts, total, times = [data], len(data), 0
    while total < size:
        times += 1
        for raw, stamp in zip(samples, stamps, strict=True):
            parts.append(raw[:5] + struct.pack("<Q", stamp + times * length_us) + raw[13:])
        total += sum(map(len, samples))
    return b"".join(parts)


def measured(command: list[str], log: Path) -> tuple[float, float, float]:
    """Seconds, seconds of CPU and peak memory in MB of a process."""
    began = time.perf_counter()
    process = subprocess.Popen([*command, str(log)], stdout=subprocess.DEVNULL, cwd=ROOT)
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f"{command}: exit {process.returncode}")
    return time.perf_counter() - began, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024.0


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("log", type=Path, nargs="?")
    parser.add_argument("--megabytes", type=float, default=30.0)
    parser.add_argument("--rounds", type=int, default=3)
    arguments = parser.parse_args()
    source = arguments.log or (FULL if FULL.exists() else CUT)
    data = source.read_bytes()
    data = lzma.decompress(data) if source.suffix == ".xz" else data
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "grown.ulg"
        log.write_bytes(grown(data, round(1e6 * arguments.megabytes)))
        print(f"{source.name}, grown to {log.stat().st_size / 1e6:.1f} MB; {arguments.rounds} rounds, medians")
        found = {name: [] for name in COMMANDS}
        for _ in range(arguments.rounds):
            for name, command in COMMANDS.items():
                found[name].append(measured(command, log))
    medians = {name: [statistics.median(column) for column in zip(*rows, strict=True)] for name, rows in found.items()}
    for name, (seconds, cpu_s, megabytes) in medians.items():
        print(f"{name:9s} {seconds:6.2f} s, {cpu_s:5.2f} s of CPU, {megabytes:5.0f} MB")
    more_s, more_cpu_s, more_mb = (
        own - library for own, library in zip(medians["identify"], medians["pyulog"], strict=True)
    )
    kept = more_s <= MOST_S and more_mb <= MOST_MB
    print(
        f"beyond the library's own reading: {more_s:+.2f} s (at most {MOST_S:g}), {more_cpu_s:+.2f} s of CPU, "
        f"{more_mb:+.0f} MB (at most {MOST_MB:g}): {'kept' if kept else 'missed'}"
    )
    sys.exit(not kept)


if __name__ == "__main__":
    main()
