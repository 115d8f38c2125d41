"""A figure of eight from a file, and the same streamed by a planner: what the stream costs.

    python benchmarks/planner_stream.py [--speed M_S] [--rate HZ] [--jitter S] [--loss SHARE] [--seeds N]

The plant of config/trajectories.yaml in lockstep, hedged. The planner sends SET_POSITION_TARGET_LOCAL_NED at its rate,
stamped with its own clock; each sample takes up to `--jitter` longer than the quickest. `--velocity-only` leaves out
accelerations. Errors are horizontal distances from where the trajectory is at that time by the planner's clock, by the
truth. Beside them, what the vehicle would fly late by if it waited for the sample after each instant, to interpolate.
"""

from __future__ import annotations

import argparse
import math
import tempfile
from pathlib import Path
from typing import Final

import harness_path  # noqa: F401
from harness.planner import PlannerLink, fly_streamed

from companion.commands.missions import overrides
from companion.config import load_config
from companion.control.types import PositionSetpoint
from companion.flight.pilot.mission import TrajectoryMission
from companion.record.reader import read_flight
from sitl.experiment import against

CONFIG: Final = Path(__file__).resolve().parents[1] / "config" / "trajectories.yaml"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--speed", type=float, default=2.0)
    parser.add_argument("--rate", type=float, default=20.0)
    parser.add_argument("--jitter", type=float, default=0.03)
    parser.add_argument("--loss", type=float, default=0.0)
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--velocity-only", action="store_true")
    options = parser.parse_args()
    (mission,) = overrides("lemniscate", options.speed, stretch=False, identify=False)
    link = PlannerLink(options.rate, options.jitter, options.loss, options.velocity_only)
    with tempfile.TemporaryDirectory() as name:
        file = against.fly_against(load_config(CONFIG, (mission,)), CONFIG, Path(name) / "file", "hedged").scores
        assert isinstance(file, against.PathScores)
        print(f"file: RMS {file.truth_rms_m:.4f} m, peak {file.truth_peak_m:.4f} m")
        for seed in range(options.seeds):
            folder = Path(name) / f"stream{seed}"
            stream, reason = fly_streamed(CONFIG, mission, link, seed, folder)
            refused = sum(event.name == "command_refused" for event in read_flight(folder).events)
            print(
                f"stream, {link.rate_hz:g} Hz, up to {1e3 * link.jitter_s:g} ms late: RMS {stream.truth_rms_m:.4f} m, "
                f"{100.0 * (stream.truth_rms_m / file.truth_rms_m - 1.0):+.1f} %, peak {stream.truth_peak_m:.4f} m; "
                f"{reason}, {refused} refusals told"
            )
    wait_s = 1.0 / link.rate_hz + link.jitter_s
    late_m = lateness_m(mission, wait_s)
    print(f"to wait {1e3 * wait_s:.0f} ms for the next sample and interpolate is {late_m:.3f} m late (RMS)")


def lateness_m(mission: str, late_s: float) -> float:
    """RMS distance between where a mission is and where it was so long before, while it moves."""
    course, origin = TrajectoryMission(load_config(CONFIG, (mission,))), PositionSetpoint(0.0, 0.0, 0.0, 0.0)
    course.begin(origin)
    squares, now_s = [], 0.0
    while not course.over(now_s):
        here, moving = course.wanted(now_s, origin)
        if moving is not None and math.hypot(*moving[3:6]) > 0.0:
            squares.append(math.dist(here[:2], course.wanted(now_s - late_s, origin)[0][:2]) ** 2)
        now_s += 0.02
    return math.sqrt(sum(squares) / len(squares))


if __name__ == "__main__":
    main()
