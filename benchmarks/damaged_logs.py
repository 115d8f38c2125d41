"""Thousands of damaged logs through `identify`: no traceback, no hang, bounded memory, no number that is not so.

python benchmarks/damaged_logs.py --inputs 1000 [--seed 0] [--keep FOLDER]

Each input is a log of a real PX4 (tests/data) with a damage of one kind at random (tests/harness/damaged_logs.py), and
is read in a process of its own. It may take 5 s of CPU and 500 MB, and ends with numbers that agree with those of the
undamaged log within their intervals, or with one line. About 0.4 s of CPU an input.
"""

from __future__ import annotations

import argparse
import lzma
import os
import signal
import sys
import tempfile
import time
import traceback
from collections import Counter
from pathlib import Path
from random import Random

import harness_path  # noqa: F401 - finds `harness`
from harness.damaged_logs import OF_TLOG, OF_ULOG
from harness.identified import complaints, outcome

from companion.identify.identification import Identification

DATA = Path(__file__).resolve().parents[1] / "tests" / "data"
SOURCES = {"px4_sih_attitude_p4.ulg": OF_ULOG, "px4_sih_doublets_p3.tlog": OF_TLOG}
MOST_CPU_S, MOST_MB, MOST_S = 5.0, 500.0, 120.0


def judged(path: Path, clean: Identification) -> tuple[str, list[str], float, float]:
    """How it ended, what is wrong, seconds of CPU and peak memory in MB: read in a process of its own."""
    into, out = os.pipe()
    child = os.fork()
    if not child:
        try:
            signal.alarm(round(MOST_S))
            found = outcome(path)
            wrong = complaints(path, found, clean)
            kind = "refused" if isinstance(found, str) else ("read, with a note" if found.notes else "read")
        except BaseException:  # whatever it is, it is what this looks for
            kind, wrong = "raised", [traceback.format_exc(limit=-2)]
        os.write(out, "\0".join([kind, *wrong]).encode()[:60_000])
        os._exit(0)
    os.close(out)
    with os.fdopen(into, "rb") as stream:
        kind, *wrong = stream.read().decode().split("\0")
    _, status, usage = os.wait4(child, 0)
    if status:
        kind, wrong = "hung or killed", [f"status {status}"]
    return kind, wrong, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024.0


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--inputs", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--keep", type=Path, help="where inputs that fail are left")
    arguments = parser.parse_args()
    began, failed = time.perf_counter(), 0
    ended: Counter[tuple[str, str]] = Counter()
    slowest, largest = 0.0, 0.0
    with tempfile.TemporaryDirectory() as folder:
        wholes = {name: lzma.decompress((DATA / f"{name}.xz").read_bytes()) for name in SOURCES}
        cleans = {}
        for name, data in wholes.items():
            (Path(folder) / name).write_bytes(data)
            clean = outcome(Path(folder) / name)
            assert isinstance(clean, Identification), clean
            cleans[name] = clean
        kinds = [(name, damage) for name, damages in SOURCES.items() for damage in damages]
        for i in range(arguments.inputs):
            name, damage = kinds[i % len(kinds)]
            path = Path(folder) / f"damaged{Path(name).suffix}"
            path.write_bytes(damage(wholes[name], Random(f"{arguments.seed} {i}")))
            kind, wrong, cpu_s, megabytes = judged(path, cleans[name])
            if cpu_s > MOST_CPU_S or megabytes > MOST_MB:
                wrong.append(f"{cpu_s:.1f} s of CPU, {megabytes:.0f} MB")
            ended[f"{Path(name).suffix[1:]} {damage.__name__}", kind] += 1
            slowest, largest = max(slowest, cpu_s), max(largest, megabytes)
            if wrong:
                failed += 1
                print(f"input {i}, seed {arguments.seed}, {name}, {damage.__name__}: {kind}: {'; '.join(wrong)}")
                if arguments.keep is not None:
                    (arguments.keep / f"{arguments.seed}_{i}_{damage.__name__}{path.suffix}").write_bytes(
                        path.read_bytes()
                    )
    for what in sorted({what for what, _ in ended}):
        print(f"{what:22s}", ", ".join(f"{kind} {n}" for (of, kind), n in sorted(ended.items()) if of == what))
    print(
        f"{arguments.inputs} inputs, {failed} failed; most {slowest:.2f} s of CPU and {largest:.0f} MB; "
        f"{time.perf_counter() - began:.0f} s"
    )
    sys.exit(bool(failed))


if __name__ == "__main__":
    main()
