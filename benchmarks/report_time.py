"""How long `companion report` takes and how large its page is, for a flight repeated until it lasts long.

python benchmarks/report_time.py FLIGHT [--minutes 30]
"""

from __future__ import annotations

import argparse
import io
import shutil
import struct
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from companion.record import schema
from companion.record.reader import read_flight
from companion.record.recorder import EVENT, TICK
from companion.record.writer import write_records


def lengthened(source: Path, folder: Path, minutes: float) -> int:
    """Write the flight over and over. Returns its ticks."""
    flight = read_flight(source)
    ticks = flight.ticks
    passed_s = ticks["time_s"][-1] - ticks["time_s"][0] + 0.008
    times = max(1, round(60 * minutes / passed_s))
    engaged = next(event for event in flight.events if event.name == "engaged")
    first_engaged = int(np.flatnonzero(ticks["state"] == 3)[0])
    offset_s = engaged.time_s - ticks["time_s"][first_engaged]

    def records():
        yield EVENT, round(1e6 * engaged.time_s), schema.pack_event("engaged", engaged.detail)
        for k in range(times):
            part = ticks[first_engaged if k else 0 :].copy()
            part["time_s"] += k * passed_s
            for row in part:
                yield TICK, round(1e6 * (float(row["time_s"]) + offset_s)), schema.CDR_HEADER + row.tobytes()

    folder.mkdir()
    write_records(folder, records())
    shutil.copy(source / "config.yaml", folder / "config.yaml")
    record = struct.Struct(">Q")
    data = (source / "traffic.tlog").read_bytes()
    out = io.BytesIO()
    for k in range(times):
        at = 0
        while at + 20 <= len(data) and data[at + 8] == 0xFD:
            end = at + 8 + data[at + 9] + 12 + 13 * (data[at + 10] & 1)
            (time_us,) = record.unpack_from(data, at)
            out.write(record.pack(time_us + round(1e6 * k * passed_s)) + data[at + 8 : end])
            at = end
    (folder / "traffic.tlog").write_bytes(out.getvalue())
    return len(ticks) * times


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("flight", type=Path)
    parser.add_argument("--minutes", type=float, default=30.0)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder, out = Path(temporary) / "long", Path(temporary) / "page.html"
        ticks = lengthened(arguments.flight, folder, arguments.minutes)
        began = time.perf_counter()
        subprocess.run([sys.executable, "-m", "companion", "report", str(folder), "--out", str(out)], check=True)
        print(f"{ticks} ticks: {time.perf_counter() - began:.2f} s, {out.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
