"""A figure of eight from a file, and the same streamed by a planner: what the stream costs.

    python benchmarks/planner_stream.py [--speed M_S] [--rate HZ] [--jitter S] [--loss SHARE] [--seeds N]

The plant of config/trajectories.yaml in lockstep, hedged. The planner sends SET_POSITION_TARGET_LOCAL_NED at its rate,
stamped with its own clock; each sample takes up to `--jitter` longer than the quickest. Errors are horizontal distances
from where the trajectory is at that time by the planner's clock, by the truth. Beside them, what the vehicle would
fly late by if it waited for the sample after each instant, to interpolate.
"""

from __future__ import annotations

import argparse
import math
import random
import tempfile
from pathlib import Path
from typing import Final

import numpy as np
from pymavlink.dialects.v20 import development as mavlink

from companion.commands.missions import overrides
from companion.config import Config, load_config
from companion.control.types import PositionSetpoint
from companion.flight.pilot.mission import TrajectoryMission
from companion.flight.process import FlightProcess
from companion.record.folder import open_folder
from companion.record.reader import read_flight
from sitl.build import World, build_world
from sitl.experiment import against
from sitl.wire.impairments import Channel
from sitl.wire.memory import LockstepLink
from sitl.wire.wire import Channels

CONFIG: Final = Path(__file__).resolve().parents[1] / "config" / "trajectories.yaml"
PLANNER: Final = (250, 190)
_CLOCK_MS: Final = 123_456_789  # of the planner, where the vehicle's is zero
_STEP_US: Final = 4000
_MASK: Final = 0xC00  # neither yaw nor yaw rate
_NO_ACCELERATION: Final = 0x1C0
_FENCE: Final = "{enabled: true, radius_m: 9, lower_ned_m: [-9, -9, -4], upper_ned_m: [9, 9, 4]}"


class Planner:
    """Streams a mission once OFFBOARD has begun."""

    def __init__(
        self,
        config: Config,
        world: World,
        channels: Channels,
        watch: against._Watch,
        options: argparse.Namespace,
        seed: int,
    ) -> None:
        self._mission = TrajectoryMission(config)
        self._watch, self._channels, self._options = watch, channels, options
        self._random = random.Random(seed)
        self._origin: PositionSetpoint | None = None
        self._next_us = 0
        self._due: list[tuple[int, bytes]] = []
        self._packer = mavlink.MAVLink(None, srcSystem=PLANNER[0], srcComponent=PLANNER[1])
        self._before = world.autopilot.on_control
        world.autopilot.on_control = self._on_control

    def _on_control(self, now_us: int) -> None:
        if self._before is not None:
            self._before(now_us)
        watch, options = self._watch, self._options
        if watch.engaged_us is not None and watch.rows:
            if self._origin is None:
                first = watch.rows[0]
                self._origin = PositionSetpoint(first[3], first[4], first[6], first[7])
                self._mission.begin(self._origin)
                self._next_us = now_us
            if now_us >= self._next_us:
                self._next_us += round(1e6 / options.rate)
                at_us = now_us - self._random.randrange(_STEP_US)  # its clock knows nothing of the plant's steps
                elapsed_s = max(1e-6 * (at_us - watch.engaged_us), 0.0)
                if self._random.random() >= options.loss and not self._mission.over(elapsed_s):
                    late_us = round(1e6 * options.jitter * self._random.random())
                    self._due.append((now_us + late_us, self._sample(elapsed_s, at_us)))
        for due in sorted(self._due):
            if due[0] <= now_us:
                self._due.remove(due)
                self._channels.down.put(due[1], now_us)

    def _sample(self, elapsed_s: float, at_us: int) -> bytes:
        assert self._origin is not None
        _, at = self._mission.wanted(elapsed_s, self._origin)
        assert at is not None
        mask = _MASK | (_NO_ACCELERATION if self._options.velocity_only else 0)
        message = mavlink.MAVLink_set_position_target_local_ned_message(
            _CLOCK_MS + at_us // 1000, 1, 191, mavlink.MAV_FRAME_LOCAL_NED, mask, *at[:9], 0.0, 0.0
        )
        return bytes(message.pack(self._packer))


def settings(speed_m_s: float) -> str:
    """The figure of eight as `--mission lemniscate --speed` has it."""
    (text,) = overrides("lemniscate", speed_m_s, stretch=False, identify=False)
    return text


def by_file(options: argparse.Namespace, folder: Path) -> against.PathScores:
    """The mission, from the config."""
    scores = against.fly_against(load_config(CONFIG, (settings(options.speed),)), CONFIG, folder, "hedged").scores
    assert isinstance(scores, against.PathScores)
    return scores


def by_stream(options: argparse.Namespace, folder: Path, seed: int) -> against.PathScores:
    """The same, told as it goes."""
    mission = load_config(CONFIG, (settings(options.speed),))
    course = TrajectoryMission(mission)
    course.begin(PositionSetpoint(0.0, 0.0, 0.0, 0.0))
    assert course._course is not None
    flown = load_config(
        CONFIG,
        (
            "mission.trajectories=[]",
            f"mission.duration_s={course._course.duration_s}",
            f"steering={{enabled: true, system_ids: [{PLANNER[0]}]}}",
            f"guards.fence={_FENCE}",
        ),
    )
    world = build_world(flown)
    world.autopilot.start_in_air(against.ALTITUDE_M, against.SETTLE_S)
    watch = against._Watch(world)
    channels = Channels(Channel(random.Random(1)), Channel(random.Random(2)))
    Planner(mission, world, channels, watch, options, seed)
    recorder = open_folder(folder, CONFIG, flown, blocking=True)
    try:
        link = LockstepLink(world.autopilot, channels=channels)
        process = FlightProcess(flown, link, recorder, hedging=True, lockstep=True, wall=link.wall)
        reason = process.run().reason
    finally:
        recorder.close()
    for event in read_flight(folder).events:
        if event.name in ("stream", "stream_ended", "command_refused"):
            print(f"  {event.name}: {event.detail}")
    print(f"  {reason.value}")
    return against.score_path(against.track_of(mission, np.array(watch.rows)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--speed", type=float, default=2.0)
    parser.add_argument("--rate", type=float, default=20.0)
    parser.add_argument("--jitter", type=float, default=0.03)
    parser.add_argument("--loss", type=float, default=0.0)
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--velocity-only", action="store_true")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        file = by_file(options, Path(name) / "file")
        print(f"file: RMS {file.truth_rms_m:.4f} m, peak {file.truth_peak_m:.4f} m")
        for seed in range(options.seeds):
            stream = by_stream(options, Path(name) / f"stream{seed}", seed)
            print(
                f"stream, {options.rate:g} Hz, up to {1e3 * options.jitter:g} ms late: RMS {stream.truth_rms_m:.4f} m, "
                f"{100.0 * (stream.truth_rms_m / file.truth_rms_m - 1.0):+.1f} %, peak {stream.truth_peak_m:.4f} m"
            )
    wait_s = 1.0 / options.rate + options.jitter
    late_m = options.speed * wait_s / math.sqrt(2.0)
    print(f"to wait {1e3 * wait_s:.0f} ms for the next sample and interpolate is about {late_m:.3f} m late (RMS)")


if __name__ == "__main__":
    main()
