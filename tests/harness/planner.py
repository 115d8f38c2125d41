"""A planner that streams the mission of a config to a flight in memory, over a link that delays and loses."""

from __future__ import annotations

import random
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from pymavlink.dialects.v20 import development as mavlink

from companion.config import Config, load_config
from companion.control.types import PositionSetpoint
from companion.flight.pilot.mission import TrajectoryMission
from companion.flight.process import FlightProcess
from companion.record.folder import open_folder
from sitl.build import World, build_world
from sitl.experiment import against
from sitl.wire.impairments import Channel
from sitl.wire.memory import LockstepLink
from sitl.wire.wire import Channels

PLANNER: Final = (250, 190)
_CLOCK_MS: Final = 123_456_789  # of the planner, where the vehicle's is zero
_STEP_US: Final = 4000
_MASK: Final = 0xC00  # neither yaw nor yaw rate
_NO_ACCELERATION: Final = 0x1C0
_FENCE: Final = "{enabled: true, radius_m: 9, lower_ned_m: [-9, -9, -4], upper_ned_m: [9, 9, 4]}"


class PlannerLink(NamedTuple):
    """How it streams: each sample takes up to `jitter_s` longer than the quickest; a share is lost."""

    rate_hz: float = 20.0
    jitter_s: float = 0.03
    loss: float = 0.0
    velocity_only: bool = False


class Planner:
    """Streams a mission once OFFBOARD has begun."""

    def __init__(
        self,
        config: Config,
        world: World,
        channels: Channels,
        watch: against._Watch,
        link: PlannerLink,
        seed: int,
    ) -> None:
        self._mission = TrajectoryMission(config)
        self._watch, self._channels, self._link = watch, channels, link
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
        watch, link = self._watch, self._link
        if watch.engaged_us is not None and watch.rows:
            if self._origin is None:
                first = watch.rows[0]
                self._origin = PositionSetpoint(first[3], first[4], first[6], first[7])
                self._mission.begin(self._origin)
                self._next_us = now_us
            if now_us >= self._next_us:
                self._next_us += round(1e6 / link.rate_hz)
                at_us = now_us - self._random.randrange(_STEP_US)  # its clock knows nothing of the plant's steps
                elapsed_s = max(1e-6 * (at_us - watch.engaged_us), 0.0)
                if self._random.random() >= link.loss and not self._mission.over(elapsed_s):
                    late_us = round(1e6 * link.jitter_s * self._random.random())
                    self._due.append((now_us + late_us, self._sample(elapsed_s, at_us)))
        for due in sorted(self._due):
            if due[0] <= now_us:
                self._due.remove(due)
                self._channels.down.put(due[1], now_us)

    def _sample(self, elapsed_s: float, at_us: int) -> bytes:
        assert self._origin is not None
        _, at = self._mission.wanted(elapsed_s, self._origin)
        assert at is not None
        mask = _MASK | (_NO_ACCELERATION if self._link.velocity_only else 0)
        message = mavlink.MAVLink_set_position_target_local_ned_message(
            _CLOCK_MS + at_us // 1000, 1, 191, mavlink.MAV_FRAME_LOCAL_NED, mask, *at[:9], 0.0, 0.0
        )
        return bytes(message.pack(self._packer))


def fly_streamed(
    config_path: Path, mission: str, link: PlannerLink, seed: int, folder: Path
) -> tuple[against.PathScores, str]:
    """(scores as of the same mission from the config, why the flight ended). `mission` is an override."""
    wanted = load_config(config_path, (mission,))
    course = TrajectoryMission(wanted)
    course.begin(PositionSetpoint(0.0, 0.0, 0.0, 0.0))
    duration_s = next(0.1 * k for k in range(10**5) if course.over(0.1 * k))
    flown = load_config(
        config_path,
        (
            "mission.trajectories=[]",
            f"mission.duration_s={duration_s}",
            f"steering={{enabled: true, system_ids: [{PLANNER[0]}]}}",
            f"guards.fence={_FENCE}",
        ),
    )
    world = build_world(flown)
    world.autopilot.start_in_air(against.ALTITUDE_M, against.SETTLE_S)
    watch = against._Watch(world)
    channels = Channels(Channel(random.Random(1)), Channel(random.Random(2)))
    Planner(wanted, world, channels, watch, link, seed)
    recorder = open_folder(folder, config_path, flown, blocking=True)
    try:
        memory = LockstepLink(world.autopilot, channels=channels)
        process = FlightProcess(flown, memory, recorder, hedging=True, lockstep=True, wall=memory.wall)
        reason = process.run().reason
    finally:
        recorder.close()
    return against.score_path(against.track_of(wanted, np.array(watch.rows))), reason.value
