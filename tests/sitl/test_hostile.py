"""A flight under hostile inputs, over UDP with and without a key, over a serial line, under a recording and in a flood.

The benchmark throws a million; here it is as many as a test has time for, and no time is asserted.
"""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

BENCHMARK = Path(__file__).resolve().parents[2] / "benchmarks" / "hostile.py"
INPUTS = {"udp": 8_000, "signed": 6_000, "serial": 1_500, "replay": 3_000, "flood": 60_000}


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
    refused = {name: int(number) for number, name in re.findall(r"(\d+) (\w+)", flight["traffic"])}
    assert all(refused[name] > INPUTS[kind] // 50 for name in wanted(kind)), flight["traffic"]
    if kind in ("udp", "serial", "flood"):
        assert flight["refused"] > 0  # commands of somebody who may steer, but not there


def wanted(kind: str) -> set[str]:
    """What is to be counted of such inputs."""
    if kind == "replay":
        return {"replayed", "unproven"}
    if kind == "flood":
        return {"foreign"}
    signed = {"unsigned", "bad_signature", "replayed"} if kind == "signed" else set()
    return {"foreign", "bad_crc", "unknown"} | signed
