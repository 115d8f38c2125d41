"""Flights of two checkouts, message by message: does the same config still leave the same bytes?

python benchmarks/same_flights.py --baseline DIR [CONFIG ...]

Each config is flown in lockstep by this tree and by the one in DIR, hedged and standard. Compared are
the data of every message of `flight.mcap`, and every frame of `traffic.tlog` from the first sample on: how many
heartbeats came before it, while time stood still, was chance up to 9cadbff. Exit code 1 where they differ.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import struct
import subprocess
import sys
import tempfile
from pathlib import Path

from baseline import checkout
from mcap.reader import make_reader

HERE = Path(__file__).resolve().parents[1]
CONFIGS = ("antx_rig", "paper_quadrotor", "px4_quadrotor")
CONTROLLERS = ("hedged", "standard")


def fly(tree: Path, config: str, folder: Path) -> None:
    """Fly a config with the code of a tree; the companion's own words where that fails."""
    command = [sys.executable, "-m", "companion", "sitl", str(HERE / "config" / f"{config}.yaml"), "--out", str(folder)]
    environment = {**os.environ, "PYTHONPATH": str(tree)}
    ended = subprocess.run(command, cwd=tree, env=environment, capture_output=True, text=True, check=False)
    if ended.returncode:
        sys.exit(f"{tree}: {config}: {ended.stderr.strip() or ended.stdout.strip()}")


def messages(folder: Path) -> list[tuple[str, bytes]]:
    """(topic, data) of every message, in the order of the file."""
    with (folder / "flight.mcap").open("rb") as stream:
        return [
            (channel.topic, message.data)
            for _, channel, message in make_reader(stream).iter_messages(log_time_order=False)
        ]


def traffic(folder: Path) -> list[tuple[int, bytes]]:
    """(time in microseconds, frame) of every record of `traffic.tlog` that is later than zero."""
    data, at = (folder / "traffic.tlog").read_bytes(), 0
    frames = []
    while at < len(data):
        (time_us,) = struct.unpack_from(">Q", data, at)
        length = data[at + 9] + 12 + (13 if data[at + 10] & 1 else 0)  # MAVLink 2: header, payload, checksum, signature
        if time_us:
            frames.append((time_us, data[at + 8 : at + 8 + length]))
        at += 8 + length
    return frames


def first_difference(ours: list[tuple[str, bytes]], theirs: list[tuple[str, bytes]]) -> str | None:
    """Where two flights part, in a few words; None where they do not."""
    for place, (a, b) in enumerate(zip(ours, theirs, strict=False)):
        if a != b:
            return f"message {place}: {a[0]} {a[1][:80]!r} / {b[0]} {b[1][:80]!r}"
    return None if len(ours) == len(theirs) else f"{len(ours)} / {len(theirs)} messages"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--baseline", type=checkout, required=True, help="another checkout of this project")
    parser.add_argument("configs", nargs="*", default=CONFIGS)
    arguments = parser.parse_args()
    same = True
    for config in arguments.configs:
        with tempfile.TemporaryDirectory() as scratch:
            folders = [Path(scratch, name) for name in ("ours", "theirs")]
            for tree, folder in zip((HERE, arguments.baseline), folders, strict=True):
                fly(tree, config, folder)
            for controller in CONTROLLERS:
                ours, theirs = (folder / controller for folder in folders)
                ours_flown = messages(ours)
                difference = first_difference(ours_flown, messages(theirs))
                if difference is None and traffic(ours) != traffic(theirs):
                    difference = "traffic.tlog"
                digest = hashlib.sha256(b"".join(data for _, data in ours_flown)).hexdigest()[:16]
                verdict = "the same" if difference is None else f"DIFFERENT: {difference}"
                print(f"{config:16} {controller:9} {len(ours_flown):6} messages  {digest}  {verdict}", flush=True)
                same = same and difference is None
    return 0 if same else 1


if __name__ == "__main__":
    sys.exit(main())
