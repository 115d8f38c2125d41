"""Cut the errors of a real estimator out of recorded flights with ground truth.

python tests/data/cut_estimator_errors.py RECORDINGS_FOLDER

Estimate less truth (local position and velocity, NED), ten times a second for 53 s from one second after OFFBOARD
began, of every `px4_sih_stairs_*.ulg.xz` there: `px4_sih_estimator_errors.npz`, (flight, sample, x y z vx vy vz).
"""

import lzma
import sys
import tempfile
from pathlib import Path

import numpy as np
from pyulog import ULog

OFFBOARD = 14
FIELDS = ("x", "y", "z", "vx", "vy", "vz")


def errors(packed: Path) -> np.ndarray:
    with tempfile.NamedTemporaryFile(suffix=".ulg") as file:
        file.write(lzma.decompress(packed.read_bytes()))
        file.flush()
        topics = {data.name: data.data for data in ULog(file.name).data_list}
    said, true = topics["vehicle_local_position"], topics["vehicle_local_position_groundtruth"]
    status = topics["vehicle_status"]
    began_us = status["timestamp"][np.argmax(status["nav_state"] == OFFBOARD)]
    at_us = began_us + 1e6 * np.arange(1.0, 54.0, 0.1)
    return np.stack(
        [np.interp(at_us, said["timestamp"], said[f]) - np.interp(at_us, true["timestamp"], true[f]) for f in FIELDS],
        axis=1,
    )


if __name__ == "__main__":
    flights = [errors(path) for path in sorted(Path(sys.argv[1]).glob("px4_sih_stairs_*.ulg.xz"))]
    target = Path(__file__).with_name("px4_sih_estimator_errors.npz")
    np.savez_compressed(target, errors=np.array(flights, dtype=np.float32))
