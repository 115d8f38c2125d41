"""A flight under hostile inputs, over UDP with and without a key, and over a serial line: nothing comes of them.

The benchmark throws a million; here it is as many as a test has time for, and no time is asserted.
"""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

BENCHMARK = Path(__file__).resolve().parents[2] / "benchmarks" / "hostile.py"
INPUTS = {"udp": 8_000, "signed": 6_000, "serial": 1_500}


@pytest.mark.realtime
@pytest.mark.parametrize("kind", INPUTS)
def test_hostile_inputs_do_nothing_to_a_flight(kind: str) -> None:
    command = [sys.executable, str(BENCHMARK), "--json", "--only", kind, "--inputs", str(INPUTS[kind])]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stderr
    (flight,) = json.loads(done.stdout)["flights"]
    assert flight["inputs"] == INPUTS[kind]
    assert flight["ended_well"], flight
    assert flight["reason"] == "released_mode_changed"  # by its pilot, at the end
    assert flight["setpoints"] > 200
    assert flight["invalid"] == 0
    assert flight["refused"] > 0 or kind == "signed"  # commands of somebody who may steer, but not there
    refused = {name: int(number) for number, name in re.findall(r"(\d+) (\w+)", flight["traffic"])}
    wanted = {"foreign", "bad_crc", "unknown"} | (
        {"unsigned", "bad_signature", "replayed"} if kind == "signed" else set()
    )
    assert all(refused[name] > INPUTS[kind] // 50 for name in wanted), flight["traffic"]
