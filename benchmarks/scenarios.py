"""How long all scenarios take, this checkout and another one in turn.

python benchmarks/scenarios.py --baseline DIR [--rounds N] [NAME ...]

Each round runs `companion sitl --scenarios` first with the code of DIR, then with this one, so that a machine that does
other things meanwhile slows both. Printed are the wall times of each round, their ratio, and the ratio of the medians.
Exit code 1 where a scenario fails or the ratio of the medians is above a third.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from baseline import checkout

HERE = Path(__file__).resolve().parents[1]
TARGET = 1.0 / 3.0


def run(tree: Path, names: list[str]) -> tuple[float, int, list[str]]:
    """Wall time in s, how many scenarios passed, and the names of those that did not."""
    command = [sys.executable, "-m", "companion", "sitl", "--scenarios", *names, "--json"]
    with tempfile.TemporaryDirectory() as scratch:
        began_s = time.monotonic()
        ended = subprocess.run(
            command,
            cwd=scratch,
            env={**os.environ, "PYTHONPATH": str(tree)},
            capture_output=True,
            text=True,
            check=False,
        )
        wall_s = time.monotonic() - began_s
    if not ended.stdout:
        sys.exit(f"{tree}: {ended.stderr.strip()}")
    report = json.loads(ended.stdout)
    return wall_s, report["passed"], [one["name"] for one in report["scenarios"] if not one["passed"]]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--baseline", type=checkout, required=True, help="another checkout of this project")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("names", nargs="*", help="scenarios, * and ? allowed; all by default")
    arguments = parser.parse_args()
    before_s: list[float] = []
    after_s: list[float] = []
    failures = 0
    print(f"{'round':>5} {'baseline, s':>12} {'this, s':>9} {'ratio':>7}  passed (baseline, this)")
    for index in range(arguments.rounds):
        theirs_s, theirs, _ = run(arguments.baseline, arguments.names)
        ours_s, ours, failed = run(HERE, arguments.names)
        before_s.append(theirs_s)
        after_s.append(ours_s)
        failures += len(failed)
        print(
            f"{index + 1:5} {theirs_s:12.1f} {ours_s:9.1f} {ours_s / theirs_s:7.3f}  {theirs}, {ours}"
            + (f"  FAILED: {', '.join(failed)}" if failed else ""),
            flush=True,
        )
    ratio = statistics.median(after_s) / statistics.median(before_s)
    met = "met" if ratio <= TARGET else "missed"
    print(f"ratio of the medians {ratio:.3f}, target {TARGET:.3f}: {met}")
    return 1 if failures or ratio > TARGET else 0


if __name__ == "__main__":
    sys.exit(main())
