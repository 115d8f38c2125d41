"""Cut the doublets out of the full recordings of a real PX4, for tests of the identification.

    python tests/data/cut_attitude.py FOLDER

FOLDER holds the recordings; what is cut stands beside this script, compressed. A ULog keeps its set-points as they are,
every fourth attitude, and the topics that say what the vehicle was doing; a tlog the set-points sent, and every second
attitude and fourth ATTITUDE_TARGET that came back.
"""

from __future__ import annotations

import lzma
import struct
import sys
from collections import Counter
from pathlib import Path

from pyulog import ULog

from companion.identify.ulog import GAINS, TOPICS

HERE = Path(__file__).resolve().parent
ULOGS = {"px4_sih_attitude_p4.ulg": (18.0, 62.0), "px4_sih_attitude_p3.ulg": (19.0, 63.5)}  # vehicle's time, s
EVERY = {"vehicle_attitude": 4}
TLOG = "px4_sih_attitude_p3.tlog"
DOUBLETS = "px4_sih_doublets_p3.tlog.xz"
WINDOW_S = (13.0, 58.0)  # since the first record
MESSAGES = {0: 1, 436: 1, 82: 1, 31: 2, 83: 4}  # HEARTBEAT, CURRENT_MODE, set-points, ATTITUDE_QUATERNION, _TARGET


def cut_ulog(source: Path, output: Path, window_s: tuple[float, float]) -> None:
    log = ULog(str(source), list(TOPICS))
    first, last = (round(1e6 * t) for t in window_s)
    for topic in log.data_list:
        stamps = topic.data["timestamp"]
        keep = (stamps >= first) & (stamps < last)
        topic.data = {field: values[keep][:: EVERY.get(topic.name, 1)] for field, values in topic.data.items()}
    for name in set(log.initial_parameters) - set(GAINS):
        del log.initial_parameters[name]
    for more in (log.changed_parameters, log.logged_messages, log.msg_info_multiple_dict):
        more.clear()
    plain = output.with_suffix("")
    log.write_ulog(str(plain))
    output.write_bytes(lzma.compress(plain.read_bytes(), preset=9 | lzma.PRESET_EXTREME))
    plain.unlink()


def cut_tlog(data: bytes) -> bytes:
    at, first, kept = 0, None, bytearray()
    seen: Counter[int] = Counter()
    while at < len(data):
        (time_us,) = struct.unpack_from(">Q", data, at)
        first = time_us if first is None else first
        end = at + 8 + 12 + data[at + 9]
        number = data[at + 15] | data[at + 16] << 8 | data[at + 17] << 16
        if number in MESSAGES and WINDOW_S[0] <= (time_us - first) * 1e-6 < WINDOW_S[1]:
            if seen[number] % MESSAGES[number] == 0:
                kept += data[at:end]
            seen[number] += 1
        at = end
    return bytes(kept)


def main(folder: Path) -> None:
    """Cut all of them."""
    for name, window_s in ULOGS.items():
        cut_ulog(folder / name, HERE / f"{name}.xz", window_s)
    cut = cut_tlog((folder / TLOG).read_bytes())
    (HERE / DOUBLETS).write_bytes(lzma.compress(cut, preset=9 | lzma.PRESET_EXTREME))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
